//! Bounds on how stiff a potential is along rays, on all depths, directions and deflections at once.
//!
//! Along the ray ξ = r e the force's slope is ∂²W/∂r² = e·K e + 6 r C(e³) + 12 r² Q. With ξ = ρ (1, t) or ρ (t, 1), |t| ≤ 1 and ρ of
//! either sign, (1 + t²) times it is a polynomial of degree 3 in the depth, 3 in t and 2 in ρ, and lies between its least
//! and its greatest Bernstein ordinate. Boxes where these leave it open are halved.

use crate::curve::Curve;

/// What is known of a slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Growth {
    /// Everywhere above the margin.
    Positive,
    /// It is not, at this depth and deflection, m.
    Fails { depth_m: f64, xi: [f64; 2] },
    /// Near this depth the effort ended before it was decided, m.
    Undecided { depth_m: f64 },
}

/// Boxes that are looked at in one interval and chart.
const EFFORT: usize = 4096;

/// K₁₁, K₁₂, K₂₂, C (4), Q in powers of the interval's own coordinate, 0 to 1.
type Interval = [[f64; 4]; 8];

/// Whether ∂²W/∂r² > `margin` at all depths, in all directions, for |ξ| ≤ `range`.
pub(crate) fn growth(
    stiffness: &[Curve; 3],
    cubic: &[Curve; 4],
    quartic: &Curve,
    range: f64,
    margin: f64,
) -> Growth {
    let knots = quartic.knots();
    for (i, k) in knots.windows(2).enumerate() {
        let powers = |curve: &Curve| {
            let [a, b, c, d] = curve.ordinates()[i];
            [a, 3.0 * (b - a), 3.0 * (a - 2.0 * b + c), d - a - 3.0 * (c - b)]
        };
        let ([a, b, c], [p, q, r, s]) = (stiffness.each_ref().map(powers), cubic.each_ref().map(powers));
        let quartic = powers(quartic);
        // In the second chart the axes change places.
        for (swapped, of) in [(false, [a, b, c, p, q, r, s, quartic]), (true, [c, b, a, s, r, q, p, quartic])]
        {
            let depth_m = |u: f64| k[0] + u * (k[1] - k[0]);
            let xi = |t: f64, rho: f64| if swapped { [t * rho, rho] } else { [rho, t * rho] };
            match search(&of, range, margin) {
                Ok(()) => {}
                Err((u, Some([t, rho]))) => return Growth::Fails { depth_m: depth_m(u), xi: xi(t, rho) },
                Err((u, None)) => return Growth::Undecided { depth_m: depth_m(u) },
            }
        }
    }
    Growth::Positive
}

/// Ends of u, t and ρ.
type Cell = [[f64; 2]; 3];

/// Where it fails or stays open: u, and t and ρ if it fails.
fn search(of: &Interval, range: f64, margin: f64) -> Result<(), (f64, Option<[f64; 2]>)> {
    let mut open: Vec<Cell> = vec![[[0.0, 1.0], [-1.0, 1.0], [-range, range]]];
    for _ in 0..EFFORT {
        let Some(mut cell) = open.pop() else { return Ok(()) };
        // No farther than the disc at the least |t|.
        let nearest =
            if cell[1][0] <= 0.0 && cell[1][1] >= 0.0 { 0.0 } else { cell[1][0].abs().min(cell[1][1].abs()) };
        let reach = range / (1.0 + nearest * nearest).sqrt();
        if cell[2][0] > reach || cell[2][1] < -reach {
            continue;
        }
        cell[2] = cell[2].map(|rho| rho.clamp(-reach, reach));
        if least_ordinate(of, &cell, margin) > 0.0 {
            continue;
        }
        let [u, t, rho] = cell.map(|[low, high]| [low, 0.5 * (low + high), high]);
        for (u, t, rho) in (0..27).map(|i| (u[i % 3], t[i / 3 % 3], rho[i / 9])) {
            let reach = range / (1.0 + t * t).sqrt();
            let rho = rho.clamp(-reach, reach);
            let grows = least_ordinate(of, &[[u, u], [t, t], [rho, rho]], margin) > 0.0;
            if !grows {
                return Err((u, Some([t, rho])));
            }
        }
        let widths = [
            u[2] - u[0],
            (t[2] - t[0]) * 0.5,
            if range > 0.0 { (rho[2] - rho[0]) / (2.0 * range) } else { 0.0 },
        ];
        let axis = (0..3).max_by(|&a, &b| widths[a].total_cmp(&widths[b])).unwrap_or(0);
        let middle = 0.5 * (cell[axis][0] + cell[axis][1]);
        let mut other = cell;
        (cell[axis][1], other[axis][0]) = (middle, middle);
        open.extend([cell, other]);
    }
    open.pop().map_or(Ok(()), |cell| Err((0.5 * (cell[0][0] + cell[0][1]), None)))
}

/// Of (1 + t²)(∂²W/∂r² − margin) in a cell.
fn least_ordinate(of: &Interval, cell: &Cell, margin: f64) -> f64 {
    let mut least = f64::INFINITY;
    let (in_u, in_t) = (cubic_powers(cell[0]), cubic_powers(cell[1]));
    let [low, high] = cell[2];
    let in_rho = [[low, low * low], [0.5 * (low + high), low * high], [high, high * high]];
    for u in in_u {
        let at = |c: &[f64; 4]| c[0] * u[0] + c[1] * u[1] + c[2] * u[2] + c[3] * u[3];
        let [a, b, c, p, q, r, s, quartic] = of.each_ref().map(at);
        for [_, t, tt, ttt] in in_t {
            let square = 1.0 + tt;
            let flat = a + 2.0 * b * t + c * tt - margin * square;
            let cubic = 6.0 * (p + q * t + r * tt + s * ttt);
            for [rho, rho2] in in_rho {
                // A NaN must not pass.
                let value = flat + cubic * rho + 12.0 * quartic * square * rho2;
                least = if value < least || value.is_nan() { value } else { least };
            }
        }
    }
    least
}

/// Bernstein ordinates of 1, x, x², x³ as cubics between two ends: one row for each ordinate.
fn cubic_powers([a, b]: [f64; 2]) -> [[f64; 4]; 4] {
    [[a, a, a], [a, a, b], [a, b, b], [b, b, b]]
        .map(|[x, y, z]| [1.0, (x + y + z) / 3.0, (x * y + y * z + z * x) / 3.0, x * y * z])
}
