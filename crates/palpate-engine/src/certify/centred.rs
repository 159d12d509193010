//! The mean-value form as a number: a quantity over a cell by its value in the middle and its derivatives in
//! the cell, which bound it closer, the smaller the cell is, than operations on intervals alone.

use super::interval::Interval;
use palpate_body::Number;
use std::array::from_fn;
use std::ops::{Add, Mul, Neg, Sub};

/// What extends a cell: two coordinates of the place, and depth, azimuth and deflection.
pub(super) const EXTENTS: usize = 5;

/// A quantity that is continuous over a cell, and smooth but for kinks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Centred {
    middle: f64,
    /// Over the cell.
    pub value: Interval,
    /// By the place's coordinates, which begin with the cell's corners at (⅔, −⅓), (−⅓, ⅔) and (−⅓, −⅓), and
    /// by what else extends it, each from −1 to 1.
    slopes: [Interval; EXTENTS],
}

impl Centred {
    fn new(middle: f64, value: Interval, slopes: [Interval; EXTENTS]) -> Self {
        let [a, b, rest @ ..] = slopes;
        let rest: f64 = rest.iter().map(|d| d.magnitude()).sum();
        let third = (a + b) * (-1.0 / 3.0);
        let place = (third + a).join(third + b).join(third);
        let (lo, hi) = ((middle + place.lo - rest).max(value.lo), (middle + place.hi + rest).min(value.hi));
        // Both hold it; rounding must not empty what they have in common.
        Centred {
            middle,
            value: if lo <= hi { Interval::new(lo, hi) } else { Interval::new(hi, lo) },
            slopes,
        }
    }

    /// What has these values at the cell's corners, between which it is linear.
    pub fn at_corners([a, b, c]: [f64; 3]) -> Self {
        let mut slopes = [Interval::ZERO; EXTENTS];
        (slopes[0], slopes[1]) = (Interval::point(a - c), Interval::point(b - c));
        Centred { middle: (a + b + c) / 3.0, value: Interval::hull([a, b, c]), slopes }
    }

    /// The `extent`-th of what else extends the cell.
    pub fn variable([low, high]: [f64; 2], extent: usize) -> Self {
        let half = Interval::point(0.5 * (high - low));
        Self::turning(0.5 * (low + high), Interval::new(low, high), extent, half)
    }

    /// A function of one of them alone, with this slope by it.
    pub fn turning(middle: f64, value: Interval, extent: usize, slope: Interval) -> Self {
        Centred { middle, value, slopes: from_fn(|i| if i == extent { slope } else { Interval::ZERO }) }
    }

    fn chain(self, middle: f64, value: Interval, slope: Interval) -> Self {
        Self::new(middle, value, self.slopes.map(|d| d * slope))
    }
}

impl Add for Centred {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        Self::new(self.middle + o.middle, self.value + o.value, from_fn(|i| self.slopes[i] + o.slopes[i]))
    }
}

impl Sub for Centred {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        Self::new(self.middle - o.middle, self.value - o.value, from_fn(|i| self.slopes[i] - o.slopes[i]))
    }
}

impl Neg for Centred {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Centred { middle: -self.middle, value: -self.value, slopes: self.slopes.map(|d| -d) }
    }
}

impl Mul for Centred {
    type Output = Self;
    #[inline]
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
    fn mul(self, o: Self) -> Self {
        let slopes = from_fn(|i| self.slopes[i] * o.value + self.value * o.slopes[i]);
        Self::new(self.middle * o.middle, self.value * o.value, slopes)
    }
}

impl Mul<f64> for Centred {
    type Output = Self;
    #[inline]
    fn mul(self, x: f64) -> Self {
        Centred { middle: self.middle * x, value: self.value * x, slopes: self.slopes.map(|d| d * x) }
    }
}

impl Add<f64> for Centred {
    type Output = Self;
    #[inline]
    fn add(self, x: f64) -> Self {
        Centred { middle: self.middle + x, value: self.value + x, ..self }
    }
}

impl Number for Centred {
    fn constant(x: f64) -> Self {
        Centred { middle: x, value: Interval::point(x), slopes: [Interval::ZERO; EXTENTS] }
    }

    #[inline]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(self.middle.sqrt(), root, root.recip() * 0.5)
    }

    #[inline]
    fn recip(self) -> Self {
        let r = self.value.recip();
        self.chain(self.middle.recip(), r, -r.square())
    }

    #[inline]
    fn at_least(self, x: f64) -> Self {
        self.chain(self.middle.at_least(x), self.value.at_least(x), self.value.is_above(x))
    }

    /// Where it jumps no derivative bounds it.
    #[inline]
    fn is_above(self, x: f64) -> Self {
        let value = self.value.is_above(x);
        let jumps = value.lo < value.hi;
        let slope = if jumps { Interval::new(f64::NEG_INFINITY, f64::INFINITY) } else { Interval::ZERO };
        Centred { middle: self.middle.is_above(x), value, slopes: [slope; EXTENTS] }
    }

    fn blend(n: [Self; 3], x: [Self; 3]) -> Self {
        let (weights, [from_1, from_2]) = (n.map(|n| n.value), [x[1] - x[0], x[2] - x[0]]);
        // The weights' derivatives sum to 0.
        let slopes = from_fn(|i| {
            Interval::blend(weights, x.map(|x| x.slopes[i]))
                + n[1].slopes[i] * from_1.value
                + n[2].slopes[i] * from_2.value
        });
        let middle = f64::blend(n.map(|n| n.middle), x.map(|x| x.middle));
        Self::new(middle, Interval::blend(weights, x.map(|x| x.value)), slopes)
    }
}
