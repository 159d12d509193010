"""Find a stiff lump by palpation: an environment in the manner of Gymnasium, which need not be installed.

A pad of 60 mm × 60 mm is soft, and stiffer around a lump that nobody sees. Each action moves a fingertip (a point) by up to 2 mm, and the
pad pushes back; the searcher says when it believes that it is over the lump. The pad's stiffness is made up by a formula: for a simulated
phantom open the body of examples/phantom-with-tumour.toml instead.

    python bindings/python/examples/find_the_tumour.py
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import palpate

gymnasium: Any
try:
    import gymnasium
except ImportError:
    gymnasium = None

_Env: Any = object if gymnasium is None else gymnasium.Env

SIZE_M = 0.06
DEEPEST_M = 0.006


def pad(lump_m: npt.ArrayLike, *, points: int = 13, cells: int = 24) -> palpate.Body:
    """An open, flat pad in the plane z = 0 with a lump below `lump_m`, (2,), m: three times as stiff there as far from it."""
    line = np.linspace(-SIZE_M / 2, SIZE_M / 2, cells + 1)
    x, y = np.meshgrid(line, line, indexing="ij")
    position_m = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    corner = np.arange(x.size).reshape(x.shape)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[1:, :-1].ravel(), corner[1:, 1:].ravel(), corner[:-1, 1:].ravel()
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])

    at = np.linspace(-SIZE_M / 2, SIZE_M / 2, points)
    px, py = (grid.ravel() for grid in np.meshgrid(at, at, indexing="ij"))
    distance = np.hypot(px - np.asarray(lump_m)[0], py - np.asarray(lump_m)[1])
    stiffness = 100 * (1 + 2 * np.exp(-((distance / 0.009) ** 2)))  # N/m
    depths = np.array([0.002, 0.004, DEEPEST_M])
    samples: dict[str, list[Any]] = {
        name: [] for name in ("point", "x_m", "y_m", "z_m", "component", "deflection_m", "value")
    }
    for k, (px_m, py_m, n_per_m) in enumerate(zip(px, py, stiffness)):
        for depth in depths:
            for component, value in (
                ("normal", n_per_m * depth * (1 + depth / 0.004)),
                ("lateral", n_per_m * depth),
            ):
                for name, cell in zip(samples, (k, px_m, py_m, 0.0, component, depth, value)):
                    samples[name].append(cell)
    return palpate.Body.from_samples(
        position_m=position_m, triangles=triangles, samples=samples, friction=0.1, is_open=True
    )


class FindTheTumour(_Env):  # type: ignore[misc]
    """One episode: a new lump, a fingertip above the pad's middle.

    Action, (4,), -1 to 1: the way of the tip along x, y, z in parts of 2 mm, and, above 0.5, the word that the lump is here, which ends the episode.
    Observation, (6,): the tip, m, and the force on it, N. Reward: when it ends, minus the distance to the lump in centimetres; before, minus
    0.001 for each action, and 0.01 more for each newton.
    """

    metadata: dict[str, Any] = {"render_modes": []}
    way_m = 0.002
    steps_per_action = 20  # at 1 kHz

    def __init__(self, *, actions_max: int = 2000) -> None:
        self.actions_max = actions_max
        self._random = np.random.default_rng()
        if gymnasium is not None:
            low = np.array([-SIZE_M, -SIZE_M, -SIZE_M, -100, -100, -100])
            self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (4,), np.float64)
            self.observation_space = gymnasium.spaces.Box(low, -low, (6,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """A new episode; `options` may have the lump's place, `lump_m`, (2,), m."""
        if seed is not None:
            self._random = np.random.default_rng(seed)
        chosen = (options or {}).get("lump_m", self._random.uniform(-0.018, 0.018, 2))
        self.lump_m = np.asarray(chosen, dtype=float)
        self.contact = palpate.Contact(pad(self.lump_m))
        self.tip_m = np.array([0.0, 0.0, 0.002])
        self.actions = 0
        self.force_n = np.array(self.contact.step(position_m=self.tip_m, dt_s=0.0).force_n)
        return self._observed(), {}

    def step(self, action: npt.ArrayLike) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One action."""
        chosen = np.clip(np.asarray(action, dtype=float), -1.0, 1.0)
        reach = SIZE_M / 2 - 0.002
        to = np.clip(self.tip_m + self.way_m * chosen[:3], [-reach, -reach, -DEEPEST_M], [reach, reach, 0.01])
        parts = np.linspace(0, 1, self.steps_per_action + 1)[1:, None]
        trace = self.contact.rollout(palpate.Path(position_m=self.tip_m + parts * (to - self.tip_m), dt_s=1e-3))
        self.tip_m, self.force_n = to, np.array(trace["force_n"][-1])
        self.actions += 1
        found = bool(chosen[3] > 0.5)
        distance = float(np.linalg.norm(self.tip_m[:2] - self.lump_m))
        reward = -100 * distance if found else -0.001 - 0.01 * float(np.linalg.norm(self.force_n))
        return self._observed(), reward, found, self.actions >= self.actions_max, {"distance_m": distance}

    def _observed(self) -> Any:
        return np.concatenate([self.tip_m, self.force_n])


def search(env: FindTheTumour, *, seed: int | None = None, options: dict[str, Any] | None = None) -> float:
    """Presses in a grid, and says that the lump is where forces, weighted, are greatest. Returns its distance, m."""
    observed, _ = env.reset(seed=seed, options=options)

    def go(target: npt.ArrayLike) -> None:
        nonlocal observed
        while (way := (np.asarray(target) - observed[:3]) / env.way_m).any() and np.abs(way).max() > 1e-9:
            observed, *_ = env.step([*np.clip(way, -1, 1), 0.0])

    places, forces = [], []
    for x in np.arange(-0.024, 0.025, 0.008):
        for y in np.arange(-0.024, 0.025, 0.008):
            go([observed[0], observed[1], 0.002])
            go([x, y, 0.002])
            go([x, y, -0.004])
            places.append((x, y))
            forces.append(observed[5])
    excess = np.array(forces) - np.median(forces)
    weights = np.where(excess > 0.3 * excess.max(), excess, 0.0)
    best = weights @ np.array(places) / weights.sum()
    go([observed[0], observed[1], 0.002])
    go([*best, 0.002])
    _, _, _, _, info = env.step([0.0, 0.0, 0.0, 1.0])
    return float(info["distance_m"])


if __name__ == "__main__":
    for seed in range(5):
        print(f"seed {seed}: {1e3 * search(FindTheTumour(), seed=seed):.1f} mm from the lump")
