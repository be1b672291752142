//! Traits for kernels: eight f32 lanes, independent of the instruction set.

use std::ops::{Add, Div, Mul, Sub};

/// Lanes of a [`Vector`].
pub const LANES: usize = 8;

/// Value of a lane that is set in a mask.
pub const SET_LANE: f32 = f32::from_bits(u32::MAX);

/// Eight f32 lanes.
pub trait Vector:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Puts one value into every lane.
    fn splat(value: f32) -> Self;
    /// Loads the first eight values.
    fn load(values: &[f32]) -> Self;
    /// Loads the values at even indices of the first sixteen.
    fn load_even(values: &[f32]) -> Self;
    /// Stores to the first eight values.
    fn store(self, values: &mut [f32]);
    /// Minimum per lane; undefined for NaN.
    fn min(self, other: Self) -> Self;
    /// Maximum per lane; undefined for NaN.
    fn max(self, other: Self) -> Self;
    /// Square root per lane, correctly rounded.
    fn sqrt(self) -> Self;
    /// Bit `i` is set if lane `i` is at most that of `other`.
    fn at_most(self, other: Self) -> u32;
    /// In every lane, retains the bits in `kept` and sets those of `added`.
    fn replace_low_bits(self, kept: u32, added: u32) -> Self;
    /// Bit `i` is set if lane `i` equals that of `other` in the bits of `mask`.
    fn bits_equal(self, other: Self, mask: u32) -> u32;
    /// Moves the lanes selected by `mask` to the front, in order; the remaining lanes are undefined.
    fn compress(self, mask: u32) -> Self;
    /// Mask of lanes that are at most those of `other`: all bits set or none.
    fn mask_at_most(self, other: Self) -> Self;
    /// Bitwise and.
    fn and(self, other: Self) -> Self;
    /// Lanes of `yes` where the mask is set, of `no` elsewhere.
    fn select(mask: Self, yes: Self, no: Self) -> Self;
    /// Bit `i` is the sign bit of lane `i`, which is set in masks.
    fn sign_bits(self) -> u32;
    /// Truncates to integers; undefined for lanes out of range of `i32`.
    fn truncated(self) -> [i32; LANES];
    /// Adds the integer in the bits of each lane of `exponent` to the lane's exponent, which multiplies
    /// by a power of two if the result is a normal number.
    fn scale_by_power_of_two(self, exponent: Self) -> Self;
    /// Transposes: lane `j` of vector `i` becomes lane `i` of vector `j`.
    fn transposed(rows: [Self; LANES]) -> [Self; LANES];
    /// Sums each vector's lanes, first to last; lane `i` of the result belongs to vector `i`.
    #[inline(always)]
    fn lane_sums(rows: [Self; LANES]) -> Self {
        let lanes = Self::transposed(rows);
        let mut sums = lanes[0];
        for lanes in &lanes[1..] {
            sums = sums + *lanes;
        }
        sums
    }
    /// Returns the lanes as an array.
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut lanes = [0.0; LANES];
        self.store(&mut lanes);
        lanes
    }
}

/// Indices of the set lanes of every 8-bit mask, ascending, padded with zeros.
pub(super) const SET_LANES: [[u32; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        // `while`, because `for` is not available in constants.
        let (mut lane, mut n) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                table[mask][n] = lane as u32;
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// A computation generic over the instruction set. `run` and all hot functions it calls must be
/// `#[inline(always)]`: code that is not inlined is compiled for the baseline.
pub trait Kernel {
    /// Result type.
    type Output;
    /// Runs with vectors of type `V`.
    fn run<V: Vector>(self) -> Self::Output;
}
