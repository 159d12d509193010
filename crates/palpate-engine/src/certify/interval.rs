//! Intervals of real numbers, and bounds of polynomials: what the certificates are computed with.
//!
//! Ends are rounded to nearest, not outwards: a bound holds up to rounding, about 10⁻¹⁴ of the terms it is made of.

use glam::{DMat3, DVec3};
use palpate_body::Number;
use std::ops::{Add, Mul, Neg, Sub};

/// All numbers from `lo` to `hi`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Interval {
    pub lo: f64,
    pub hi: f64,
}

/// A vector whose components are intervals.
pub(crate) type IntervalVector = [Interval; 3];

impl Interval {
    pub const ZERO: Self = Self::point(0.0);
    pub const ONE: Self = Self::point(1.0);

    pub const fn new(lo: f64, hi: f64) -> Self {
        Interval { lo, hi }
    }

    pub const fn point(x: f64) -> Self {
        Interval { lo: x, hi: x }
    }

    /// From −x to x.
    pub fn around_zero(x: f64) -> Self {
        Interval { lo: -x, hi: x }
    }

    /// The least interval that holds all of `values`.
    #[inline]
    pub fn hull<const N: usize>(values: [f64; N]) -> Self {
        let empty = Interval { lo: f64::INFINITY, hi: f64::NEG_INFINITY };
        values.iter().fold(empty, |h, &v| Interval { lo: least(h.lo, v), hi: greatest(h.hi, v) })
    }

    /// The least interval that holds both.
    #[inline]
    pub fn join(self, other: Self) -> Self {
        Interval { lo: least(self.lo, other.lo), hi: greatest(self.hi, other.hi) }
    }

    /// What is in both; the nearer end where nothing is.
    #[inline]
    pub fn clip(self, lo: f64, hi: f64) -> Self {
        Interval { lo: self.lo.clamp(lo, hi), hi: self.hi.clamp(lo, hi) }
    }

    #[inline]
    pub fn square(self) -> Self {
        let (a, b) = (self.lo * self.lo, self.hi * self.hi);
        let least_square = if self.lo <= 0.0 && self.hi >= 0.0 { 0.0 } else { least(a, b) };
        Interval { lo: least_square, hi: greatest(a, b) }
    }

    /// Of what is not negative in it.
    #[inline]
    pub fn sqrt(self) -> Self {
        Interval { lo: self.lo.max(0.0).sqrt(), hi: self.hi.max(0.0).sqrt() }
    }

    /// Greatest magnitude.
    #[inline]
    pub fn magnitude(self) -> f64 {
        greatest(self.hi, -self.lo)
    }

    /// By a divisor that is nowhere negative; the whole line where it can be 0 and the dividend not.
    #[inline]
    pub fn per(self, divisor: Self) -> Self {
        if self.lo == 0.0 && self.hi == 0.0 {
            return Self::ZERO;
        }
        if divisor.lo <= 0.0 {
            return Interval {
                lo: if self.lo < 0.0 { f64::NEG_INFINITY } else { 0.0 },
                hi: if self.hi > 0.0 { f64::INFINITY } else { 0.0 },
            };
        }
        let (near, far) = (1.0 / divisor.lo, 1.0 / divisor.hi);
        Interval {
            lo: self.lo * if self.lo < 0.0 { near } else { far },
            hi: self.hi * if self.hi > 0.0 { near } else { far },
        }
    }
}

#[inline]
fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

#[inline]
fn greatest(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

/// 0 times anything is 0: an infinite end stands for a bound that is not known.
#[inline]
fn product(a: f64, b: f64) -> f64 {
    let p = a * b;
    if p.is_nan() { 0.0 } else { p }
}

impl Add for Interval {
    type Output = Self;
    #[inline]
    fn add(self, o: Self) -> Self {
        Interval { lo: self.lo + o.lo, hi: self.hi + o.hi }
    }
}

impl Sub for Interval {
    type Output = Self;
    #[inline]
    fn sub(self, o: Self) -> Self {
        Interval { lo: self.lo - o.hi, hi: self.hi - o.lo }
    }
}

impl Neg for Interval {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Interval { lo: -self.hi, hi: -self.lo }
    }
}

