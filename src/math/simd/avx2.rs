//! AVX2 vectors.
//!
//! Safety: [`Avx2`] is private to this file, so its methods run only within [`run`]. [`run`] is called
//! only through an [`super::isa::Isa`], which exists only if [`is_available`] returned true.

#![allow(unsafe_code)]

use super::vector::{Kernel, LANES, SET_LANES, Vector};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Sub};

/// True if the CPU supports all features that [`run`] is compiled for.
pub(super) fn is_available() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("popcnt")
}

/// Runs a kernel compiled for AVX2. FMA is deliberately disabled: fused operations round differently.
#[inline]
pub(super) fn run<K: Kernel>(kernel: K) -> K::Output {
    // SAFETY: an `Isa` with AVX2 is created only by `Isa::avx2`, which checks `is_available`.
    unsafe { run_with_features(kernel) }
}

#[target_feature(enable = "avx2,bmi1,bmi2,popcnt")]
fn run_with_features<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2>()
}

#[derive(Clone, Copy)]
struct Avx2(__m256);

macro_rules! operator {
    ($trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for Avx2 {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                // SAFETY: within `run` the CPU has AVX2.
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

operator!(Add, add, _mm256_add_ps);
operator!(Sub, sub, _mm256_sub_ps);
operator!(Mul, mul, _mm256_mul_ps);
operator!(Div, div, _mm256_div_ps);

// SAFETY of every block below: within `run` the CPU has AVX2; loads and stores use slices whose
// length is checked to be eight.
impl Vector for Avx2 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self(unsafe { _mm256_set1_ps(value) })
    }

    #[inline(always)]
    fn load(values: &[f32]) -> Self {
        let values = &values[..LANES];
        Self(unsafe { _mm256_loadu_ps(values.as_ptr()) })
    }

    #[inline(always)]
    fn load_even(values: &[f32]) -> Self {
        let (low, high) = (Self::load(values), Self::load(&values[LANES..]));
        unsafe {
            // Even lanes of each 128-bit half, then the middle pairs are swapped.
            let mixed = _mm256_shuffle_ps::<0b10_00_10_00>(low.0, high.0);
            let pairs = _mm256_permute4x64_pd::<0b11_01_10_00>(_mm256_castps_pd(mixed));
            Self(_mm256_castpd_ps(pairs))
        }
    }

    #[inline(always)]
    fn store(self, values: &mut [f32]) {
        let values = &mut values[..LANES];
        unsafe { _mm256_storeu_ps(values.as_mut_ptr(), self.0) }
    }

    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(unsafe { _mm256_min_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(unsafe { _mm256_max_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }

    #[inline(always)]
    fn at_most(self, other: Self) -> u32 {
        let mask = unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0)) };
        mask as u32
    }

    #[inline(always)]
    fn replace_low_bits(self, kept: u32, added: u32) -> Self {
        unsafe {
            let bits = _mm256_castps_si256(self.0);
            let kept = _mm256_and_si256(bits, _mm256_set1_epi32(kept as i32));
            let tagged = _mm256_or_si256(kept, _mm256_set1_epi32(added as i32));
            Self(_mm256_castsi256_ps(tagged))
        }
    }

    #[inline(always)]
    fn bits_equal(self, other: Self, mask: u32) -> u32 {
        unsafe {
            let differing = _mm256_castps_si256(_mm256_xor_ps(self.0, other.0));
            let differing = _mm256_and_si256(differing, _mm256_set1_epi32(mask as i32));
            let equal = _mm256_cmpeq_epi32(differing, _mm256_setzero_si256());
            _mm256_movemask_ps(_mm256_castsi256_ps(equal)) as u32
        }
    }

    #[inline(always)]
    fn mask_at_most(self, other: Self) -> Self {
        Self(unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, other.0) })
    }

    #[inline(always)]
    fn and(self, other: Self) -> Self {
        Self(unsafe { _mm256_and_ps(self.0, other.0) })
    }

    #[inline(always)]
    fn select(mask: Self, yes: Self, no: Self) -> Self {
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, mask.0) })
    }

    #[inline(always)]
    fn sign_bits(self) -> u32 {
        unsafe { _mm256_movemask_ps(self.0) as u32 }
    }

    #[inline(always)]
    fn truncated(self) -> [i32; LANES] {
        let mut lanes = [0; LANES];
        unsafe {
            _mm256_storeu_si256(lanes.as_mut_ptr().cast(), _mm256_cvttps_epi32(self.0));
        }
        lanes
    }

    #[inline(always)]
    fn scale_by_power_of_two(self, exponent: Self) -> Self {
        unsafe {
            let exponent = _mm256_slli_epi32::<23>(_mm256_castps_si256(exponent.0));
            let sum = _mm256_add_epi32(_mm256_castps_si256(self.0), exponent);
            Self(_mm256_castsi256_ps(sum))
        }
    }

    #[inline(always)]
    fn transposed(rows: [Self; LANES]) -> [Self; LANES] {
        let mut columns = [rows[0]; LANES];
        unsafe {
            // Interleaves pairs of rows, then fours, within 128-bit halves; then swaps halves. Written as
            // loops because closures over vectors are not compiled for AVX2.
            let mut fours = [[rows[0].0; 4]; 2];
            for (half, fours) in fours.iter_mut().enumerate() {
                let [a, b] = [rows[4 * half].0, rows[4 * half + 1].0];
                let [c, d] = [rows[4 * half + 2].0, rows[4 * half + 3].0];
                let (low, next_low) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
                let (high, next_high) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
                fours[0] = _mm256_shuffle_ps::<0x44>(low, next_low);
                fours[1] = _mm256_shuffle_ps::<0xEE>(low, next_low);
                fours[2] = _mm256_shuffle_ps::<0x44>(high, next_high);
                fours[3] = _mm256_shuffle_ps::<0xEE>(high, next_high);
            }
            for i in 0..4 {
                let (upper, lower) = (fours[0][i], fours[1][i]);
                columns[i] = Self(_mm256_permute2f128_ps::<0x20>(upper, lower));
                columns[i + 4] = Self(_mm256_permute2f128_ps::<0x31>(upper, lower));
            }
        }
        columns
    }

    #[inline(always)]
    fn compress(self, mask: u32) -> Self {
        let lanes = &SET_LANES[mask as usize & 0xFF];
        unsafe {
            let lanes = _mm256_loadu_si256(lanes.as_ptr().cast());
            Self(_mm256_permutevar8x32_ps(self.0, lanes))
        }
    }
}
