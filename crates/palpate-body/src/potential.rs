//! The coupled law of a body: one potential W(δz, ξ) a test point (LAW 2), and its table for the step.

use crate::curve::{Curve, Derivatives, Extension};
use crate::error::{BodyError, Result};
use crate::growth::{Growth, growth};
use crate::law::{
    AtDepth, Coupled, CoupledRow, QUANTITIES, Reach, Symmetric, at_depth, coupled, coupled_alone,
    curvature_bounds, eigenvalues, in_space, moved,
};
use crate::response::Knots;
use glam::DVec3;

/// The potential of a test point and its friction: functions of δz, which [`law`](crate::law) sums with monomials of
/// ξ = (t₁·δ_t, t₂·δ_t).
///
/// So that forces are continuous where contact begins and ends, f_z must vanish with δz whatever ξ is: F and b begin with
/// value and slope 0, K, C and Q with slope 0. So that they are continuous past the last depth, b, K, C and Q end with
/// slope 0 and stay what they are there; F goes on with its curvature.
#[derive(Debug, Clone, PartialEq)]
pub struct Potential {
    /// t₁ and t₂: unit vectors at right angles to each other and to the test point's normal, in the body's frame.
    pub tangents: [DVec3; 2],
    /// F, J: the energy of a press straight in.
    pub press: Curve,
    /// b, N: the lateral force of a press straight in.
    pub offset: [Curve; 2],
    /// K₁₁, K₁₂, K₂₂, N/m: the stuck lateral stiffness.
    pub stiffness: [Curve; 3],
    /// C, N/m²: the coefficients of ξ₁³, ξ₁²ξ₂, ξ₁ξ₂², ξ₂³.
    pub cubic: [Curve; 4],
    /// Q, N/m³.
    pub quartic: Curve,
    /// μ(δz) ≥ 0.
    pub friction: Curve,
    /// κ₁₁, κ₁₂, κ₂₂, 1/m: how curved the surface is on the tool's scale, positive where it is convex. The way that friction counts
    /// follows from it ([`law::tool_motion`](crate::law::tool_motion)); all 0: the contact point's own. Under a ball within
    /// [`law::curvature_bounds`](crate::law::curvature_bounds).
    pub curvature: [f64; 3],
}

/// The coupled law of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct CoupledLaw {
    /// Up to which |ξ| the potentials were found, m; see [`Reach`] for how they go on.
    pub range_m: f64,
    /// One for each test point, all on the same knots.
    pub potentials: Vec<Potential>,
}

impl Potential {
    /// Its curves in the order of the law's quantities.
    pub fn curves(&self) -> [&Curve; QUANTITIES] {
        let ([b1, b2], [k1, k2, k3], [c1, c2, c3, c4]) = (&self.offset, &self.stiffness, &self.cubic);
        [&self.press, b1, b2, k1, k2, k3, c1, c2, c3, c4, &self.quartic, &self.friction]
    }

    /// Whether all that a body's potentials promise holds of this one, at a test point with this inward normal.
    ///
    /// # Errors
    /// What does not hold, and where.
    pub fn validate(&self, inward: DVec3, range_m: f64) -> Result<()> {
        self.check(inward, range_m).map_err(|(problem, hint)| BodyError::invalid("potential", problem, hint))
    }

    /// W, f_z and ∂W/∂ξ at a depth and a lateral deflection in its tangents, m. Not for the step.
    pub fn at(&self, depth: f64, xi: [f64; 2], range_m: f64) -> Coupled<f64> {
        let curves = self.curves();
        let value = curves.map(|c| c.value(depth));
        let slope = curves.map(|c| if depth < 0.0 { 0.0 } else { c.slope(depth) });
        coupled_alone(&AtDepth { value, slope }, xi, range_m)
    }
}

impl Potential {
    /// Of its curves, in the order of the law's quantities, on a surface that is not curved.
    pub fn from_curves(tangents: [DVec3; 2], curves: [Curve; QUANTITIES]) -> Self {
        let [press, b1, b2, k11, k12, k22, c111, c112, c122, c222, quartic, friction] = curves;
        Potential {
            tangents,
            press,
            offset: [b1, b2],
            stiffness: [k11, k12, k22],
            cubic: [c111, c112, c122, c222],
            quartic,
            friction,
            curvature: [0.0; 3],
        }
    }

