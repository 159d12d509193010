"""What tests share: the lump of examples/fit."""

import os
from pathlib import Path

import numpy as np
import palpate
import pytest

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"


@pytest.fixture(scope="session")
def examples() -> Path:
    return EXAMPLES


@pytest.fixture(scope="session")
def lump() -> palpate.Body:
    position_m, triangles = palpate.read_mesh(EXAMPLES / "fit/lump.obj", unit="mm")
    samples = EXAMPLES / "fit/samples.csv"
    return palpate.Body.from_samples(position_m=position_m, triangles=triangles, samples=samples)


@pytest.fixture(scope="session")
def drag() -> palpate.Path:
    return palpate.Path.open(EXAMPLES / "fit/drag.csv", rate_hz=1000)


@pytest.fixture(scope="session")
def reference() -> Path:
    """What Rust wrote; see package.rs."""
    folder = os.environ.get("PALPATE_REFERENCE")
    if folder is None:
        pytest.skip("PALPATE_REFERENCE is not set: `cargo test -p palpate-python` makes what Rust's bits are compared with")
    return Path(folder)


def random_path(seed: int, steps: int = 2000) -> palpate.Path:
    """Over the lump's top, in and out of it."""
    random = np.random.default_rng(seed)
    t = np.arange(steps) * 1e-3
    phase = random.uniform(0, 2 * np.pi, 3)
    x = 0.008 * np.sin(3 * t + phase[0])
    y = 0.008 * np.sin(2 * t + phase[1])
    z = 0.0145 - 0.004 * np.sin(5 * t + phase[2])
    return palpate.Path(position_m=np.column_stack([x, y, z]), dt_s=1e-3)
