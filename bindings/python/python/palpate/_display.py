"""How a body shows itself in a notebook."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._palpate import Body


def body_html(body: Body) -> str:
    """A table of what a body is."""
    low, high = body.bounds_m
    size = " × ".join(f"{1e3 * x:.1f}" for x in high - low)
    tool = body.tool if body.tool_radius_m == 0 else f"{body.tool}, radius {1e3 * body.tool_radius_m:g} mm"
    law = "coupled potentials" if body.is_coupled else "curves"
    rows = [
        ("size", f"{size} mm"),
        ("surface", f"{len(body.position_m):,} nodes, {len(body.triangles):,} triangles"),
        ("law", f"{law} at {len(body.test_point_nodes):,} test points, to {1e3 * body.depth_max_m:.2f} mm depth"),
        ("stiffness", f"up to {body.stiffness_max_n_per_m:,.0f} N/m"),
        ("tool", tool),
        ("slip", f"{body.slip_rule}, {'with' if body.has_tank else 'without'} the tank"),
        ("made by", str(body.provenance.get("software") or "–")),
    ]
    cells = "".join(f"<tr><th style='text-align:left'>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>" for k, v in rows)
    return f"<table><caption>palpate body</caption>{cells}</table>"
