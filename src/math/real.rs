//! The two floating-point types the engine runs in.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// `f32` (hot loops of the mixed path) or `f64` (the oracle).
pub trait Real:
    Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + Sum
{
    /// The additive identity.
    const ZERO: Self;
    /// The multiplicative identity.
    const ONE: Self;
    /// Positive infinity, above every number.
    const INFINITY: Self;
    /// Rounds to the nearest representable value.
    fn of(value: f64) -> Self;
    /// Widens (or keeps) the value.
    fn to_f64(self) -> f64;
    /// Exponential function, equal bits on every platform.
    fn exp(self) -> Self;
    /// Natural logarithm, equal bits on every platform.
    fn ln(self) -> Self;
    /// Neither infinite nor NaN.
    fn is_finite(self) -> bool;
    /// Total order in which NaN has a place.
    fn total_cmp(&self, other: &Self) -> std::cmp::Ordering;
}

macro_rules! impl_real {
    ($t:ty, $exp:path, $ln:path) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const INFINITY: Self = <$t>::INFINITY;
            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                self as f64
            }
            #[inline(always)]
            fn exp(self) -> Self {
                $exp(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                $ln(self)
            }
            #[inline(always)]
            fn is_finite(self) -> bool {
                self.is_finite()
            }
            #[inline(always)]
            fn total_cmp(&self, other: &Self) -> std::cmp::Ordering {
                <$t>::total_cmp(self, other)
            }
        }
    };
}

// `libm`, not `std`: what `std` calls differs in its last bits from system to system.
impl_real!(f32, libm::expf, libm::logf);
impl_real!(f64, libm::exp, libm::log);
