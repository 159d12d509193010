//! Gradients along the surface that the drives of `consistent` and `exact` take off the lateral force (MODEL 4, E2 and
//! E3): nodes' means, or the element's own; and how far the two differ.

use super::curves::{Corners, Curves};
use super::interval::{Interval, IntervalVector, sum};
use super::law::Law;
use super::patch::Cell;
use glam::{DMat3, DVec2, DVec3};
use palpate_body::{Body, Coefficients, SlipRule};

/// The gradients of an element's three nodes, in the element's basis.
#[derive(Debug, Clone)]
pub(super) struct Slopes {
    /// ∇W of normal and of lateral energies.
    normal: Energies,
    lateral: Energies,
    /// ∇(u·b) as a matrix that takes b, 1/m: the nodes'.
    turns: [DMat3; 3],
    /// ∇A of the nodes along x, y and z, 1/m.
    changes: Option<[[DMat3; 3]; 3]>,
}

/// The gradient of an energy, in each interval of its knots.
#[derive(Debug, Clone)]
struct Energies {
    /// (knots × 3 nodes)
    nodes: Vec<[Coefficients; 3]>,
    /// Σ W_j ∇n_j, (knots).
    element: Vec<Coefficients>,
}

/// What [`Energies`] come to over a cell.
#[derive(Clone, Copy)]
pub(super) struct Read {
    /// Σ n_l ∇W_l.
    pub sum: IntervalVector,
    /// Σ n_l ∇W_l − Σ W_j ∇n_j, along the element.
    pub miss: [Interval; 2],
    /// ∇W_l.
    pub nodes: [IntervalVector; 3],
}

impl Slopes {
    /// Of an element for a rule other than `paper`; `local` turns vectors into the element's basis, `axes` are that.
    pub fn new(
        body: &Body,
        element: u32,
        rule: SlipRule,
        axes: [DVec3; 3],
        gradients: [DVec2; 3],
        [normal, lateral]: [&Curves; 2],
    ) -> Self {
        let own = |curves: &Curves| -> Vec<Coefficients> {
            let of = |rows: &[[f64; 5]; 3]| -> Coefficients {
                std::array::from_fn(|i| (0..3).map(|l| gradients[l].extend(0.0) * rows[l][i]).sum())
            };
            curves.integrals.iter().map(of).collect()
        };
        let [z, r] = [normal, lateral].map(own);
        let azimuth = DMat3::from_cols(axes[0], axes[1], axes[2]);
        let local = |v: DVec3| azimuth.transpose() * v;
        let nodes = body.element_nodes(element);
        if rule == SlipRule::Exact {
            let same = |own: &[Coefficients]| own.iter().map(|p| [*p; 3]).collect();
            let tilt = (0..3).map(|l| outer(gradients[l].extend(0.0), local(nodes[l].inward)));
            let tilt = tilt.fold(DMat3::ZERO, |sum, m| sum + m);
            let changes = (!body.is_isotropic()).then(|| {
                let tensors = body
                    .element_tensors(element)
                    .map(|a| azimuth.transpose() * super::patch::matrix(a) * azimuth);
                let along = |of: fn(&DVec2) -> f64| -> DMat3 {
                    (0..3).fold(DMat3::ZERO, |sum, l| sum + tensors[l] * of(&gradients[l]))
                };
                [[along(|g| g.x), along(|g| g.y), DMat3::ZERO]; 3]
            });
            return Slopes {
                normal: Energies { nodes: same(&z), element: z },
                lateral: Energies { nodes: same(&r), element: r },
                turns: [tilt; 3],
                changes,
            };
        }
        let (derived, numbers) = (body.prepared_gradients(), body.element_node_numbers(element));
        let of = |which: usize, element: Vec<Coefficients>| {
            let rows = |interval: usize| {
                [0, 1, 2].map(|l: usize| {
                    let reference = nodes[l].test_points[0];
                    derived.coefficients(numbers[l], reference, body.responses(), interval)[which].map(local)
                })
            };
            Energies { nodes: (0..element.len()).map(rows).collect(), element }
        };
        Slopes {
            normal: of(0, z),
            lateral: of(1, r),
            turns: numbers.map(|node| {
                let columns = DVec3::AXES.map(|b| derived.frame_gradient(node, b.as_vec3a()).as_dvec3());
                azimuth.transpose() * DMat3::from_cols(columns[0], columns[1], columns[2]) * azimuth
            }),
            changes: numbers
                .map(|node| derived.tensor_changes(node))
                .into_iter()
                .collect::<Option<Vec<_>>>()
                .map(|changes| {
                    std::array::from_fn(|l| {
                        let [x, y, z] =
                            changes[l].map(|a| azimuth.transpose() * super::patch::matrix(&a) * azimuth);
                        axes.map(|axis| x * axis.x + y * axis.y + z * axis.z)
                    })
                }),
        }
    }

