//! Exponential of eight lanes at a time.

use crate::math::simd::Vector;

/// Adding and subtracting 1.5·2²³ rounds to the nearest integer, whose bits end up in the low mantissa.
const ROUND: f32 = 12_582_912.0;

/// Minimax polynomial of `2^f` on `[−½, ½]`, constant first. Maximum relative error in f32: 2.3e-7
/// (`rendering.md`, CPU renderer).
const EXP2: [f32; 6] =
    [1.000_000_1, 0.693_146_97, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647_2];

/// Smallest exponent of a normal `f32`.
pub(super) const EXP2_MIN: f32 = -126.0;

/// `2^x` for `x` from [`EXP2_MIN`] to 126. Other lanes are undefined and must be masked by the caller.
#[inline(always)]
pub(super) fn exp2<V: Vector>(x: V) -> V {
    // Rounding by addition works in every instruction set; a rounding instruction is not always available.
    let shifted = x + V::splat(ROUND);
    let f = x - (shifted - V::splat(ROUND));
    let mut sum = V::splat(EXP2[5]);
    for &coefficient in EXP2[..5].iter().rev() {
        // No fused multiply-add: results must be bit-identical on every instruction set.
        sum = sum * f + V::splat(coefficient);
    }
    sum.scale_by_power_of_two(shifted)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::simd::{Isa, Kernel, LANES};

    struct Exp2(f32);

    impl Kernel for Exp2 {
        type Output = f32;

        #[inline(always)]
        fn run<V: Vector>(self) -> f32 {
            exp2(V::load(&[self.0; LANES])).to_array()[0]
        }
    }

    #[test]
    fn exp2_is_right_to_three_units_in_the_last_place() {
        let mut worst = 0f64;
        for i in 0..200_000 {
            let x = EXP2_MIN + i as f32 * (252.0 / 200_000.0);
            let got = Isa::best().run(Exp2(x));
            let want = f64::from(x).exp2();
            worst = worst.max((f64::from(got) / want - 1.0).abs());
        }
        assert!(worst < 3.0e-7, "{worst:e}");
    }
}
