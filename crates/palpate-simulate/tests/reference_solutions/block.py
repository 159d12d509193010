"""A block under combined load, by CalculiX (ccx 2.20): writes block.csv. Needs numpy.

    python block.py FOLDER [CONTACT]    # FOLDER for decks and their output; alone it runs both, ten minutes of CPU time

Half a block, |x| <= 25, 0 <= y <= 25, -20 <= z <= 0 mm, y = 0 its plane of symmetry, held at z = -20 mm. The cells of a
grid are each six ten-node tetrahedra around the diagonal from the lowest to the highest corner. Neo-Hookean, mu/2
(J^(-2/3) I1 - 3) + K/2 (J - 1)^2, E = 10 kPa, nu = 0.45. What is pressed in and then moved along x is

- tied: the surface's nodes up to 6 mm from the origin;
- sliding: a rigid sphere of 10 mm that first touches at the origin, with a friction coefficient of 0.3. Contact is face to
  face, with linear penalties."""

import itertools
import os
import subprocess
import sys

import numpy as np

E, NU, RADIUS = 1e4, 0.45, 0.01
MU, BULK = E / 2 / (1 + NU), E / 3 / (1 - 2 * NU)
# Grid planes, mm.
X = [0, 2, 4, 6, 8, 10.5, 14, 19, 25]
Y = [0, 2, 4, 6.5, 10.5, 16.5, 25]
Z = [0, 2, 4, 6.5, 10, 14.5, 20]
FRICTION = 0.3
PENALTY, STICK = 1e9, 1e8  # N/m3; 80 contact moduli over a millimetre, and what is left to slip before it slips
# Pressed in by 4 mm, then moved by 4 mm along x; a row of the table for each millimetre.
WAY = [(depth, 0.0) for depth in (1, 2, 3, 4)] + [(4.0, x) for x in (1, 2, 3, 4)]
STEPS_PER_MM = 2, 4  # pressing, and moving along


