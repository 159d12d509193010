"""The silicone cylinders between plates that they stick to, by FElupe 11.3 in two dimensions: writes plates.csv. Needs
felupe, tensortrax, pypardiso.

Cylinder of 25 mm radius and 30 mm height, of which the upper half is solved; quadrilaterals of nine nodes, finer towards the
plate's rim. Laws with J^(-2/3) I1 and J^(-1/3) lambda, and K/2 (J - 1)^2 with nu = 0.499; parameters are the Tissue Phantom
Materials Database's (A. B. Dawood et al. 2026, CC BY 4.0), in kPa."""

import felupe as fem
import numpy as np
from pypardiso import spsolve

R, HALF, CELLS = 0.025, 0.015, 24
STRAINS = [0.1, 0.2, 0.3, 0.4]
LAWS = {
    "EF10_0T,yeoh": (fem.yeoh, dict(C10=7.70212, C20=-0.0628109, C30=0.247868), 2 * 7.70212),
    "EF10_0T,ogden": (fem.ogden, dict(mu=[6.05322 * 4.71636 / 2], alpha=[4.71636]), 6.05322 * 4.71636 / 2),
    "EF50_0T,yeoh": (fem.yeoh, dict(C10=23.3326, C20=-0.494129, C30=0.491781), 2 * 23.3326),
    "EF50_0T,ogden": (fem.ogden, dict(mu=[22.9287 * 3.87478 / 2], alpha=[3.87478]), 22.9287 * 3.87478 / 2),
}


def mesh(cells):
    """x along the axis, y the radius; cells shrink towards the plate and the mantle."""
    plane = fem.Rectangle(a=(0, 0), b=(1, 1), n=(2 * cells + 1, 2 * cells + 1))
    x, y = plane.points.T
    toward = lambda t: 1.7 * t - 0.7 * t * t  # slope 1.7 at 0, 0.3 at 1
    points = np.stack([HALF * toward(x), R * toward(y)], 1)
    index = np.arange((2 * cells + 1) ** 2).reshape(2 * cells + 1, -1)
    if abs(x[index[0, 1]] - x[index[0, 0]]) < 1e-12:  # its points run along y first
        index = index.T
    quads = []
    for j in range(0, 2 * cells, 2):
        for i in range(0, 2 * cells, 2):
            p = index[j : j + 3, i : i + 3]
            quads.append([p[0, 0], p[0, 2], p[2, 2], p[2, 0], p[0, 1], p[1, 2], p[2, 1], p[1, 0], p[1, 1]])
    return fem.Mesh(points, np.array(quads), "quad9")


def run(name, cells):
    law, parameters, shear = LAWS[name]
    bulk = 2 * shear * 1.499 / (3 * (1 - 2 * 0.499))
    grid = mesh(cells)
    field = fem.FieldContainer([fem.FieldAxisymmetric(fem.RegionBiQuadraticQuad(grid), dim=2)])
    umat = fem.Hyperelastic(law, **parameters) & fem.Volumetric(bulk=bulk)
    body = fem.SolidBody(umat, field)
    x, y = grid.points.T
    top = x > HALF - 1e-9
    held = np.stack([(x < 1e-9) | top, (y < 1e-9) | top], 1).ravel()
    free = np.flatnonzero(~held)
    values = field[0].values
    previous, older = values.copy(), values.copy()
    small = 0.003125
    # A first guess that keeps the volume: planes stay planes, which move in parabolas.
    t = x / HALF
    guess = small * np.stack([-HALF * (1.5 * t - 0.5 * t**3), 0.75 * y * (1 - t * t)], 1)
    for k in range(1, round(STRAINS[-1] / small) + 1):
        values[:] = 2 * previous - older if k > 1 else guess
        values[top, 0] = -small * k * HALF
        for iteration in range(30):
            g = body.assemble.vector(field).toarray().ravel()
            norm = np.linalg.norm(g[free])
            if iteration and norm < 1e-8 * np.linalg.norm(g):
                break
            step = np.zeros(g.size)
            step[free] = spsolve(body.assemble.matrix(field).tocsr()[free][:, free].tocsr(), -g[free])
            values += step.reshape(-1, 2)
        else:
            return
        older, previous = previous, values.copy()
        strain = small * k
        if any(abs(strain - s) < 1e-9 for s in STRAINS):
            stress = -g.reshape(-1, 2)[top, 0].sum() / (np.pi * R * R)
            yield f"{cells},{name},{strain:g},{stress:.7g}"


if __name__ == "__main__":
    table = ["cells,material,law,strain,stress_kpa"]
    for name in LAWS:
        for cells in (CELLS // 2, CELLS):
            for row in run(name, cells):
                print(row, flush=True)
                table.append(row)
    with open("plates.csv", "w") as file:
        file.write("\n".join(table) + "\n")