    /// The same potential in other tangents of the same plane.
    ///
    /// # Errors
    /// Curves on different knots, which [`Potential::validate`] refuses too.
    pub fn seen_in(&self, tangents: [DVec3; 2]) -> Result<Self> {
        let turn = turn(&self.tangents, &tangents);
        let curves = self.curves();
        let knots = self.press.knots();
        if curves.iter().any(|c| c.knots() != knots) {
            return Err(BodyError::invalid(
                "potential",
                "its curves are on different knots",
                "bring them together",
            ));
        }
        let all: Vec<[[f64; QUANTITIES]; 4]> = (0..knots.len() - 1)
            .map(|i| std::array::from_fn(|j| turned(curves.map(|c| c.ordinates()[i][j]), turn)))
            .collect();
        let mut made = curves.map(Clone::clone);
        for (q, curve) in made.iter_mut().enumerate() {
            let ordinates: Vec<[f64; 4]> = all.iter().map(|row| row.map(|x| x[q])).collect();
            *curve = Curve::from_ordinates(knots, &ordinates, curve.extension())?;
        }
        Ok(Potential {
            curvature: turned_tensor(self.curvature, turn),
            ..Potential::from_curves(tangents, made)
        })
    }

    /// The eigenvalues of K at a depth, N/m, the smaller first.
    pub fn principal_stiffness(&self, depth: f64) -> [f64; 2] {
        eigenvalues(self.stiffness.each_ref().map(|k| k.value(depth)))
    }

    /// No stiffness in stick, in any direction of the tool's motion, is greater than this from depth 0 up to each knot, while
    /// |ξ| stays within the range: a bound on the greatest eigenvalue of W's Hessian in (δz, ξ), N/m.
    pub fn stiffness_bounds(&self, range_m: f64) -> Vec<f64> {
        let knots = self.press.knots();
        let pieces = self.curves().map(Curve::pieces);
        // Of [`PARTS`] parts of each interval, from left to right; the last, of no width, is the last knot from its right.
        let bound = |interval: usize, t: f64, h: f64| {
            hessian_bound(&pieces.each_ref().map(|p| p[interval].derivatives(t, h)), range_m)
        };
        let mut so_far = f64::NEG_INFINITY;
        let mut bounds: Vec<f64> = Vec::with_capacity(knots.len());
        for (i, k) in knots.windows(2).enumerate() {
            // The second derivative may jump at the knot.
            bounds.push(so_far.max(bound(i, 0.0, 0.0)));
            let h = (k[1] - k[0]) / f64::from(PARTS);
            so_far = (0..PARTS).map(|part| bound(i, h * f64::from(part), h)).fold(so_far, f64::max);
        }
        bounds.push(so_far.max(bound(knots.len() - 1, 0.0, 0.0)));
        bounds
    }
}

/// Parts of an interval that are bounded each for itself.
const PARTS: u32 = 8;

/// The greatest sizes of a potential's quantities, or of their derivatives, in the hull of some ordinates.
struct Sizes {
    press: f64,
    offset: f64,
    /// Of K's eigenvalues, and of their magnitudes.
    stiffest: f64,
    stiffness: f64,
    /// Of the symmetric tensor of third order, whose mixed components are C/3, three times each.
    cubic: f64,
    /// Of Q's magnitude, and of Q where it is above 0.
    quartic: f64,
    growing: f64,
}

impl Sizes {
    /// They are convex in the ordinates, and so greatest at one of them.
    fn of<const N: usize>(
        quantities: &[Derivatives; QUANTITIES],
        ordinates: impl Fn(&Derivatives) -> [f64; N],
    ) -> Self {
        let quantities = quantities.each_ref().map(ordinates);
        let most = |size: fn([f64; QUANTITIES]) -> f64| {
            (0..N).map(|i| size(quantities.map(|q| q[i]))).fold(f64::NEG_INFINITY, f64::max)
        };
        Sizes {
            press: most(|[f, ..]| f),
            offset: most(|[_, b1, b2, ..]| b1.hypot(b2)),
            stiffest: most(|[_, _, _, k1, k2, k3, ..]| eigenvalues([k1, k2, k3])[1]),
            stiffness: most(|[_, _, _, k1, k2, k3, ..]| {
                let [low, high] = eigenvalues([k1, k2, k3]);
                low.abs().max(high.abs())
            }),
            cubic: most(|[_, _, _, _, _, _, a, b, c, d, ..]| (a * a + (b * b + c * c) / 3.0 + d * d).sqrt()),
            quartic: most(|[.., q, _]| q.abs()),
            growing: most(|[.., q, _]| q.max(0.0)),
        }
    }
}

