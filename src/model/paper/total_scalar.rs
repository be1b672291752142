//! Number types of the totals: fixed point of 64 or 128 bits.
//!
//! The quantum of 64-bit totals is chosen per sum, so that the sums of a scene rarely overflow. If a
//! sum overflows, its high bits are stored in a separate limb. A value has only one such
//! representation, so totals can be compared bit by bit. Totals of 128 bits resolve 2⁻⁸⁰, below the
//! prior of 4e-15 that `f64` runs must resolve.

use crate::math::fixed::{Quanta, from_fixed, round_small, to_fixed, to_quanta};
use crate::model::conjugate::statistics::N_SUMS;

/// Number of fraction bits of every sum in 64-bit totals (`training.md`, Fixed point). Counts and
/// colours reach 1.3e8 before they overflow; second moments resolve a standard deviation of 6e-8.
const FRACTION_BITS: [u32; N_SUMS] = [36, 40, 40, 40, 48, 48, 48, 48, 48, 48, 36, 36, 36];

const SCALES: [f64; N_SUMS] = {
    let mut scales = [0.0; N_SUMS];
    let mut i = 0;
    // Constants cannot use iterators.
    while i < N_SUMS {
        scales[i] = (1u64 << FRACTION_BITS[i]) as f64;
        i += 1;
    }
    scales
};

pub(super) trait TotalScalar: Copy + Default + PartialOrd + Send + Sync {
    /// Adds `terms` to `sums`. Returns the increments of the sums' high limbs; `None` if all are zero.
    fn add(sums: &mut [Self; N_SUMS], terms: &[f64; N_SUMS]) -> Option<[i32; N_SUMS]>;
    /// True if a count rounds to zero in this number format.
    fn rounds_to_zero(count: f64) -> bool;
    /// Returns this sum as f64, given its high limb and its index in the order listed at [`N_SUMS`].
    fn value(self, high: i32, index: usize) -> f64;
}

impl TotalScalar for i64 {
    #[inline(always)]
    fn add(sums: &mut [i64; N_SUMS], terms: &[f64; N_SUMS]) -> Option<[i32; N_SUMS]> {
        let (mut added, mut is_plain) = ([0; N_SUMS], true);
        for i in 0..N_SUMS {
            let (quanta, is_small) = round_small(terms[i] * SCALES[i]);
            added[i] = sums[i].wrapping_add(quanta);
            // On overflow the sign differs from that of both terms.
            // Without short circuit: one branch after the loop decides for all sums.
            is_plain &= is_small & ((sums[i] ^ added[i]) & (quanta ^ added[i]) >= 0);
        }
        if is_plain {
            *sums = added;
            return None;
        }
        Some(add_with_carry(sums, terms)).filter(|limbs| *limbs != [0; N_SUMS])
    }

    #[inline(always)]
    fn rounds_to_zero(count: f64) -> bool {
        to_quanta(count, FRACTION_BITS[0]) == Quanta { high: 0, low: 0 }
    }

    #[inline]
    fn value(self, high: i32, index: usize) -> f64 {
        Quanta { high, low: self }.value(FRACTION_BITS[index])
    }
}

#[cold]
fn add_with_carry(sums: &mut [i64; N_SUMS], terms: &[f64; N_SUMS]) -> [i32; N_SUMS] {
    std::array::from_fn(|i| {
        let sum = Quanta { high: 0, low: sums[i] }.plus(to_quanta(terms[i], FRACTION_BITS[i]));
        sums[i] = sum.low;
        sum.high
    })
}

impl TotalScalar for i128 {
    #[inline]
    fn add(sums: &mut [i128; N_SUMS], terms: &[f64; N_SUMS]) -> Option<[i32; N_SUMS]> {
        let terms = terms.iter().map(|&term| to_fixed(term));
        // A sum beyond 2⁴⁷ units cannot stem from valid coordinates: it saturates, which merging detects.
        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum = sum.saturating_add(term));
        None
    }

    #[inline]
    fn rounds_to_zero(count: f64) -> bool {
        to_fixed(count) <= 0
    }

    #[inline]
    fn value(self, _: i32, _: usize) -> f64 {
        from_fixed(self)
    }
}
