//! What a kernel is written in: eight lanes of f32, whatever the instructions behind them.

use std::ops::{Add, Div, Mul, Sub};

/// Lanes of a [`Vector`].
pub const LANES: usize = 8;

/// A lane of a mask that is set.
pub const EVERY_BIT: f32 = f32::from_bits(u32::MAX);

/// Eight f32 lanes.
pub trait Vector:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// One value in every lane.
    fn splat(value: f32) -> Self;
    /// The first eight values.
    fn load(values: &[f32]) -> Self;
    /// Every other of the first sixteen values, from the first on.
    fn load_even(values: &[f32]) -> Self;
    /// Overwrites the first eight values.
    fn store(self, values: &mut [f32]);
    /// The smaller of each pair; of no use where a lane is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger of each pair; of no use where a lane is NaN.
    fn max(self, other: Self) -> Self;
    /// Square root of each lane, rounded correctly.
    fn sqrt(self) -> Self;
    /// Lane `i` sets bit `i` if it is at most that of `other`.
    fn at_most(self, other: Self) -> u32;
    /// In every lane the bits of `kept`, with `added` in place of the others.
    fn tag(self, kept: u32, added: u32) -> Self;
    /// Lane `i` sets bit `i` if it agrees with that of `other` in the bits of `mask`.
    fn agrees(self, other: Self, mask: u32) -> u32;
    /// The lanes whose bit is set in `mask` come first, in order; the others say nothing.
    fn compress(self, mask: u32) -> Self;
    /// A mask: lanes that are at most those of `other` have every bit set, the others none.
    fn mask_at_most(self, other: Self) -> Self;
    /// The bits that both have.
    fn and(self, other: Self) -> Self;
    /// Lanes of `yes` where the mask is set, those of `no` elsewhere.
    fn select(mask: Self, yes: Self, no: Self) -> Self;
    /// Lane `i` sets bit `i` if its sign bit is set, as it is where a mask is.
    fn signs(self) -> u32;
    /// Lanes without what is behind the point; says nothing of lanes beyond an `i32`.
    fn truncated(self) -> [i32; LANES];
    /// Adds the integer in the bits of each lane of `exponent` to the exponent of the lane: times a
    /// power of two, as long as the result is a normal number.
    fn scale_by_bits(self, exponent: Self) -> Self;
    /// Lane `j` of vector `i` becomes lane `i` of vector `j`.
    fn transposed(rows: [Self; LANES]) -> [Self; LANES];
    /// The sum of each of eight vectors' lanes, added first to last, in the lane of its number.
    #[inline(always)]
    fn lane_sums(rows: [Self; LANES]) -> Self {
        let lanes = Self::transposed(rows);
        let mut sums = lanes[0];
        for lanes in &lanes[1..] {
            sums = sums + *lanes;
        }
        sums
    }
    /// The lanes as an array, first to last.
    #[inline(always)]
    fn to_array(self) -> [f32; LANES] {
        let mut lanes = [0.0; LANES];
        self.store(&mut lanes);
        lanes
    }
}

/// For every mask of eight lanes the set ones, ascending, then zeros.
pub(super) const SET_LANES: [[u32; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        // `while`, because a constant cannot loop over an iterator.
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

/// A computation on vectors of any instruction set. `run` must be `#[inline(always)]`, and so must
/// everything hot below it: what is not inlined is compiled for the baseline.
pub trait Kernel {
    /// What it gives.
    type Output;
    /// Runs on the vectors `V`.
    fn run<V: Vector>(self) -> Self::Output;
}
