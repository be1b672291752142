//! Fixed-point sums. Integer addition is associative, so totals do not depend on the order of frames, the
//! number of threads or the shards of a dataset.
//!
//! There are two formats. [`to_fixed`] returns an `i128` with 80 fraction bits. [`Quanta`] consist of an
//! `i64`, which almost always suffices and keeps loops vectorisable, and a carry.

/// Number of fraction bits of an `i128` total. The quantum is 2⁻⁸⁰ = 8.3e-25 and the range is ±1.4e14.
/// The smallest prior term is far larger than the quantum: 4e-15 for a million components.
pub const FRACTION_BITS: i32 = 80;

/// Converts a finite `f64` to fixed point, rounding to nearest with ties away from zero.
/// Values beyond ±2⁴⁶ saturate; NaN counts as zero (callers drop non-finite points first).
///
/// ```
/// use vbgs_studio::math::fixed::{from_fixed, to_fixed};
///
/// let values = [1e9, 1e-7, -1e9, 0.3];
/// let forwards: i128 = values.iter().map(|&v| to_fixed(v)).sum();
/// let backwards: i128 = values.iter().rev().map(|&v| to_fixed(v)).sum();
/// assert_eq!(forwards, backwards);
/// assert!((from_fixed(forwards) - 0.300_000_1).abs() < 1e-15);
/// ```
#[inline]
pub fn to_fixed(value: f64) -> i128 {
    let bits = value.to_bits();
    let biased = ((bits >> 52) & 0x7FF) as i32;
    if biased == 0 {
        return 0; // zero or denormal: far below the quantum
    }
    let mantissa = ((bits & ((1 << 52) - 1)) | (1 << 52)) as i128;
    // value = mantissa * 2^(biased - 1075)
    let shift = biased - 1075 + FRACTION_BITS;
    // A 53-bit mantissa shifted by 73 has 126 bits, the most that fit in an `i128` with a margin.
    let magnitude = if biased == 0x7FF || shift > 73 {
        // Half the range: two saturated values add without overflow.
        if value.is_nan() { 0 } else { i128::MAX / 2 }
    } else if shift >= 0 {
        mantissa << shift
    } else if shift >= -54 {
        // One extra bit is retained for rounding to nearest, halves away from zero.
        ((mantissa >> (-shift - 1)) + 1) >> 1
    } else {
        0
    };
    if value < 0.0 { -magnitude } else { magnitude }
}

/// Converts a fixed-point total to `f64`, rounded to nearest.
#[inline]
pub fn from_fixed(total: i128) -> f64 {
    // A power of two, so only the conversion of the total rounds.
    const QUANTUM: f64 = 1.0 / (1u128 << FRACTION_BITS) as f64;
    total as f64 * QUANTUM
}

/// Fixed-point number `high · 2⁶⁴ + low` in quanta; a quantum is the smallest step. The representation
/// is unique, so equal sums have equal bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quanta {
    /// Carry beyond 64 bits; almost always 0.
    pub high: i32,
    /// Low part, signed.
    pub low: i64,
}

/// Converts a value to quanta of 2^−`bits`, rounding to nearest with ties to even. Values beyond
/// 96 bits saturate; NaN counts as zero (callers drop non-finite points first).
#[inline(always)]
pub fn to_quanta(value: f64, bits: u32) -> Quanta {
    // A power of two, so scaling is exact.
    let scaled = value * (1u64 << bits) as f64;
    match round_small(scaled) {
        (low, true) => Quanta { high: 0, low },
        _ => to_many_quanta(scaled),
    }
}

/// Rounds to the nearest integer, ties to even. The returned flag is true if the magnitude of `scaled`
/// is below 2⁵¹; otherwise the integer is invalid. Contains no branches or calls, so that loops over it
/// are vectorised.
#[inline(always)]
pub fn round_small(scaled: f64) -> (i64, bool) {
    // Adding 1.5·2⁵² leaves the integer part of a small number in the low mantissa bits: neighbouring
    // numbers differ by 1 there, and negative summands do not change the exponent.
    const SHIFTER: f64 = 1.5 * (1u64 << 52) as f64;
    let quanta = (scaled + SHIFTER).to_bits().wrapping_sub(SHIFTER.to_bits());
    (quanta as i64, scaled.abs() < (1u64 << 51) as f64)
}