impl Mul for Interval {
    type Output = Self;
    #[inline]
    fn mul(self, o: Self) -> Self {
        let [a, b, c, d] =
            [product(self.lo, o.lo), product(self.lo, o.hi), product(self.hi, o.lo), product(self.hi, o.hi)];
        Interval { lo: least(least(a, b), least(c, d)), hi: greatest(greatest(a, b), greatest(c, d)) }
    }
}

impl Mul<f64> for Interval {
    type Output = Self;
    #[inline]
    fn mul(self, x: f64) -> Self {
        let (a, b) = (product(self.lo, x), product(self.hi, x));
        if x < 0.0 { Interval { lo: b, hi: a } } else { Interval { lo: a, hi: b } }
    }
}

impl Add<f64> for Interval {
    type Output = Self;
    #[inline]
    fn add(self, x: f64) -> Self {
        Interval { lo: self.lo + x, hi: self.hi + x }
    }
}

impl Number for Interval {
    #[inline]
    fn constant(x: f64) -> Self {
        Interval::point(x)
    }

    #[inline]
    fn sqrt(self) -> Self {
        Interval::sqrt(self)
    }

    #[inline]
    fn recip(self) -> Self {
        Interval::ONE.per(self)
    }

    #[inline]
    fn at_least(self, x: f64) -> Self {
        Interval { lo: greatest(self.lo, x), hi: greatest(self.hi, x) }
    }

    #[inline]
    fn is_above(self, x: f64) -> Self {
        Interval { lo: self.lo.is_above(x), hi: self.hi.is_above(x) }
    }

    /// The weights' sum is 1 though each has a range: what is left of it goes to the least values first, and
    /// to the greatest.
    fn blend(n: [Self; 3], x: [Self; 3]) -> Self {
        let lowest = |x: [f64; 3]| {
            let (mut left, mut sum) = (1.0, 0.0);
            let mut order = [0, 1, 2];
            order.sort_unstable_by(|&a: &usize, &b| x[a].total_cmp(&x[b]));
            for i in order {
                left -= n[i].lo;
                sum += product(n[i].lo, x[i]);
            }
            for i in order {
                let more = least(left, n[i].hi - n[i].lo);
                sum += product(more, x[i]);
                left -= more;
            }
            sum
        };
        Interval { lo: lowest(x.map(|x| x.lo)), hi: -lowest(x.map(|x| -x.hi)) }
    }
}

#[inline]
pub(crate) fn dot(a: IntervalVector, b: IntervalVector) -> Interval {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline]
pub(crate) fn scaled(a: IntervalVector, s: Interval) -> IntervalVector {
    a.map(|x| x * s)
}

#[inline]
pub(crate) fn sum<const N: usize>(terms: [IntervalVector; N]) -> IntervalVector {
    terms.into_iter().fold([Interval::ZERO; 3], |s, t| [s[0] + t[0], s[1] + t[1], s[2] + t[2]])
}

/// Its projection on the element.
#[inline]
pub(crate) fn flat([x, y, _]: IntervalVector) -> IntervalVector {
    [x, y, Interval::ZERO]
}

/// A matrix, by rows, times a vector.
#[inline]
pub(crate) fn applied(rows: &[IntervalVector; 3], v: IntervalVector) -> IntervalVector {
    rows.map(|row| dot(row, v))
}

/// a − b.
#[inline]
pub(crate) fn less(a: IntervalVector, b: IntervalVector) -> IntervalVector {
    std::array::from_fn(|i| a[i] - b[i])
}

/// v − û (û·v).
#[inline]
pub(crate) fn across(u: IntervalVector, v: IntervalVector) -> IntervalVector {
    less(v, scaled(u, dot(u, v)))
}

/// e·M e of a matrix by rows.
#[inline]
pub(crate) fn quadratic(m: &[IntervalVector; 3], e: IntervalVector) -> Interval {
    dot(e, applied(m, e))
}

/// A vector.
#[inline]
pub(crate) fn points(v: DVec3) -> IntervalVector {
    v.to_array().map(Interval::point)
}