/// The greatest eigenvalue of W's Hessian while |ξ| ≤ r, for quantities that lie with their first two derivatives in the hulls of
/// these ordinates.
fn hessian_bound(quantities: &[Derivatives; QUANTITIES], r: f64) -> f64 {
    let value = Sizes::of(quantities, |d| d.value);
    let slope = Sizes::of(quantities, |d| d.slope);
    let bend = Sizes::of(quantities, |d| d.bend);
    let (r2, r3, r4) = (r * r, r * r * r, r * r * r * r);
    let normal =
        bend.press + bend.offset * r + 0.5 * bend.stiffness * r2 + bend.cubic * r3 + bend.quartic * r4;
    let across = slope.offset + slope.stiffness * r + 3.0 * slope.cubic * r2 + 4.0 * slope.quartic * r3;
    let lateral = value.stiffest + 6.0 * value.cubic * r + 12.0 * value.growing * r2;
    eigenvalues([normal, across, lateral])[1]
}

/// How a check of a potential went: what is wrong, and how to correct it.
type Checked = std::result::Result<(), (String, &'static str)>;

/// What curves may be off, in parts of their greatest ordinate.
const TOLERANCE: f64 = 1e-9;
/// The least that a lateral force must grow along a ray, in parts of the greatest stiffness.
const LEAST_GROWTH: f64 = 1e-6;

/// The most that a surface may be curved, 1/m.
const MOST_CURVED: f64 = 1e6;

/// The names of a potential's curves, as errors and tables give them.
pub const QUANTITY_NAMES: [&str; QUANTITIES] =
    ["F", "b1", "b2", "K11", "K12", "K22", "C111", "C112", "C122", "C222", "Q", "mu"];

impl Potential {
    /// What test point `t` promises of it.
    pub(crate) fn check_at(&self, t: usize, inward: DVec3, range_m: f64, radius_m: f64) -> Result<()> {
        self.check(inward, range_m)
            .and_then(|()| self.check_curvature(radius_m))
            .map_err(|(problem, hint)| BodyError::invalid(format!("test point {t}"), problem, hint))
    }

    fn check_curvature(&self, radius_m: f64) -> Checked {
        let ([low, high], [least, most]) = (eigenvalues(self.curvature), curvature_bounds(radius_m));
        let rounding = TOLERANCE * most;
        if low < least - rounding || high > most + rounding {
            let problem = format!("its curvature is {low:.1} to {high:.1} /m, the tool's {most:.1} /m");
            return Err((problem, "give no more than the tool's, and half of that in a hollow"));
        }
        Ok(())
    }

    /// All that a potential promises, as bounds on its whole range; `inward` is the unit normal of its test point.
    fn check(&self, inward: DVec3, range_m: f64) -> Checked {
        let [t1, t2] = self.tangents;
        // A sum, which a NaN gets through.
        let off = [t1.length() - 1.0, t2.length() - 1.0, t1.dot(t2), t1.dot(inward), t2.dot(inward)];
        let off: f64 = off.iter().map(|x| x.abs()).sum();
        if off.is_nan() || off > 1e-9 {
            return Err((
                format!("its tangents are {off:.1e} off unit vectors in the tangent plane"),
                "normalise them",
            ));
        }
        for (i, (curve, extension)) in self.curves().into_iter().zip(EXTENSIONS).enumerate() {
            let name = QUANTITY_NAMES[i];
            if curve.knots() != self.press.knots() {
                return Err((format!("{name} is on other knots than F"), "bring all onto the same knots"));
            }
            if curve.extension() != extension {
                let problem = format!("past its last knot {name} goes on {:?}", curve.extension());
                return Err((problem, "let F go on along its parabola, all else stay what it is"));
            }
            check_smooth(i, curve)?;
        }
        if let Some(k) = self.curvature.iter().find(|k| k.is_nan() || k.abs() > MOST_CURVED) {
            return Err((
                format!("its curvature is {k:e} /m"),
                "give 1/m: 20 is a ball of 50 mm, and 0 counts none",
            ));
        }
        self.check_press()?;
        self.check_growth(range_m)?;
        if self.friction.least_value() < 0.0 {
            return Err(("its friction coefficient is negative somewhere".into(), "give 0 or more"));
        }
        Ok(())
    }

    /// The press straight in pushes, and the more the deeper: F'' ≥ 0, which is linear in each interval.
    fn check_press(&self) -> Checked {
        let knots = self.press.knots();
        let bends = self.press.ordinates().iter().zip(knots.windows(2)).flat_map(|(b, k)| {
            let h = k[1] - k[0];
            let bend = |a: f64, b: f64, c: f64| 6.0 * (a - 2.0 * b + c) / (h * h);
            [(k[0], bend(b[0], b[1], b[2])), (k[1], bend(b[1], b[2], b[3]))]
        });
        let steepest = bends.clone().fold(0.0f64, |most, (_, bend)| most.max(bend.abs()));
        match bends.into_iter().find(|(_, bend)| *bend < -TOLERANCE * steepest) {
            Some((depth, bend)) => {
                let problem =
                    format!("the press force F' falls by {:.3} N/m at {:.3} mm", -bend, depth * 1e3);
                Err((problem, "give forces that do not decrease with depth"))
            }
            None => Ok(()),
        }
    }

    /// Lateral forces grow along every ray: K is positive definite, and C does not outweigh it and Q within the range. Beyond, the
    /// slope along a ray stays what it is at the rim.
    fn check_growth(&self, range_m: f64) -> Checked {
        let ordinates = self.stiffness.iter().flat_map(|k| k.ordinates().as_flattened());
        let margin = LEAST_GROWTH * ordinates.fold(0.0f64, |most, k| most.max(k.abs()));
        for range in [0.0, range_m] {
            match growth(&self.stiffness, &self.cubic, &self.quartic, range, margin) {
                Growth::Positive => {}
                Growth::Fails { depth_m, .. } if range == 0.0 => {
                    let problem = format!(
                        "its stiffness K is not positive definite at a depth of {:.3} mm",
                        depth_m * 1e3
                    );
                    return Err((problem, "smooth K over the depth, or raise it there"));
                }
                Growth::Fails { depth_m, xi: [x, y] } => {
                    let [d, x, y] = [depth_m, x, y].map(|x| x * 1e3);
                    let problem = format!(
                        "its lateral force does not grow along the ray to ({x:.3}, {y:.3}) mm at a depth of {d:.3} mm"
                    );
                    return Err((problem, "raise Q or lower C there, or shorten the lateral range"));
                }
                Growth::Undecided { depth_m } => {
                    let problem = format!(
                        "whether its lateral force grows along every ray can't be decided near a depth of {:.3} mm",
                        depth_m * 1e3
                    );
                    return Err((problem, "raise K or Q there: it is too near to nothing"));
                }
            }
        }
        Ok(())
    }
}

/// Slopes do not jump, and are 0 at both ends but for the press's last and μ's; F and b begin with 0.
fn check_smooth(quantity: usize, curve: &Curve) -> Checked {
    let name = QUANTITY_NAMES[quantity];
    let (knots, ordinates) = (curve.knots(), curve.ordinates());
    let largest = ordinates.as_flattened().iter().fold(0.0f64, |most, y| most.max(y.abs()));
    let zero = |x: f64| x.abs() <= TOLERANCE * largest;
    if quantity == QUANTITIES - 1 {
        return Ok(());
    }
    let ([first, second, ..], [.., before, last]) = (ordinates[0], ordinates[ordinates.len() - 1]);
    if quantity < 3 && !zero(first) {
        return Err((format!("{name} is {first} where the depth is 0"), "let F and b begin with 0"));
    }
    if !zero(second - first) {
        return Err((
            format!("{name} begins with a slope"),
            "let all begin with slope 0: forces must vanish with depth",
        ));
    }
    if quantity > 0 && !zero(last - before) {
        return Err((
            format!("{name} ends with a slope"),
            "let all but F end with slope 0: they stay what they are there",
        ));
    }
    for ((k, [.., c, d]), [a, b, ..]) in knots.windows(3).zip(ordinates).zip(&ordinates[1..]) {
        let (left, right) = (k[1] - k[0], k[2] - k[1]);
        let jump = (b - a) / right - (d - c) / left;
        if !zero(jump * left.min(right)) {
            let problem = format!("the slope of {name} jumps at a depth of {:.3} mm", k[1] * 1e3);
            return Err((problem, "make it smooth: its slope is part of the force"));
        }
    }
    Ok(())
}

/// The potentials laid out for the step.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Potentials {
    /// (test points × depth knots)
    rows: Vec<CoupledRow>,
    /// (test points)
    tangents: Vec<[DVec3; 2]>,
    /// (test points): κ in space, 1/m
    curvatures: Vec<Symmetric<f64>>,
    columns: usize,
    range_m: f64,
    curved: bool,
}