#[cold]
fn to_many_quanta(scaled: f64) -> Quanta {
    // One less than the full range, so that every value can be negated.
    const MOST: i128 = (i32::MAX as i128) << 64;
    let quanta = (scaled.round_ties_even() as i128).clamp(-MOST, MOST);
    let low = quanta as i64;
    Quanta { high: ((quanta - i128::from(low)) >> 64) as i32, low }
}

impl Quanta {
    /// Adds two values. The high part saturates on overflow.
    #[inline(always)]
    pub fn plus(self, other: Self) -> Self {
        let (low, overflowed) = self.low.overflowing_add(other.low);
        // Overflow occurs only between equal signs, in the direction of that sign.
        let carry = if !overflowed {
            0
        } else if other.low > 0 {
            1
        } else {
            -1
        };
        Self { high: self.high.saturating_add(other.high).saturating_add(carry), low }
    }

    /// Converts quanta of 2^−`bits` to `f64`, rounded to nearest.
    #[inline]
    pub fn value(self, bits: u32) -> f64 {
        let quanta = (i128::from(self.high) << 64) + i128::from(self.low);
        quanta as f64 * (1.0 / (1u64 << bits) as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn round_trip_is_exact_above_the_quantum(mantissa in -1e6f64..1e6, exponent in -26i32..20) {
            let value = mantissa * 2f64.powi(exponent);
            let back = from_fixed(to_fixed(value));
            let quantum = 2f64.powi(-FRACTION_BITS);
            prop_assert!((back - value).abs() <= quantum, "{value} -> {back}");
        }

        #[test]
        fn f32_values_of_usual_size_are_exact(value in -100f32..100.0) {
            prop_assume!(value.abs() > 1e-15);
            prop_assert_eq!(from_fixed(to_fixed(value as f64)), value as f64);
        }
    }

    proptest! {
        #[test]
        fn split_sums_are_exact(values in prop::collection::vec(-4e9f64..4e9, 1..60), bits in 30u32..50) {
            let mut sum = Quanta { high: 0, low: 0 };
            let mut exact = 0i128;
            for value in values {
                sum = sum.plus(to_quanta(value, bits));
                exact += (value * (1u64 << bits) as f64).round_ties_even() as i128;
            }
            prop_assert_eq!((i128::from(sum.high) << 64) + i128::from(sum.low), exact);
            prop_assert_eq!(sum.value(bits), exact as f64 / (1u64 << bits) as f64);
        }
    }

    #[test]
    fn quanta_round_to_even_and_saturate() {
        for (value, quanta) in [(0.5, 0), (1.5, 2), (-2.5, -2), (0.75, 1), (f64::NAN, 0)] {
            assert_eq!(to_quanta(value, 0), Quanta { high: 0, low: quanta }, "{value}");
        }
        assert_eq!(round_small(-3.0), (-3, true));
        assert!(!round_small(2f64.powi(51)).1);
        assert_eq!(to_quanta(f64::INFINITY, 36), Quanta { high: i32::MAX, low: 0 });
        assert_eq!(to_quanta(-1e300, 36), Quanta { high: -i32::MAX, low: 0 });
        let most = Quanta { high: i32::MAX, low: i64::MAX };
        assert_eq!(most.plus(Quanta { high: 0, low: 1 }), Quanta { high: i32::MAX, low: i64::MIN });
    }

    #[test]
    fn edges() {
        assert_eq!(to_fixed(0.0), 0);
        assert_eq!(to_fixed(f64::MIN_POSITIVE / 4.0), 0);
        assert_eq!(to_fixed(1.0), 1 << 80);
        assert_eq!(to_fixed(-1.0), -(1 << 80));
        assert_eq!(to_fixed(2f64.powi(-81)), 1);
        assert_eq!(to_fixed(2f64.powi(-82)), 0);
        assert_eq!(to_fixed(f64::NAN), 0);
        assert_eq!(to_fixed(2f64.powi(45)), 1 << 125);
        assert_eq!(to_fixed(2f64.powi(46)), i128::MAX / 2);
        assert!(to_fixed(f64::INFINITY) > to_fixed(1e13));
        assert!(to_fixed(-1e300) < to_fixed(-1e13));
    }
}