/// A matrix, by rows.
#[inline]
pub(crate) fn rows(m: DMat3) -> [IntervalVector; 3] {
    [0, 1, 2].map(|i| points(m.row(i)))
}

/// The directions of the vectors in a rectangle, as components of unit vectors.
pub(crate) fn direction([x, y]: [Interval; 2]) -> [Interval; 2] {
    let along = |x: Interval, y: Interval| {
        let square = y.square();
        let at = |x: f64, y2: f64| {
            let r = (x * x + y2).sqrt();
            if r > 0.0 { x / r } else { 0.0 }
        };
        if x.lo <= 0.0 && x.hi >= 0.0 && square.lo == 0.0 {
            // Through the origin: to either side, if at all.
            return Interval::new(if x.lo < 0.0 { -1.0 } else { 0.0 }, if x.hi > 0.0 { 1.0 } else { 0.0 });
        }
        let low = at(x.lo, if x.lo > 0.0 { square.hi } else { square.lo });
        Interval::new(low, at(x.hi, if x.hi > 0.0 { square.lo } else { square.hi }))
    };
    [along(x, y), along(y, x)]
}

#[inline]
pub(crate) fn length(a: IntervalVector) -> Interval {
    (a[0].square() + a[1].square() + a[2].square()).sqrt()
}

/// Range of a quartic, given in powers of t, for t from `from` to `to`: the hull of its Bernstein ordinates there, which
/// is the range itself where it is monotone enough, and never less.
#[inline]
pub(crate) fn range([a, b, c, d, e]: [f64; 5], from: f64, to: f64) -> Interval {
    let (t, h) = (from, to - from);
    // Powers of (t − from)/h.
    let p0 = a + t * (b + t * (c + t * (d + t * e)));
    let p1 = (b + t * (2.0 * c + t * (3.0 * d + t * (4.0 * e)))) * h;
    let p2 = (c + t * (3.0 * d + t * (6.0 * e))) * (h * h);
    let p3 = (d + t * (4.0 * e)) * (h * h * h);
    let p4 = e * (h * h * h * h);
    Interval::hull([
        p0,
        p0 + 0.25 * p1,
        p0 + 0.5 * p1 + p2 * (1.0 / 6.0),
        p0 + 0.75 * p1 + 0.5 * p2 + 0.25 * p3,
        p0 + p1 + p2 + p3 + p4,
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensitivity::tests::random;

    #[test]
    fn bounds_hold_what_they_bound() {
        let mut random = random(3);
        let mut unit = || random() - 0.5;
        for _ in 0..2000 {
            let pair = |x: f64, y: f64| Interval::hull([x, y]);
            let (a, b) = (pair(unit(), unit()), pair(unit(), unit()));
            let inside = |i: Interval, s: f64| i.lo + (i.hi - i.lo) * (s + 0.5);
            let (x, y) = (inside(a, unit()), inside(b, unit()));
            let holds = |i: Interval, v: f64| i.lo - 1e-12 <= v && v <= i.hi + 1e-12;
            assert!(holds(a + b, x + y) && holds(a - b, x - y) && holds(a * b, x * y));
            assert!(holds(a.square(), x * x) && holds(-a, -x) && holds(a * -0.3, x * -0.3));
            assert!(holds(a.join(b), x) && x.abs() <= a.magnitude());
            let positive = b + Interval::point(0.6);
            assert!(holds(a.per(positive), x / (y + 0.6)));
            let p = [unit(), unit(), unit(), unit(), unit()];
            let (from, to) = (unit(), unit() + 1.0);
            let t = from + (to - from) * (unit() + 0.5);
            let value = p.iter().rev().fold(0.0, |sum, c| sum * t + c);
            assert!(holds(range(p, from, to), value));
        }
        // Exact where it is monotone, and at a point.
        assert_eq!(range([1.0, 2.0, 3.0, 0.0, 0.0], 0.0, 2.0), Interval::new(1.0, 17.0));
        assert_eq!(range([1.0, 2.0, 3.0, 4.0, 5.0], 1.0, 1.0), Interval::point(15.0));
        assert_eq!(Interval::ZERO.per(Interval::ZERO), Interval::ZERO);
    }
}