/// One test point's potential in one interval of δz.
#[derive(Debug, Clone, Copy)]
pub struct PotentialAt<'a> {
    /// The interval's powers.
    pub row: &'a CoupledRow,
    /// t₁ and t₂.
    pub tangents: &'a [DVec3; 2],
    /// κ in space, 1/m: see [`Potential::curvature`].
    pub curvature: &'a Symmetric<f64>,
}

const NO_ROW: CoupledRow = [[0.0; QUANTITIES]; 4];
const NO_TANGENTS: [DVec3; 2] = [DVec3::ZERO; 2];
const NO_CURVATURE: Symmetric<f64> = [0.0; 6];

impl Potentials {
    /// Lays out a law.
    ///
    /// # Errors
    /// What [`Potential`] promises and one does not keep; the place names the test point.
    pub fn new(law: &CoupledLaw) -> Result<(Knots, Self)> {
        let Some(first) = law.potentials.first() else {
            return Err(BodyError::invalid("potentials", "there is no test point", "give at least one"));
        };
        let knots = Knots::new(first.press.knots())?;
        let columns = knots.values().len();
        let mut table = Potentials { columns, range_m: law.range_m, ..Potentials::default() };
        for potential in &law.potentials {
            let pieces = potential.curves().map(Curve::pieces);
            table.rows.extend((0..columns).map(|i| {
                let mut row = NO_ROW;
                for (q, pieces) in pieces.iter().enumerate() {
                    for (power, c) in pieces[i].coefficients.into_iter().enumerate() {
                        row[power][q] = c;
                    }
                }
                row
            }));
            table.tangents.push(potential.tangents);
            table.curvatures.push(in_space(potential.curvature, potential.tangents));
            table.curved |= potential.curvature != [0.0; 3];
        }
        Ok((knots, table))
    }