def block():
    """Nodes (m) and C3D10 elements."""
    grid = [np.array(g, float) for g in ([-x for x in X[:0:-1]] + X, Y, [-z for z in Z[::-1]])]
    # Twice as fine: corners and the middles of edges.
    grid = [np.interp(np.arange(2 * len(g) - 1) / 2, np.arange(len(g)), g) for g in grid]
    shape = [len(g) for g in grid]
    nodes = np.stack(np.meshgrid(*grid, indexing="ij"), -1).reshape(-1, 3) * 1e-3
    index = lambda p: int(np.ravel_multi_index(tuple(p), shape))
    elements = []
    for cell in itertools.product(*[range(0, s - 1, 2) for s in shape]):
        for order in itertools.permutations(range(3)):
            corners = [np.array(cell)]
            for axis in order:
                corners.append(corners[-1] + 2 * np.eye(3, dtype=int)[axis])
            if order in [(1, 0, 2), (0, 2, 1), (2, 1, 0)]:
                corners[2], corners[3] = corners[3], corners[2]
            edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
            elements.append([index(c) for c in corners] + [index((corners[a] + corners[b]) // 2) for a, b in edges])
    used = np.unique(elements)
    number = np.full(len(nodes), -1)
    number[used] = np.arange(len(used))
    return nodes[used], number[np.array(elements)]


def sphere():
    """The lower part of a sphere as one layer of quadratic bricks, 75 degrees to each side; m."""
    n = 14
    at = np.radians(np.linspace(-75, 75, 2 * n + 1))
    number, nodes, elements = {}, [], []

    def node(i, j, k):
        if (i, j, k) not in number:
            # Equal angles along both axes; the corners stay below the equator.
            direction = np.array([np.tan(at[i] * 0.8), np.tan(at[j] * 0.8), -1.0])
            direction /= np.linalg.norm(direction)
            number[i, j, k] = len(nodes)
            nodes.append(direction * RADIUS * (1 - 0.05 * k) + [0, 0, RADIUS])
        return number[i, j, k]

    for i, j in itertools.product(range(0, 2 * n, 2), repeat=2):
        # C3D20: four below, four above, middles of their edges; k = 2 is inside.
        ring = [(i, j), (i + 2, j), (i + 2, j + 2), (i, j + 2)]
        low = [(*p, 0) for p in ring]
        high = [(*p, 2) for p in ring]
        middle = lambda a, b: tuple((u + v) // 2 for u, v in zip(a, b))
        around = lambda r: [middle(r[m], r[(m + 1) % 4]) for m in range(4)]
        upright = [middle(a, b) for a, b in zip(low, high)]
        elements.append([node(*p) for p in low + high + around(low) + around(high) + upright])
    return np.array(nodes), np.array(elements)


def rows(values):
    values = list(values)
    return "\n".join(",".join(str(v) for v in values[i : i + 8]) for i in range(0, len(values), 8))


def listed(number, values):
    """An element's line: sixteen numbers at most."""
    numbers = [number, *values]
    return ",\n".join(",".join(str(v) for v in numbers[i : i + 12]) for i in range(0, len(numbers), 12))


def deck(contact):
    nodes, elements = block()
    low = 1e-9
    number = lambda mask: rows(np.flatnonzero(mask) + 1)
    bottom, middle, top = nodes[:, 2] < -0.02 + low, nodes[:, 1] < low, nodes[:, 2] > -low
    patch = top & (np.hypot(nodes[:, 0], nodes[:, 1]) < 0.006 + low)
    tool, bricks = sphere()
    first, reference = len(nodes) + 1, len(nodes) + len(tool) + 1
    points = nodes if contact == "tied" else np.vstack([nodes, tool, [[0, 0, RADIUS]] * 2])
    text = ["*NODE,NSET=NALL"]
    text += [f"{i + 1},{x:.12g},{y:.12g},{z:.12g}" for i, (x, y, z) in enumerate(points)]
    text += ["*ELEMENT,TYPE=C3D10,ELSET=BLOCK"] + [listed(i + 1, e + 1) for i, e in enumerate(elements)]
    text += ["*NSET,NSET=BOTTOM", number(bottom), "*NSET,NSET=MIDDLE", number(middle)]
    text += ["*MATERIAL,NAME=TISSUE", "*HYPERELASTIC,NEO HOOKE", f"{MU / 2:.12g},{2 / BULK:.12g}"]
    text += ["*SOLID SECTION,ELSET=BLOCK,MATERIAL=TISSUE"]
    if contact == "tied":
        text += ["*NSET,NSET=MOVED", number(patch)]
        boundary = ["BOTTOM,1,3", "MIDDLE,2,2", "MOVED,2,2"]
    else:
        text += ["*ELEMENT,TYPE=C3D20,ELSET=TOOL"]
        text += [listed(len(elements) + i + 1, e + first) for i, e in enumerate(bricks)]
        text += ["*NSET,NSET=TOOLNODES", rows(range(first, reference)), "*NSET,NSET=MOVED", str(reference)]
        text += ["*SURFACE,NAME=TOP,TYPE=ELEMENT"]
        near = top & (np.abs(nodes[:, 0]) < 0.0135) & (nodes[:, 1] < 0.0105)
        sides = [("S1", [0, 1, 2]), ("S2", [0, 1, 3]), ("S3", [1, 2, 3]), ("S4", [0, 2, 3])]
        text += [f"{e + 1},{name}" for e, n in enumerate(elements) for name, side in sides if near[n[side]].all()]
        text += ["*SURFACE,NAME=SPHERE,TYPE=ELEMENT"] + [f"{len(elements) + i + 1},S1" for i in range(len(bricks))]
        text += ["*MATERIAL,NAME=STEEL", "*ELASTIC", "1e9,0.3", "*SOLID SECTION,ELSET=TOOL,MATERIAL=STEEL"]
        text += [f"*RIGID BODY,NSET=TOOLNODES,REF NODE={reference},ROT NODE={reference + 1}"]
        text += ["*SURFACE INTERACTION,NAME=TOUCH", "*SURFACE BEHAVIOR,PRESSURE-OVERCLOSURE=LINEAR", f"{PENALTY:g}"]
        text += ["*FRICTION", f"{FRICTION:g},{STICK:g}"]
        text += ["*CONTACT PAIR,INTERACTION=TOUCH,TYPE=SURFACE TO SURFACE", "TOP,SPHERE"]
        boundary = ["BOTTOM,1,3", "MIDDLE,2,2", "MOVED,2,2", f"{reference + 1},1,3"]
    text += ["*BOUNDARY"] + boundary
    for (d0, x0), (d1, x1) in zip([(0.0, 0.0)] + WAY, WAY):
        step = 1 / (STEPS_PER_MM[x1 > x0] * max(d1 - d0, x1 - x0))
        text += ["*STEP,NLGEOM,INC=1000", "*STATIC,SOLVER=SPOOLES", f"{step:.6g},1.,1e-6,{step:.6g}"]
        text += ["*CONTROLS,PARAMETERS=FIELD", "1e-5,1e-4"] if contact == "tied" else []
        text += ["*BOUNDARY", f"MOVED,1,1,{x1 * 1e-3:.8g}", f"MOVED,3,3,{-d1 * 1e-3:.8g}"]
        text += ["*NODE PRINT,NSET=BOTTOM,TOTALS=ONLY,FREQUENCY=1000", "RF", "*END STEP"]
    return "\n".join(text) + "\n"


def run(folder, contact):
    """Rows of the table: forces on the whole block."""
    name = f"{folder}/{contact}"
    with open(f"{name}.inp", "w") as file:
        file.write(deck(contact))
    with open(f"{name}.log", "w") as log:
        subprocess.run(["ccx", "-i", name], stdout=log, env=dict(os.environ, OMP_NUM_THREADS="1"))
    lines = open(f"{name}.dat").read().splitlines()
    totals = [lines[i + 2].split() for i, line in enumerate(lines) if line.strip().startswith("total force")]
    for (depth, x), (fx, _, fz) in zip(WAY, totals):
        # The support's forces are opposite to the tool's, and half of them.
        yield f"{contact},{depth:g},{x:g},{-2 * float(fx):.7g},{2 * float(fz):.7g}"


if __name__ == "__main__":
    if len(sys.argv) > 2:
        print("\n".join(run(*sys.argv[1:])))
    else:
        table = ["contact,depth_mm,x_mm,lateral_n,normal_n"]
        table += [row for contact in ("tied", "sliding") for row in run(sys.argv[1], contact)]
        with open("block.csv", "w") as file:
            file.write("\n".join(table) + "\n")
