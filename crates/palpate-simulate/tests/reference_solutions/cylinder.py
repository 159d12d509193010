"""A rigid sphere pressed into a cylinder along its axis, to 0.8 radii, by FElupe 11.3 in two dimensions: writes
cylinder.csv. Needs felupe, scipy, pypardiso.

    python cylinder.py [EDGE_MM CONTACT]     # alone it runs all, some minutes

Cylinder of 30 mm radius and 25 mm height, held below, free at its side. Neo-Hookean, mu/2 (J^(-2/3) I1 - 3) + K/2
(J - 1)^2, E = 10 kPa, nu = 0.45. Quadrilaterals of nine nodes; the elements of the body are FElupe's, the contact is
written here: at three Gauss points of each edge of the top a penalty along the sphere's normal, and with sticking
contact the same spring along its surface to where the point touched first."""

import itertools
import sys

import felupe as fem
import numpy as np
from pypardiso import spsolve
from scipy.sparse import coo_matrix, csr_matrix

E, NU, R, WIDTH, HEIGHT = 1e4, 0.45, 0.01, 0.03, 0.025
MU, BULK = E / 2 / (1 + NU), E / 3 / (1 - 2 * NU)
STEP = 5e-5


def graded(fine_to, edge, end):
    """Planes of even distances up to fine_to, which then grow by a sixth each."""
    at = list(np.linspace(0, fine_to, round(fine_to / edge) + 1))
    rest, step = [fine_to], edge
    while rest[-1] < end:
        step *= 7 / 6
        rest.append(rest[-1] + step)
    scale = (end - fine_to) / (rest[-1] - fine_to)
    return np.array(at + [fine_to + scale * (x - fine_to) for x in rest[1:]])


def mesh_of(edge):
    """FElupe's axes: x is the cylinder's, y the radius. The top is x = 0."""
    depth, radius = [
        np.interp(np.arange(2 * len(g) - 1) / 2, np.arange(len(g)), g)
        for g in (graded(edge, edge, HEIGHT), graded(0.013, edge, WIDTH))
    ]
    n, m = len(depth), len(radius)
    points = np.array([[-d, r] for d in depth for r in radius])
    index = np.arange(n * m).reshape(n, m)
    cells = []
    for i, j in itertools.product(range(0, n - 1, 2), range(0, m - 1, 2)):
        # From the lower left, against the clock: i grows downwards.
        a, b, c = index[i + 2, j : j + 3], index[i + 1, j : j + 3], index[i, j : j + 3]
        cells.append([a[0], c[0], c[2], a[2], b[0], c[1], b[2], a[1], b[1]])
    edges = np.array([index[0, j : j + 3] for j in range(0, m - 1, 2)])
    return fem.Mesh(points, np.array(cells), "quad9"), edges


