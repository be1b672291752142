//! Number types of a component's sums: 32-bit integers in units of 2⁻¹⁵, f32 or f64.

use crate::math::real::Real;
use crate::model::scene::bounds::{self, Slack};
use crate::model::scene::state::{QUANTUM, StoredSums, WIDE_POINTS, WideRow};
use crate::model::scene::sums::N_SUMS;

/// Number type of a component's sums.
pub trait SumScalar: Copy + Default + PartialEq + Send + Sync + 'static {
    /// Number type of the terms of one point.
    type Term: Real;
    /// Number of points from which a row spills into a wide one. A row holds twice as many.
    const FULL: f64;
    /// Tolerance for rounding of sums.
    const SLACK: Slack;
    /// Rounds a term to this type.
    fn of(term: Self::Term) -> Self;
    /// Rounds a sum to this type.
    fn of_sum(sum: f64) -> Self;
    /// Converts a sum of whole quanta.
    fn of_quanta(quanta: i32) -> Self;
    /// Returns the difference from an earlier value, in whole quanta.
    fn since(self, before: Self) -> i32;
    /// Adds two sums; integers wrap.
    fn plus(self, other: Self) -> Self;
    /// Returns the value of a sum.
    fn value(self) -> f64;
    /// Converts rows to checkpoint form.
    fn stored(rows: Vec<[Self; N_SUMS]>, wide: Vec<WideRow>) -> StoredSums;
    /// Converts rows from checkpoint form; `None` if they have another type.
    fn restored(sums: StoredSums) -> Option<(Vec<[Self; N_SUMS]>, Vec<WideRow>)>;
}

/// Integer sums are independent of the order of terms. Terms are within ±7.84, which takes 19 bits.
impl SumScalar for i32 {
    type Term = f32;
    // Twice as many terms of 7.84, the maximum, are 2.105·10⁹ quanta: just below 2³¹.
    const FULL: f64 = WIDE_POINTS as f64;
    const SLACK: Slack = bounds::MIXED;

    #[inline(always)]
    fn of(term: f32) -> Self {
        /// Added to a number below 2²², it leaves the nearest integer, ties to even, in the low bits.
        const SHIFTER: f32 = 1.5 * (1 << 23) as f32;
        (term * QUANTA + SHIFTER).to_bits().wrapping_sub(SHIFTER.to_bits()) as i32
    }

    fn of_sum(sum: f64) -> Self {
        (sum / QUANTUM).round_ties_even() as i32
    }

    #[inline(always)]
    fn of_quanta(quanta: i32) -> Self {
        quanta
    }

    #[inline(always)]
    fn since(self, before: Self) -> i32 {
        self.wrapping_sub(before)
    }

    #[inline(always)]
    fn plus(self, other: Self) -> Self {
        self.wrapping_add(other)
    }

    #[inline(always)]
    fn value(self) -> f64 {
        f64::from(self) * QUANTUM
    }

    fn stored(rows: Vec<[Self; N_SUMS]>, wide: Vec<WideRow>) -> StoredSums {
        StoredSums::Mixed { rows, wide }
    }

    fn restored(sums: StoredSums) -> Option<(Vec<[Self; N_SUMS]>, Vec<WideRow>)> {
        match sums {
            StoredSums::Mixed { rows, wide } => Some((rows, wide)),
            StoredSums::F32(_) | StoredSums::F64(_) => None,
        }
    }
}

macro_rules! plain_sum_scalar {
    ($t:ty, $stored:ident, $slack:ident) => {
        impl SumScalar for $t {
            type Term = $t;
            // Floats do not overflow; f32 sums stagnate from 2²⁴ points on instead.
            const FULL: f64 = f64::INFINITY;
            const SLACK: Slack = bounds::$slack;

            #[inline(always)]
            fn of(term: $t) -> Self {
                term
            }

            fn of_sum(sum: f64) -> Self {
                sum as $t
            }

            fn of_quanta(quanta: i32) -> Self {
                (f64::from(quanta) * QUANTUM) as $t
            }

            fn since(self, before: Self) -> i32 {
                (f64::from(self - before) / QUANTUM).round_ties_even() as i32
            }

            #[inline(always)]
            fn plus(self, other: Self) -> Self {
                self + other
            }

            #[inline(always)]
            fn value(self) -> f64 {
                self.into()
            }

            fn stored(rows: Vec<[Self; N_SUMS]>, _: Vec<WideRow>) -> StoredSums {
                StoredSums::$stored(rows)
            }

            fn restored(sums: StoredSums) -> Option<(Vec<[Self; N_SUMS]>, Vec<WideRow>)> {
                match sums {
                    StoredSums::$stored(rows) => Some((rows, Vec::new())),
                    _ => None,
                }
            }
        }
    };
}

plain_sum_scalar!(f32, F32, F32);
plain_sum_scalar!(f64, F64, F64);

/// Quanta per unit of the integer sums.
const QUANTA: f32 = (1.0 / QUANTUM) as f32;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quanta_round_to_nearest() {
        for x in [0.1f32, -0.7, 3.999, -4.0, 1e-6] {
            assert!((i32::of(x).value() - f64::from(x)).abs() <= 0.5 / 32768.0 + 1e-7, "{x}");
        }
    }
}
