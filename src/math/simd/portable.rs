//! Portable vectors, based on the `wide` crate.

use super::vector::{LANES, SET_LANES, Vector};
use std::ops::{Add, Div, Mul, Sub};
use wide::bytemuck::cast;
use wide::{f32x8, i32x8, u32x8};

/// Eight f32 lanes in the target's baseline instruction set.
#[derive(Clone, Copy)]
pub(super) struct Portable(f32x8);

macro_rules! operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Portable {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(self.0.$method(other.0))
            }
        }
    };
}

operator!(Add, add);
operator!(Sub, sub);
operator!(Mul, mul);
operator!(Div, div);

impl Vector for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(f32x8::splat(value))
    }

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        let mut lanes = [0.0; LANES];
        lanes.copy_from_slice(&values[..LANES]);
        Self(f32x8::new(lanes))
    }

    #[inline(always)]
    fn load_even(values: &[f32]) -> Self {
        let mut lanes = [0.0; LANES];
        for (lane, pair) in lanes.iter_mut().zip(values[..2 * LANES].chunks_exact(2)) {
            *lane = pair[0];
        }
        Self(f32x8::new(lanes))
    }

    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        values[..LANES].copy_from_slice(self.0.as_array());
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        // `min` handles NaN, which no kernel needs and AVX2 does not do.
        Self(self.0.fast_min(other.0))
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.fast_max(other.0))
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        self.0.simd_le(other.0).to_bitmask() & 0xFF
    }

    #[inline(always)]
    fn replace_low_bits(self, kept: u32, added: u32) -> Self {
        let bits = cast::<f32x8, u32x8>(self.0) & u32x8::splat(kept) | u32x8::splat(added);
        Self(cast(bits))
    }

    #[inline(always)]
    fn bits_equal(self, other: Self, mask: u32) -> u32 {
        let differing = cast::<f32x8, u32x8>(self.0) ^ cast::<f32x8, u32x8>(other.0);
        let equal = (differing & u32x8::splat(mask)).simd_eq(u32x8::splat(0));
        cast::<u32x8, f32x8>(equal).to_bitmask() & 0xFF
    }

    #[inline(always)]
    fn mask_at_most(self, other: Self) -> Self {
        Self(self.0.simd_le(other.0))
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(self.0 & other.0)
    }

    #[inline(always)]
    fn select(mask: Self, yes: Self, no: Self) -> Self {
        Self(mask.0.select(yes.0, no.0))
    }

    #[inline(always)]
    fn sign_bits(self) -> u32 {
        self.0.to_bitmask() & 0xFF
    }

    #[inline(always)]
    fn truncated(self) -> [i32; LANES] {
        self.0.trunc_int().to_array()
    }

    #[inline(always)]
    fn scale_by_power_of_two(self, exponent: Self) -> Self {
        let exponent: i32x8 = cast::<f32x8, i32x8>(exponent.0) << 23;
        Self(cast(cast::<f32x8, i32x8>(self.0) + exponent))
    }

    #[inline(always)]
    fn transposed(rows: [Self; LANES]) -> [Self; LANES] {
        f32x8::transpose(rows.map(|row| row.0)).map(Self)
    }

    #[inline(always)]
    fn compress(self, mask: u32) -> Self {
        let (from, lanes) = (self.0.to_array(), &SET_LANES[mask as usize & 0xFF]);
        let mut to = [0.0; LANES];
        for (to, &lane) in to.iter_mut().zip(lanes) {
            *to = from[lane as usize % LANES];
        }
        Self(f32x8::new(to))
    }
}
