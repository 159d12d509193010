//! One curve of an element's three nodes, and bounds of its blends over a range of deflections.

use super::interval::{Interval, range};

/// The corners of a part of an element: three times three area coordinates.
pub(crate) type Corners = [[f64; 3]; 3];

/// The same curve of three nodes, on shared knots.
#[derive(Debug, Clone)]
pub(crate) struct Curves {
    /// Deflections, m; the last piece goes on without end.
    knots: Vec<f64>,
    /// Of each piece: the powers of each node's curve, in the distance from the knot, (knots × 3 × 4).
    powers: Vec<[[f64; 4]; 3]>,
    /// And of its integral, (knots × 3 × 5).
    pub integrals: Vec<[[f64; 5]; 3]>,
    /// Which power of a deflection near 0 all three begin with.
    order: usize,
}

/// A node's powers and the integral up to the knot.
pub(crate) type Row = ([f64; 4], f64);

impl Curves {
    /// `rows` of each piece and node.
    pub fn new(knots: &[f64], rows: Vec<[Row; 3]>) -> Self {
        let powers: Vec<_> = rows.iter().map(|r| r.map(|(p, _)| p)).collect();
        let integrals = rows
            .iter()
            .map(|r| r.map(|([a, b, c, d], integral)| [integral, a, b * 0.5, c * (1.0 / 3.0), d * 0.25]));
        // Rounding must not hide that a curve begins flat.
        let flat = |p: &[f64; 4]| p[1].abs() * knots.get(1).copied().unwrap_or(1.0) < 1e-12 * p[2].abs();
        let order = if powers.first().is_some_and(|p| p.iter().all(flat)) { 2 } else { 1 };
        Curves { knots: knots.to_vec(), integrals: integrals.collect(), powers, order }
    }

