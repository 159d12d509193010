//! Numbers that the [`law`](crate::law) is written over: plain ones for the step, dual ones for derivatives, and, in the
//! engine, intervals for bounds.

use std::ops::{Add, Mul, Neg, Sub};

/// What the law's formulas need of a number.
pub trait Number:
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Neg<Output = Self>
    + Mul<f64, Output = Self>
    + Add<f64, Output = Self>
{
    /// A number without derivative or width.
    fn constant(x: f64) -> Self;
    /// The square root; of a number ≥ 0, its derivatives of one > 0.
    fn sqrt(self) -> Self;
    /// 1/x; of a number > 0.
    fn recip(self) -> Self;
    /// The greater of this and `x`.
    fn at_least(self, x: f64) -> Self;
    /// The slope of [`Number::at_least`]: 1 above `x`, 0 elsewhere.
    fn is_above(self, x: f64) -> Self;
    /// Σ n x for weights n ≥ 0 whose sum is 1.
    #[inline]
    fn blend(n: [Self; 3], x: [Self; 3]) -> Self {
        n[0] * x[0] + n[1] * x[1] + n[2] * x[2]
    }
}

impl Number for f64 {
    #[inline(always)]
    fn constant(x: f64) -> Self {
        x
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }

    #[inline(always)]
    fn recip(self) -> Self {
        1.0 / self
    }

    #[inline(always)]
    fn at_least(self, x: f64) -> Self {
        f64::max(self, x)
    }

    #[inline(always)]
    fn is_above(self, x: f64) -> Self {
        f64::from(u8::from(self > x))
    }
}

/// A value and its `N` partial derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dual<T, const N: usize> {
    /// The value.
    pub value: T,
    /// Its partial derivatives.
    pub partials: [T; N],
}

impl<T: Number, const N: usize> Dual<T, N> {
    /// The `i`-th variable, at `value`.
    #[inline]
    pub fn variable(value: T, i: usize) -> Self {
        let one = |k: usize| T::constant(if k == i { 1.0 } else { 0.0 });
        Dual { value, partials: std::array::from_fn(one) }
    }

    /// A function of this with this value and slope.
    #[inline]
    fn chain(self, value: T, slope: T) -> Self {
        Dual { value, partials: self.partials.map(|d| d * slope) }
    }

    #[inline]
    fn zip(self, other: Self, value: T, f: impl Fn(T, T) -> T) -> Self {
        let [mut a, b] = [self.partials, other.partials];
        a.iter_mut().zip(b).for_each(|(a, b)| *a = f(*a, b));
        Dual { value, partials: a }
    }
}

impl<T: Number, const N: usize> Add for Dual<T, N> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        self.zip(other, self.value + other.value, |a, b| a + b)
    }
}

impl<T: Number, const N: usize> Sub for Dual<T, N> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        self.zip(other, self.value - other.value, |a, b| a - b)
    }
}

impl<T: Number, const N: usize> Mul for Dual<T, N> {
    type Output = Self;
    #[inline]
    #[allow(clippy::suspicious_arithmetic_impl, reason = "the product rule adds")]
    fn mul(self, other: Self) -> Self {
        let (x, y) = (self.value, other.value);
        let product_rule = |dx: T, dy: T| Add::add(dx * y, x * dy);
        self.zip(other, x * y, product_rule)
    }
}

impl<T: Number, const N: usize> Neg for Dual<T, N> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.value, T::constant(-1.0))
    }
}

impl<T: Number, const N: usize> Mul<f64> for Dual<T, N> {
    type Output = Self;
    #[inline]
    fn mul(self, x: f64) -> Self {
        self.chain(self.value * x, T::constant(x))
    }
}

impl<T: Number, const N: usize> Add<f64> for Dual<T, N> {
    type Output = Self;
    #[inline]
    fn add(self, x: f64) -> Self {
        Dual { value: self.value + x, ..self }
    }
}

impl<T: Number, const N: usize> Number for Dual<T, N> {
    #[inline]
    fn constant(x: f64) -> Self {
        Dual { value: T::constant(x), partials: [T::constant(0.0); N] }
    }

    #[inline]
    fn sqrt(self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, root.recip() * 0.5)
    }

    #[inline]
    fn recip(self) -> Self {
        let r = self.value.recip();
        self.chain(r, -(r * r))
    }

    #[inline]
    fn at_least(self, x: f64) -> Self {
        self.chain(self.value.at_least(x), self.value.is_above(x))
    }

    #[inline]
    fn is_above(self, x: f64) -> Self {
        Dual { value: self.value.is_above(x), partials: [T::constant(0.0); N] }
    }

    #[inline]
    fn blend(n: [Self; 3], x: [Self; 3]) -> Self {
        let (weights, values) = (n.map(|n| n.value), x.map(|x| x.value));
        let partial = |i: usize| {
            let [_, b, c] = n.map(|n| n.partials[i]);
            // The weights' derivatives sum to 0.
            let turned = b * (values[1] - values[0]) + c * (values[2] - values[0]);
            T::blend(weights, x.map(|x| x.partials[i])) + turned
        };
        Dual { value: T::blend(weights, values), partials: std::array::from_fn(partial) }
    }
}
