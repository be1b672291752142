//! Floating-point type of the engine.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// Floating-point type of the engine: `f32` for mixed precision, or `f64` for reference results.
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
    /// Positive infinity.
    const INFINITY: Self;
    /// Converts from `f64`, rounded to the nearest representable value.
    fn of(value: f64) -> Self;
    /// Converts to `f64` exactly.
    fn to_f64(self) -> f64;
    /// Exponential function, bitwise equal on every platform.
    fn exp(self) -> Self;
    /// Natural logarithm, bitwise equal on every platform.
    fn ln(self) -> Self;
    /// True if neither infinite nor NaN.
    fn is_finite(self) -> bool;
    /// Compares in a total order that includes NaN.
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

// `libm`, not `std`: results of `std` differ in the last bits between platforms.
impl_real!(f32, libm::expf, libm::logf);
impl_real!(f64, libm::exp, libm::log);