    /// The pieces that meet a range, with the part of each that does, in distances from its knot.
    pub fn pieces(&self, [lo, hi]: [f64; 2]) -> impl Iterator<Item = (usize, f64, f64)> + '_ {
        let first = self.knots.iter().skip(1).take_while(|&&k| k <= lo).count();
        (first..self.knots.len()).map_while(move |i| {
            let (knot, next) = (self.knots[i], self.knots.get(i + 1).copied().unwrap_or(f64::INFINITY));
            (i == first || knot < hi).then(|| (i, (lo - knot).max(0.0), hi.min(next) - knot))
        })
    }

    /// One node's blend at a deflection ≥ 0.
    pub fn value(&self, n: [f64; 3], at: f64) -> f64 {
        self.pieces([at; 2]).next().map_or(0.0, |(i, t, _)| {
            let [a, b, c, d] = mixed(n, &self.powers[i]);
            a + t * (b + t * (c + t * d))
        })
    }

    /// Of a curve that never falls.
    pub fn rising(&self, corners: &Corners, [lo, hi]: [f64; 2]) -> Interval {
        Interval::new(
            Interval::hull(corners.map(|n| self.value(n, lo))).lo,
            Interval::hull(corners.map(|n| self.value(n, hi))).hi,
        )
    }

    /// The hull, over the pieces that meet `span`, of what `of` says of piece, and from where to where.
    fn over(&self, span: [f64; 2], mut of: impl FnMut(usize, f64, f64) -> Interval) -> Interval {
        let mut pieces = self.pieces(span);
        let first = pieces.next().map_or(Interval::ZERO, |(i, s, e)| of(i, s, e));
        pieces.fold(first, |hull, (i, s, e)| hull.join(of(i, s, e)))
    }

    /// Values.
    pub fn hull(&self, corners: &Corners, span: [f64; 2]) -> Interval {
        self.over(span, |i, s, e| {
            join(corners.map(|n| {
                let [a, b, c, d] = mixed(n, &self.powers[i]);
                range([a, b, c, d, 0.0], s, e)
            }))
        })
    }

    /// Values less s (δ − `from`), for a slope s in an interval: in one polynomial, since both grow with the deflection.
    pub fn above_line(&self, corners: &Corners, span: [f64; 2], slope: Interval, from: f64) -> Interval {
        self.over(span, |i, s, e| {
            let before = self.knots[i] - from;
            let of = |n: [f64; 3], slope: f64| {
                let [a, b, c, d] = mixed(n, &self.powers[i]);
                range([a - slope * before, b - slope, c, d, 0.0], s, e)
            };
            join(corners.map(|n| of(n, slope.lo).join(of(n, slope.hi))))
        })
    }

    /// Slopes.
    pub fn slope(&self, corners: &Corners, span: [f64; 2]) -> Interval {
        self.over(span, |i, s, e| {
            join(corners.map(|n| {
                let [_, b, c, d] = mixed(n, &self.powers[i]);
                range([b, 2.0 * c, 3.0 * d, 0.0, 0.0], s, e)
            }))
        })
    }

    /// Σ g f, for a gradient `g` of the area coordinates.
    pub fn gradient(&self, g: [f64; 3], span: [f64; 2]) -> Interval {
        self.over(span, |i, s, e| {
            let [a, b, c, d] = mixed(g, &self.powers[i]);
            range([a, b, c, d, 0.0], s, e)
        })
    }

    /// Value by deflection, of a curve that begins at 0. At x in a span from s to e it is the mean of that at s, with the
    /// weight s/x, and of slopes between; so at most 1 − s/e of it is slopes.
    pub fn secant(&self, corners: &Corners, [from, to]: [f64; 2]) -> Interval {
        let slopes = self.slope(corners, [from, to]);
        if from <= 0.0 {
            return slopes;
        }
        let first = Interval::hull(corners.map(|n| self.value(n, from) / from));
        let share = Interval::new(0.0, 1.0 - from / to);
        let end = |first: f64, slope: f64| {
            Interval::new(first, first) + (Interval::new(slope, slope) - Interval::new(first, first)) * share
        };
        Interval::new(end(first.lo, slopes.lo).lo, end(first.hi, slopes.hi).hi)
    }

    /// Slope less secant, of a curve that begins at 0: of the difference's own polynomial.
    pub fn bend(&self, corners: &Corners, span: [f64; 2]) -> Interval {
        self.over(span, |i, s, e| {
            let knot = self.knots[i];
            join(corners.map(|n| {
                let [a, b, c, d] = mixed(n, &self.powers[i]);
                if i == 0 {
                    return range([0.0, c, 2.0 * d, 0.0, 0.0], s, e);
                }
                let p = [b * knot - a, 2.0 * c * knot, c + 3.0 * d * knot, 2.0 * d, 0.0];
                range(p, s, e).per(Interval::new(knot + s, knot + e))
            }))
        })
    }

    /// A force over a part of one piece, with as many powers of the deflection taken out as near 0 all three nodes' have in
    /// common.
    pub fn force(&self, corners: &Corners, piece: usize, from: f64, to: f64) -> (Interval, usize) {
        let reaction = if piece == 0 { self.order } else { 0 };
        let of = |n| {
            let p = mixed(n, &self.powers[piece]);
            let at = |i: usize| p.get(i + reaction).copied().unwrap_or(0.0);
            range([at(0), at(1), at(2), at(3), 0.0], from, to)
        };
        (join(corners.map(of)), reaction)
    }

    /// Σ g F / f for two gradients, m; near 0 with the power in common taken out.
    pub fn energy_gradient(&self, corners: &Corners, g: [[f64; 3]; 2], span: [f64; 2]) -> [Interval; 2] {
        let mut hulls: Option<[Interval; 2]> = None;
        for (i, s, e) in self.pieces(span) {
            let forces = corners.map(|n| mixed(n, &self.powers[i]));
            let energies = g.map(|g| mixed(g, &self.integrals[i]));
            let (force, energies) = match (i, self.order) {
                (0, 1) => (
                    forces.map(|[_, b, c, d]| range([b, c, d, 0.0, 0.0], s, e)),
                    energies.map(|[_, _, c, d, f]| Interval::new(s, e) * range([c, d, f, 0.0, 0.0], s, e)),
                ),
                (0, _) => (
                    forces.map(|[_, _, c, d]| range([c, d, 0.0, 0.0, 0.0], s, e)),
                    energies.map(|[_, _, _, d, f]| Interval::new(s, e) * range([d, f, 0.0, 0.0, 0.0], s, e)),
                ),
                _ => (
                    forces.map(|[a, b, c, d]| range([a, b, c, d, 0.0], s, e)),
                    energies.map(|p| range(p, s, e)),
                ),
            };
            let force = join(force);
            let ratios = energies.map(|energy| energy.per(force));
            hulls = Some(hulls.map_or(ratios, |h| [h[0].join(ratios[0]), h[1].join(ratios[1])]));
        }
        hulls.unwrap_or([Interval::ZERO; 2])
    }

    /// The last knot.
    pub fn end(&self) -> f64 {
        self.knots.last().copied().unwrap_or(0.0)
    }

    /// Where one node's rising blend reaches `value`, up to `most`.
    pub fn root(&self, n: [f64; 3], value: f64, most: f64) -> f64 {
        let (mut lo, mut hi) = (0.0, most);
        for _ in 0..40 {
            let middle = 0.5 * (lo + hi);
            if self.value(n, middle) < value { lo = middle } else { hi = middle }
        }
        hi
    }

    /// The same of the last of the three nodes, also past the end; infinite where one never does.
    pub fn reaches(&self, value: f64) -> f64 {
        let nodes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let end = self.end();
        let of = |n: [f64; 3]| {
            let short = value - self.value(n, end);
            let slope = self.powers.last().map_or(0.0, |p| mixed(n, p)[1]);
            match short {
                _ if short <= 0.0 => self.root(n, value, end),
                _ if slope > 0.0 => end + short / slope,
                _ => f64::INFINITY,
            }
        };
        Interval::hull(nodes.map(of)).hi
    }
}

fn join(parts: [Interval; 3]) -> Interval {
    parts[0].join(parts[1]).join(parts[2])
}

/// Σ n × row.
#[inline]
fn mixed<const N: usize>(n: [f64; 3], rows: &[[f64; N]; 3]) -> [f64; N] {
    std::array::from_fn(|i| n[0] * rows[0][i] + n[1] * rows[1][i] + n[2] * rows[2][i])
}