    /// Whether there are none: the body's law is the decoupled one.
    #[inline]
    pub fn is_empty(&self) -> bool {
        self.rows.is_empty()
    }

    /// How many test points there are.
    pub fn len(&self) -> usize {
        self.tangents.len()
    }

    /// Up to which |ξ| the potentials were found, m.
    #[inline]
    pub fn range_m(&self) -> f64 {
        self.range_m
    }

    /// Whether a test point says that the surface is curved; then a copy of some of them does, too.
    #[inline]
    pub fn is_curved(&self) -> bool {
        self.curved
    }

    /// A test point's potential in an interval of the depth knots.
    ///
    /// # Real-time
    /// O(1), never panics: a test point that does not exist answers nothing.
    #[inline]
    pub fn at(&self, point: u32, interval: usize) -> PotentialAt<'_> {
        PotentialAt {
            row: self.rows.get(point as usize * self.columns + interval).unwrap_or(&NO_ROW),
            tangents: self.tangents.get(point as usize).unwrap_or(&NO_TANGENTS),
            curvature: self.curvatures.get(point as usize).unwrap_or(&NO_CURVATURE),
        }
    }

    /// Where the row of an interval is in a table of the same knots.
    #[inline]
    pub(crate) fn row(&self, point: usize, interval: usize) -> usize {
        point * self.columns + interval
    }

    /// The range alone.
    pub(crate) fn without_points(&self) -> Self {
        let Potentials { columns, range_m, curved, .. } = *self;
        Potentials { columns, range_m, curved, ..Potentials::default() }
    }

    /// Becomes a copy of these test points of `from`.
    pub(crate) fn copy(&mut self, from: &Potentials, points: &[u32]) {
        self.rows.clear();
        self.tangents.clear();
        self.curvatures.clear();
        self.curved = from.curved;
        if from.is_empty() {
            return;
        }
        for point in points.iter().map(|&p| p as usize) {
            self.rows.extend_from_slice(&from.rows[point * from.columns..(point + 1) * from.columns]);
            self.tangents.push(from.tangents[point]);
            self.curvatures.push(from.curvatures[point]);
        }
    }

    /// Bytes that a step may read.
    pub(crate) fn memory(&self) -> [&[u8]; 3] {
        [
            bytemuck::cast_slice(&self.rows),
            bytemuck::cast_slice(&self.tangents),
            bytemuck::cast_slice(&self.curvatures),
        ]
    }
}