    /// The nodes' frame gradients, in a basis turned by the rotation `r` about z.
    pub fn turns(&self, r: DMat3) -> [DMat3; 3] {
        self.turns.map(|m| r.transpose() * m * r)
    }

    /// The same of the tensors' changes.
    pub fn changes(&self, r: DMat3) -> Option<[[DMat3; 3]; 3]> {
        self.changes.map(|nodes| {
            nodes.map(|[x, y, z]| {
                let [x, y, z] = [x, y, z].map(|m| r.transpose() * m * r);
                let (cos, sin) = (r.x_axis.x, r.x_axis.y);
                [x * cos + y * sin, y * cos - x * sin, z]
            })
        })
    }

    /// ∇W of normal and lateral energies over a cell, divided by their forces; near 0 with the power in common taken out.
    /// `azimuth` are cosine and sine of the basis that is asked for.
    pub fn by_force(&self, law: &Law, cell: &Cell, azimuth: [f64; 2]) -> [Read; 2] {
        self.each(law, cell, |energies, curves, span| energies.by_force(curves, &cell.corners, span, azimuth))
    }

    /// The same, N, without what the two miss.
    pub fn values(&self, law: &Law, cell: &Cell, azimuth: [f64; 2]) -> [Read; 2] {
        self.each(law, cell, |energies, curves, span| energies.value(curves, &cell.corners, span, azimuth))
    }

    /// How that changes with δz and with ρ, N/m.
    pub fn rates(&self, law: &Law, cell: &Cell, azimuth: [f64; 2]) -> [Read; 2] {
        self.each(law, cell, |energies, curves, span| energies.rate(curves, &cell.corners, span, azimuth))
    }

    /// Σ g_l ∇W_l for a gradient of the area coordinates, N/m.
    pub fn second(&self, law: &Law, cell: &Cell, g: [f64; 3], azimuth: [f64; 2]) -> IntervalVector {
        sum(self.each(law, cell, |energies, curves, span| energies.second(curves, g, span, azimuth)))
    }

    fn each<T>(&self, law: &Law, cell: &Cell, of: impl Fn(&Energies, &Curves, [f64; 2]) -> T) -> [T; 2] {
        let [normal, lateral] = law.curves();
        [of(&self.normal, normal, cell.depth_m), of(&self.lateral, lateral, cell.reach_m)]
    }
}

impl Energies {
    fn by_force(&self, curves: &Curves, corners: &Corners, span: [f64; 2], azimuth: [f64; 2]) -> Read {
        self.over(curves, span, |i, s, e| {
            let (force, reaction) = curves.force(corners, i, s, e);
            let of = |p: &Coefficients| -> IntervalVector {
                let reduced = match reaction {
                    0 => *p,
                    1 => [p[2], p[3], p[4], DVec3::ZERO, DVec3::ZERO],
                    _ => [p[3], p[4], DVec3::ZERO, DVec3::ZERO, DVec3::ZERO],
                };
                let quotient = range3(&reduced, s, e).map(|x| x.per(force));
                if reaction == 0 { quotient } else { quotient.map(|x| x * Interval::new(s, e)) }
            };
            self.read(corners, i, azimuth, true, of)
        })
    }

    fn value(&self, curves: &Curves, corners: &Corners, span: [f64; 2], azimuth: [f64; 2]) -> Read {
        self.over(curves, span, |i, s, e| self.read(corners, i, azimuth, false, |p| range3(p, s, e)))
    }

    fn rate(&self, curves: &Curves, corners: &Corners, span: [f64; 2], azimuth: [f64; 2]) -> Read {
        let slope = |p: &Coefficients| [p[1], p[2] * 2.0, p[3] * 3.0, p[4] * 4.0, DVec3::ZERO];
        self.over(curves, span, |i, s, e| self.read(corners, i, azimuth, false, |p| range3(&slope(p), s, e)))
    }

