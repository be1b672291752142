//! Arithmetic on eight pixels at a time.

use wide::bytemuck::cast;
use wide::{f32x8, i32x8};

/// Pixels handled at once.
pub(super) const LANES: usize = 8;

/// Adding and subtracting 1.5·2²³ rounds to the nearest integer, which then sits in the low bits.
const ROUND: f32 = 12_582_912.0;

/// Minimax polynomial of `2^f` on `[−½, ½]`, constant first; largest relative error 2.3e-7 in f32
/// (`rendering.md` (e)).
const EXP2: [f32; 6] =
    [1.000_000_1, 0.693_146_97, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647_2];

/// Smallest exponent of a normal `f32`.
pub(super) const EXP2_MIN: f32 = -126.0;

/// `2^x` for `x` from [`EXP2_MIN`] to 126; other lanes hold any bits, so the caller masks them.
#[inline(always)]
pub(super) fn exp2(x: f32x8) -> f32x8 {
    let shifted = x + f32x8::splat(ROUND);
    let f = x - (shifted - f32x8::splat(ROUND));
    let mut sum = f32x8::splat(EXP2[5]);
    for &coefficient in EXP2[..5].iter().rev() {
        sum = sum.mul_add(f, f32x8::splat(coefficient));
    }
    let exponent: i32x8 = cast::<f32x8, i32x8>(shifted) << 23;
    cast(cast::<f32x8, i32x8>(sum) + exponent)
}

/// Whether any lane of a mask is set.
#[inline(always)]
pub(super) fn any(mask: f32x8) -> bool {
    mask.to_bitmask() != 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exp2_is_right_to_three_units_in_the_last_place() {
        let mut worst = 0f64;
        for i in 0..200_000 {
            let x = EXP2_MIN + i as f32 * (252.0 / 200_000.0);
            let got = exp2(f32x8::splat(x)).to_array()[0];
            let want = f64::from(x).exp2();
            worst = worst.max((f64::from(got) / want - 1.0).abs());
        }
        assert!(worst < 3.0e-7, "{worst:e}");
    }
}
