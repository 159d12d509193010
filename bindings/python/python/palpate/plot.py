"""Pictures with matplotlib, which is not installed with palpate: `pip install palpate[plot]`.

Every function draws into `ax`, or into axes of a new figure, and returns them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import ArgumentError, Body, Path

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["body", "curves", "trace"]


def _axes(ax: Any, **kinds: Any) -> Any:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure().add_subplot(**kinds)


def body(
    body: Body, *, node_values: npt.ArrayLike | None = None, label: str | None = None, ax: Any = None
) -> Any:
    """The surface in three dimensions, its test points as dots.

    Args:
        body: What is drawn.
        node_values: A number for each node, which colours the triangles, (n,); without it they are plain.
        label: What these numbers are, for the colour bar.
        ax: Axes with the projection "3d".

    Raises:
        ArgumentError: `node_values` has another shape.
    """
    ax = _axes(ax, projection="3d")
    x, y, z = 1e3 * body.position_m.T
    triangles = body.triangles
    surface = ax.plot_trisurf(x, y, z, triangles=triangles, color="0.85", edgecolor="0.6", linewidth=0.1)
    if node_values is not None:
        values = np.asarray(node_values, dtype=float)
        if values.shape != x.shape:
            raise ArgumentError(f"node_values has the shape {values.shape}; give one for each of {len(x)} nodes")
        surface.set_array(values[triangles].mean(axis=1))
        ax.figure.colorbar(surface, ax=ax, label=label)
    at = body.test_point_nodes
    if len(at) < len(x):
        ax.plot(x[at], y[at], z[at], ".", color="tab:red")
    ax.set(xlabel="x, mm", ylabel="y, mm", zlabel="z, mm", aspect="equal")
    return ax


def curves(body: Body, *, nodes: npt.ArrayLike | None = None, ax: Axes | None = None) -> Axes:
    """Normal force against depth at some nodes; at test points, up to ten of them, if none are given.

    Args:
        body: One whose law is curves.
        nodes: Which, from 0.
        ax: Axes.

    Raises:
        InputError: There is no such node, or the law is a coupled potential.
    """
    drawn: Any = _axes(ax)
    chosen = body.test_point_nodes[:10] if nodes is None else np.atleast_1d(np.asarray(nodes))
    depth_m = np.linspace(0.0, body.depth_max_m, 200)
    for node in chosen:
        drawn.plot(1e3 * depth_m, body.node_curves(int(node), deflection_m=depth_m)["normal_n"], label=f"node {node}")
    drawn.set(xlabel="depth, mm", ylabel="normal force, N")
    drawn.legend()
    return drawn  # type: ignore[no-any-return]


def trace(trace: Any, *, path: Path, ax: Axes | None = None) -> Axes:
    """Force of a rollout against time: its components, its size, and in grey where the contact point slips.

    Args:
        trace: What `Contact.rollout` gave, (n,).
        path: The path that it was led along.
        ax: Axes.

    Raises:
        ArgumentError: The two have different lengths.
    """
    from . import FLAGS

    if len(trace) != len(path):
        raise ArgumentError(f"the trace has {len(trace)} rows and the path {len(path)} poses; give the trace's own path")
    drawn: Any = _axes(ax)
    time_s, force_n = path.time_s, np.asarray(trace["force_n"])
    for k, name in enumerate("xyz"):
        drawn.plot(time_s, force_n[:, k], label=name, linewidth=0.8)
    drawn.plot(time_s, np.linalg.norm(force_n, axis=1), label="size", color="black")
    slips = (trace["flags"] & FLAGS["slipping"]) != 0
    drawn.fill_between(time_s, 0, 1, where=slips, transform=drawn.get_xaxis_transform(), color="0.5", alpha=0.2)
    drawn.set(xlabel="time, s", ylabel="force on the tool, N")
    drawn.legend()
    return drawn  # type: ignore[no-any-return]