class Sphere:
    def __init__(self, points, edges, edge, sticking):
        self.edges, self.rest, self.sticking = edges, points, sticking
        at, weight = np.polynomial.legendre.leggauss(3)
        self.shape = np.array([at * (at - 1) / 2, 1 - at * at, at * (at + 1) / 2]).T
        x = np.einsum("qa,ead->eqd", self.shape, points[edges])
        half = 0.5 * (points[edges[:, 2], 1] - points[edges[:, 0], 1])
        self.weight = 2 * np.pi * x[..., 1] * weight * half[:, None]
        self.penalty = 500 * E / (1 - NU**2) / edge
        self.anchor = np.full(x.shape, np.nan)
        self.before = x
        self.centre_before = R

    def places(self, u):
        return np.einsum("qa,ead->eqd", self.shape, (self.rest + u)[self.edges])

    def catch(self, u, centre):
        """What touches is caught at the part of the step at which it began to."""
        if not self.sticking:
            return
        now = self.places(u) - [centre, 0]
        then = self.before - [self.centre_before, 0]
        gap, gap_before = np.linalg.norm(now, axis=-1) - R, np.linalg.norm(then, axis=-1) - R
        new = (gap < 0) & np.isnan(self.anchor[..., 0])
        part = np.clip(gap_before / (gap_before - gap), 0, 1)[..., None]
        place = then + part * (now - then)
        self.anchor[new] = place[new]

    def converged(self, u, centre):
        self.before, self.centre_before = self.places(u), centre
        gap = np.linalg.norm(self.before - [centre, 0], axis=-1) - R
        self.anchor[gap >= 0] = np.nan

    def assemble(self, u, centre, size):
        x = self.places(u) - [centre, 0]
        length = np.linalg.norm(x, axis=-1)
        normal, gap = x / length[..., None], length - R
        touches = gap < 0
        pressed = np.where(touches, self.weight * self.penalty, 0.0)
        nn = normal[..., :, None] * normal[..., None, :]
        force = (pressed * gap)[..., None] * normal
        tangent = pressed[..., None, None] * (nn + (gap / length)[..., None, None] * (np.eye(2) - nn))
        held = ~np.isnan(self.anchor[..., 0])
        if held.any():
            anchor = np.where(held[..., None], self.anchor, x)
            along = anchor / np.linalg.norm(anchor, axis=-1)[..., None]
            project = np.eye(2) - along[..., :, None] * along[..., None, :]
            spring = np.where(held, self.weight * self.penalty, 0.0)[..., None, None] * project
            force += np.einsum("eqij,eqj->eqi", spring, x - anchor)
            tangent += spring
        vector = np.zeros((size // 2, 2))
        np.add.at(vector, self.edges, np.einsum("eqi,qa->eai", force, self.shape))
        block = np.einsum("eqij,qa,qb->eaibj", tangent, self.shape, self.shape)
        dof = 2 * self.edges[:, :, None] + np.arange(2)
        row = np.broadcast_to(dof[:, :, :, None, None], block.shape)
        column = np.broadcast_to(dof[:, None, None, :, :], block.shape)
        matrix = coo_matrix((block.ravel(), (row.ravel(), column.ravel())), (size, size)).tocsr()
        return vector.ravel(), matrix, force[..., 0].sum()


def run(edge_mm, contact):
    edge = edge_mm * 1e-3
    mesh, edges = mesh_of(edge)
    field = fem.FieldContainer([fem.FieldAxisymmetric(fem.RegionBiQuadraticQuad(mesh), dim=2)])
    body = fem.SolidBody(fem.NeoHooke(MU, BULK), field)
    values = field[0].values
    bottom, axis = mesh.points[:, 0] < -HEIGHT + 1e-9, mesh.points[:, 1] < 1e-9
    free = np.flatnonzero(~np.stack([bottom, bottom | axis], 1).ravel())
    sphere = Sphere(mesh.points, edges, edge, contact == "sticking")
    size = values.size

    def assembled(centre):
        vector, matrix, pressed = sphere.assemble(values, centre, size)
        body.results.force = None
        g = body.assemble.vector(field).toarray().ravel() + vector
        return g, (body.assemble.matrix(field) + matrix).tocsr(), pressed

    count, previous, older = round(0.8 * R / STEP), values.copy(), values.copy()
    for k in range(1, count + 1):
        centre = R - k * STEP
        values[:] = 2 * previous - older if k > 2 else previous
        for iteration in range(60):
            sphere.catch(values, centre)
            g, matrix, pressed = assembled(centre)
            norm = np.linalg.norm(g[free])
            if norm < 1e-9 * max(abs(pressed), 1e-3) and iteration:
                break
            step = np.zeros(size)
            step[free] = spsolve(csr_matrix(matrix[free][:, free]), -g[free])
            # No node moves by more than a few steps at once.
            step *= min(1.0, 3 * STEP / np.abs(step).max())
            values += step.reshape(-1, 2)
        else:
            raise RuntimeError(f"no convergence at step {k}: {norm:g} N")
        sphere.converged(values, centre)
        older, previous = previous, values.copy()
        depth = k * STEP * 1e3
        print(f"{depth:.2f} mm: {iteration} iterations, {abs(pressed):.6f} N", file=sys.stderr, flush=True)
        if k % (count // 8) == 0:
            yield f"{edge_mm:g},{contact},{depth:g},{abs(pressed):.7g}"


if __name__ == "__main__":
    if len(sys.argv) > 2:
        for row in run(float(sys.argv[1]), sys.argv[2]):
            print(row, flush=True)
    else:
        table = ["edge_mm,contact,depth_mm,normal_n"]
        for edge_mm, contact in [*itertools.product([0.8, 0.4], ["frictionless", "sticking"]), (0.2, "frictionless")]:
            table += run(edge_mm, contact)
        with open("cylinder.csv", "w") as file:
            file.write("\n".join(table) + "\n")