    fn second(&self, curves: &Curves, g: [f64; 3], span: [f64; 2], azimuth: [f64; 2]) -> IntervalVector {
        let each =
            curves.pieces(span).map(|(i, s, e)| range3(&turned(&mixed3(g, &self.nodes[i]), azimuth), s, e));
        each.reduce(join3).unwrap_or([Interval::ZERO; 3])
    }

    fn over(&self, curves: &Curves, span: [f64; 2], of: impl Fn(usize, f64, f64) -> Read) -> Read {
        let each = curves.pieces(span).map(|(i, s, e)| of(i, s, e));
        each.reduce(Read::join).unwrap_or(NOTHING)
    }

    /// In one interval.
    fn read(
        &self,
        corners: &Corners,
        i: usize,
        azimuth: [f64; 2],
        misses: bool,
        of: impl Fn(&Coefficients) -> IntervalVector,
    ) -> Read {
        let Some(nodes) = self.nodes.get(i) else { return NOTHING };
        let nodes = [turned(&nodes[0], azimuth), turned(&nodes[1], azimuth), turned(&nodes[2], azimuth)];
        let each = [of(&nodes[0]), of(&nodes[1]), of(&nodes[2])];
        let whole = *corners == super::patch::WHOLE;
        let blends = corners.map(|n| mixed3(n, &nodes));
        let sum = if whole { each } else { [of(&blends[0]), of(&blends[1]), of(&blends[2])] };
        let mut miss = [Interval::ZERO; 2];
        if misses {
            let element = turned(&self.element[i], azimuth);
            let less = |m: &Coefficients| of(&std::array::from_fn(|k| m[k] - element[k]));
            let [x, y, _] = join3(join3(less(&blends[0]), less(&blends[1])), less(&blends[2]));
            miss = [x, y];
        }
        Read { sum: join3(join3(sum[0], sum[1]), sum[2]), miss, nodes: each }
    }
}

const NOTHING: Read =
    Read { sum: [Interval::ZERO; 3], miss: [Interval::ZERO; 2], nodes: [[Interval::ZERO; 3]; 3] };

impl Read {
    fn join(self, o: Read) -> Read {
        Read {
            sum: join3(self.sum, o.sum),
            miss: [self.miss[0].join(o.miss[0]), self.miss[1].join(o.miss[1])],
            nodes: std::array::from_fn(|l| join3(self.nodes[l], o.nodes[l])),
        }
    }
}

/// a bᵀ.
fn outer(a: DVec3, b: DVec3) -> DMat3 {
    DMat3::from_cols(a * b.x, a * b.y, a * b.z)
}

fn turned(p: &Coefficients, [cos, sin]: [f64; 2]) -> Coefficients {
    p.map(|v| DVec3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z))
}

fn mixed3(n: [f64; 3], nodes: &[Coefficients; 3]) -> Coefficients {
    std::array::from_fn(|k| nodes[0][k] * n[0] + nodes[1][k] * n[1] + nodes[2][k] * n[2])
}

/// As [`range`](super::interval::range), of three quartics side by side.
fn range3([a, b, c, d, e]: &Coefficients, from: f64, to: f64) -> IntervalVector {
    let (t, h) = (from, to - from);
    let p0 = *a + (*b + (*c + (*d + *e * t) * t) * t) * t;
    let p1 = (*b + (*c * 2.0 + (*d * 3.0 + *e * (4.0 * t)) * t) * t) * h;
    let p2 = (*c + (*d * 3.0 + *e * (6.0 * t)) * t) * (h * h);
    let p3 = (*d + *e * (4.0 * t)) * (h * h * h);
    let p4 = *e * (h * h * h * h);
    let q1 = p0 + p1 * 0.25;
    let q2 = p0 + p1 * 0.5 + p2 * (1.0 / 6.0);
    let q3 = p0 + p1 * 0.75 + p2 * 0.5 + p3 * 0.25;
    let q4 = p0 + p1 + p2 + p3 + p4;
    let low = p0.min(q1).min(q2.min(q3)).min(q4);
    let high = p0.max(q1).max(q2.max(q3)).max(q4);
    [Interval::new(low.x, high.x), Interval::new(low.y, high.y), Interval::new(low.z, high.z)]
}

pub(super) fn join3(a: IntervalVector, b: IntervalVector) -> IntervalVector {
    std::array::from_fn(|i| a[i].join(b[i]))
}
