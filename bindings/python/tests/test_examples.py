"""The notebook and the environment run."""

import importlib.util
import json
from pathlib import Path

import numpy as np
import palpate
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


def test_the_notebook_runs(monkeypatch):
    """Its cells, one after the other, in one namespace."""
    pytest.importorskip("matplotlib").use("agg")
    import matplotlib.pyplot as plt

    monkeypatch.chdir(EXAMPLES)
    notebook = json.loads((EXAMPLES / "first_touch.ipynb").read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    cells = ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == "code"]
    namespace: dict = {}
    for cell in cells:
        exec(compile(cell, "first_touch.ipynb", "exec"), namespace)
    assert len(cells) >= 5 and isinstance(namespace["body"], palpate.Body)
    plt.close("all")


def test_the_pages_first_minute_runs(capsys, monkeypatch):
    root = EXAMPLES.parents[2]
    monkeypatch.chdir(root)
    page = (root / "docs/python.md").read_text(encoding="utf-8")
    blocks = page.split("```python\n")[1:]
    assert blocks
    for block in blocks:
        exec(compile(block.split("```")[0], "docs/python.md", "exec"), {})
    assert "N at most" in capsys.readouterr().out


@pytest.fixture(scope="module")
def tumour():
    spec = importlib.util.spec_from_file_location("find_the_tumour", EXAMPLES / "find_the_tumour.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tumour_is_found(tumour):
    for seed in range(3):
        assert tumour.search(tumour.FindTheTumour(), seed=seed) < 0.003
    # A guess without palpation is farther off: the lump's mean distance from the middle.
    env = tumour.FindTheTumour()
    blind = []
    for seed in range(3):
        env.reset(seed=seed)
        blind.append(env.step([0, 0, 0, 1])[4]["distance_m"])
    assert np.mean(blind) > 0.006


def test_episodes_repeat(tumour):
    env = tumour.FindTheTumour(actions_max=3)
    runs = []
    for _ in range(2):
        observed = [env.reset(seed=7)[0]]
        for _ in range(3):
            result, reward, terminated, truncated, _ = env.step([0.3, 0.1, -1, 0])
            observed.append(result)
        assert truncated and not terminated and reward < 0
        runs.append(np.array(observed))
    assert (runs[0] == runs[1]).all()
    assert runs[0][-1, 5] > 0.05


def test_gymnasium_accepts_it(tumour):
    gymnasium = pytest.importorskip("gymnasium")
    env = tumour.FindTheTumour()
    assert isinstance(env, gymnasium.Env)
    observed, _ = env.reset(seed=1)
    assert env.observation_space.contains(observed)
    assert env.observation_space.contains(env.step(env.action_space.sample())[0])