impl PotentialAt<'_> {
    /// κ₁₁, κ₁₂, κ₂₂ in its tangents, 1/m.
    pub fn plane_curvature(&self) -> [f64; 3] {
        let [s, t] = *self.tangents;
        let of = |v: DVec3| DVec3::from_array(moved(self.curvature, v.to_array()));
        [s.dot(of(s)), s.dot(of(t)), t.dot(of(t))]
    }

    /// ξ of a lateral deflection.
    #[inline(always)]
    pub fn xi(&self, tangential: DVec3) -> [f64; 2] {
        self.tangents.map(|t| t.dot(tangential))
    }

    /// The quantities at the distance `t` from the interval's knot. A call of its own, so that they are found two at a time.
    #[inline(never)]
    pub fn at_depth(&self, t: f64) -> AtDepth<f64> {
        at_depth(self.row, t)
    }

    /// W at the distance `t` from the interval's knot, J.
    #[inline]
    pub fn energy(&self, t: f64, tangential: DVec3, reach: &Reach<f64>) -> f64 {
        coupled(&at_depth(self.row, t), self.xi(tangential), reach).energy
    }

    /// Powers of its quantities but μ, of a deflection ξ in other tangents: K and C as they look there.
    pub(crate) fn seen_from(&self, tangents: &[DVec3; 2]) -> CoupledRow {
        let turn = turn(self.tangents, tangents);
        self.row.map(|row| turned(row, turn))
    }
}

/// M of ξ = M η, for η in the other tangents.
fn turn(own: &[DVec3; 2], other: &[DVec3; 2]) -> [[f64; 2]; 2] {
    own.map(|t| other.map(|s| t.dot(s)))
}

/// A symmetric tensor [11, 12, 22] as it looks from tangents with this turn.
fn turned_tensor([k1, k2, k3]: [f64; 3], [[a, b], [c, d]]: [[f64; 2]; 2]) -> [f64; 3] {
    [
        a * a * k1 + 2.0 * a * c * k2 + c * c * k3,
        a * b * k1 + (a * d + b * c) * k2 + c * d * k3,
        b * b * k1 + 2.0 * b * d * k2 + d * d * k3,
    ]
}

/// A law's quantities as they look from tangents with this turn.
fn turned(
    [f, b1, b2, k1, k2, k3, c1, c2, c3, c4, q, mu]: [f64; QUANTITIES],
    [[a, b], [c, d]]: [[f64; 2]; 2],
) -> [f64; QUANTITIES] {
    let [k1, k2, k3] = turned_tensor([k1, k2, k3], [[a, b], [c, d]]);
    [
        f,
        a * b1 + c * b2,
        b * b1 + d * b2,
        k1,
        k2,
        k3,
        a * a * a * c1 + a * a * c * c2 + a * c * c * c3 + c * c * c * c4,
        3.0 * a * a * b * c1
            + (a * a * d + 2.0 * a * b * c) * c2
            + (b * c * c + 2.0 * a * c * d) * c3
            + 3.0 * c * c * d * c4,
        3.0 * a * b * b * c1
            + (b * b * c + 2.0 * a * b * d) * c2
            + (a * d * d + 2.0 * b * c * d) * c3
            + 3.0 * c * d * d * c4,
        b * b * b * c1 + b * b * d * c2 + b * d * d * c3 + d * d * d * c4,
        q,
        mu,
    ]
}

impl CoupledLaw {
    /// What every test point promises; `inward` are the normals there, `radius_m` that of the tool.
    pub(crate) fn check(&self, inward: &[DVec3], radius_m: f64) -> Result<()> {
        check_range(self.range_m)?;
        let mut all = self.potentials.iter().zip(inward).enumerate();
        all.try_for_each(|(t, (potential, u))| potential.check_at(t, *u, self.range_m, radius_m))
    }

    /// How many test points there are.
    pub fn len(&self) -> usize {
        self.potentials.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.potentials.is_empty()
    }
}

/// A lateral range that means something.
pub(crate) fn check_range(range_m: f64) -> Result<()> {
    if range_m > 1e-6 && range_m < 1.0 {
        return Ok(());
    }
    let problem = format!("the lateral range is {range_m} m");
    Err(BodyError::invalid("coupled law", problem, "give a length between 1e-6 and 1 m"))
}

/// How each of a potential's curves goes on past the last knot.
pub(crate) const EXTENSIONS: [Extension; QUANTITIES] = {
    let mut all = [Extension::Constant; QUANTITIES];
    all[0] = Extension::Quadratic;
    all
};
