"""What palpate costs from Python: a step, a rollout against Rust's own, many rollouts on more cores.

    cargo build --release -p palpate-python --example rollout_cost
    python bindings/python/measure.py target/release/examples/rollout_cost

Processor time, the least of some repeats, so that what else runs counts little; `rollout_many` is also measured against the clock, which needs
cores that are free.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import palpate

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
STEPS = 1_000_000
REPEATS = 5


def lump() -> palpate.Body:
    position_m, triangles = palpate.read_mesh(EXAMPLES / "fit/lump.obj", unit="mm")
    samples = EXAMPLES / "fit/samples.csv"
    return palpate.Body.from_samples(position_m=position_m, triangles=triangles, samples=samples)


def circles(steps: int, seed: int = 0) -> np.ndarray:
    """Pressed into the lump's top by 2 to 3 mm after a first millimetre above it, and led in circles of 5 mm, 25 mm/s."""
    t = np.arange(steps) * 1e-3
    press = np.minimum(t / 0.1, 1.0)
    x, y = 0.005 * np.cos(5 * t + seed), 0.005 * np.sin(5 * t + seed)
    return np.column_stack([press * x, press * y, 0.016 - press * (0.0045 + 0.0005 * np.sin(7 * t))])


def least(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Processor time of this thread, s."""
    times = []
    for _ in range(repeats):
        begun = time.thread_time()
        work()
        times.append(time.thread_time() - begun)
    return min(times)


def main() -> None:
    body = lump()
    positions = circles(STEPS)
    path = palpate.Path(position_m=positions, dt_s=1e-3)
    touching = (palpate.Contact(body).rollout(path)["element"] >= 0).mean()
    print(f"{100 * touching:.0f} % of the path is in contact")

    few = [tuple(p) for p in positions[:20_000].tolist()]
    arrays = list(positions[:20_000])

    def steps(given: Sequence[tuple[float, ...] | np.ndarray]) -> None:
        contact = palpate.Contact(body)
        step = contact.step
        for p in given:
            step(position_m=p, dt_s=1e-3).force_n

    for name, given in (("tuples", few), ("arrays", arrays)):
        print(f"step, positions as {name}: {1e9 * least(lambda: steps(given)) / len(given):.0f} ns")

    python = 1e9 * least(lambda: palpate.Contact(body).rollout(path)) / STEPS
    out = palpate.Contact(body).rollout(path)
    again = 1e9 * least(lambda: palpate.Contact(body).rollout(path, out=out)) / STEPS
    made = 1e9 * least(lambda: palpate.Path(position_m=positions, dt_s=1e-3)) / STEPS
    print(f"rollout of {STEPS} steps: {python:.1f} ns a step; into a trace that is there: {again:.1f} ns; making its Path: {made:.1f} ns")
    if len(sys.argv) > 1:
        with tempfile.TemporaryDirectory() as folder:
            body.save(Path(folder) / "lump.body")
            positions.tofile(Path(folder) / "positions")
            command = [sys.argv[1], str(Path(folder) / "lump.body"), str(Path(folder) / "positions"), str(REPEATS)]
            rust = float(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
        print(f"the same in Rust: {rust:.1f} ns a step; Python takes {100 * (python / rust - 1):+.1f} %, into a trace {100 * (again / rust - 1):+.1f} %")

    paths = [palpate.Path(position_m=circles(2000, seed), dt_s=1e-3) for seed in range(200)]
    spent = {}
    for threads in (1, 2):
        times = []
        for _ in range(REPEATS):
            clock, processor = time.perf_counter(), time.process_time()
            palpate.rollout_many(body, paths, threads=threads)
            times.append((time.perf_counter() - clock, time.process_time() - processor))
        spent[threads] = (min(t[0] for t in times), min(t[1] for t in times))
        print(f"rollout_many, 200 paths of 2000 steps, {threads} thread(s): {spent[threads][0]:.3f} s by the clock, {spent[threads][1]:.3f} s of processor time")
    print(f"two threads are {spent[1][0] / spent[2][0]:.2f} times as fast by the clock")


if __name__ == "__main__":
    main()
