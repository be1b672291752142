//! Vectors of eight f32 lanes and kernels that use them, independent of the instruction set.

use std::ops::{Add, Div, Mul, Sub};

/// Number of lanes of a [`Vector`].
pub const LANES: usize = 8;

/// Value of a set lane in a lane mask: all bits are one.
pub const SET_LANE: f32 = f32::from_bits(u32::MAX);

/// Eight f32 lanes.
pub trait Vector:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self>
{
    /// Returns a vector with one value in every lane.
    fn splat(value: f32) -> Self;
    /// Loads the first eight values.
    fn load(values: &[f32]) -> Self;
    /// Loads the values at even indices of the first sixteen.
    fn load_even(values: &[f32]) -> Self;
    /// Stores the lanes in the first eight values.
    fn store(self, values: &mut [f32]);
    /// Minimum per lane; undefined for NaN.
    fn min(self, other: Self) -> Self;
    /// Maximum per lane; undefined for NaN.
    fn max(self, other: Self) -> Self;
    /// Square root per lane, correctly rounded.
    fn sqrt(self) -> Self;
    /// Compares lane by lane. Returns a bit mask: bit `i` is set if `self ≤ other` in lane `i`.
    fn at_most(self, other: Self) -> u32;
    /// In every lane, clears all bits outside the mask `kept` and sets the bits of `added`.
    fn replace_low_bits(self, kept: u32, added: u32) -> Self;
    /// Compares the bits selected by `mask`, lane by lane. Returns a bit mask: bit `i` is set if these
    /// bits are equal in lane `i`.
    fn bits_equal(self, other: Self, mask: u32) -> u32;
    /// Moves the lanes selected by `mask` to the front, in order; the remaining lanes are undefined.
    fn compress(self, mask: u32) -> Self;
    /// Compares lane by lane. Returns a lane mask: all bits of a lane are set where `self ≤ other`, and
    /// none elsewhere.
    fn mask_at_most(self, other: Self) -> Self;
    /// Bitwise and.
    fn and(self, other: Self) -> Self;
    /// Returns lanes of `yes` where the mask is set, and lanes of `no` elsewhere.
    fn select(mask: Self, yes: Self, no: Self) -> Self;
    /// Returns the sign bits as a bit mask, bit `i` for lane `i`. For a lane mask, bit `i` is set if
    /// lane `i` is set.
    fn sign_bits(self) -> u32;
    /// Truncates to integers; undefined for lanes out of range of `i32`.
    fn truncated(self) -> [i32; LANES];
    /// Multiplies each lane by a power of two by adding to its floating-point exponent. The integer to
    /// add is in the low nine bits of each lane of `exponent`. The result must be a normal number.
    fn scale_by_power_of_two(self, exponent: Self) -> Self;
    /// Transposes: lane `j` of vector `i` becomes lane `i` of vector `j`.
    fn transposed(rows: [Self; LANES]) -> [Self; LANES];
    /// Sums the lanes of each vector, from first to last. Lane `i` of the result is the sum of vector
    /// `i`.
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

/// Table of the indices of the set lanes of every 8-bit mask, ascending and padded with zeros.
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

/// Computation that is generic over the instruction set. `run` and all hot functions it calls must be
/// `#[inline(always)]`. Code that is not inlined is compiled for the baseline instruction set.
pub trait Kernel {
    /// Result type.
    type Output;
    /// Runs the computation with vectors of type `V`.
    fn run<V: Vector>(self) -> Self::Output;
}

/// Loads each row into one vector.
#[inline(always)]
pub fn load_rows<V: Vector, const N: usize>(rows: &[[f32; LANES]; N]) -> [V; N] {
    let mut lanes = [V::splat(0.0); N];
    for (lanes, row) in lanes.iter_mut().zip(rows) {
        *lanes = V::load(row);
    }
    lanes
}

/// Loads one row per lane. Vector `i` of the result holds element `i` of all rows. `N` must be at least
/// eight.
#[inline(always)]
pub fn gather_rows<V: Vector, const N: usize>(rows: [&[f32; N]; LANES]) -> [V; N] {
    const { assert!(N >= LANES) }
    let mut lanes = [V::splat(0.0); N];
    for first in (0..N).step_by(LANES) {
        // The last block may overlap the one before.
        let first = first.min(N - LANES);
        let mut block = [V::splat(0.0); LANES];
        for (block, row) in block.iter_mut().zip(rows) {
            *block = V::load(&row[first..]);
        }
        lanes[first..first + LANES].copy_from_slice(&V::transposed(block));
    }
    lanes
}

/// Inverse of [`gather_rows`]: writes lane `i` of all vectors to row `rows[i]` of a table.
#[inline(always)]
pub fn scatter_rows<V: Vector, const N: usize>(
    lanes: &[V; N],
    rows: &[usize],
    table: &mut [[f32; N]],
) {
    const { assert!(N >= LANES) }
    for first in (0..N).step_by(LANES) {
        let first = first.min(N - LANES);
        let mut block = [V::splat(0.0); LANES];
        block.copy_from_slice(&lanes[first..first + LANES]);
        for (block, &row) in V::transposed(block).into_iter().zip(rows) {
            block.store(&mut table[row][first..]);
        }
    }
}

/// Returns the dot product of the 3-vectors `a` and `b` in each lane.
#[inline(always)]
pub fn dot<V: Vector>(a: [V; 3], b: [V; 3]) -> V {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Multiplies a matrix, given by rows, by one column vector per lane.
#[inline(always)]
pub fn turned<V: Vector>(rows: &[[f32; 3]; 3], [x, y, z]: [V; 3]) -> [V; 3] {
    let mut turned = [x; 3];
    for (turned, [a, b, c]) in turned.iter_mut().zip(rows) {
        *turned = V::splat(*a) * x + V::splat(*b) * y + V::splat(*c) * z;
    }
    turned
}

/// Multiplies the 3-vector in each lane by that lane's scalar.
#[inline(always)]
pub fn scaled<V: Vector>([x, y, z]: [V; 3], factor: V) -> [V; 3] {
    [x * factor, y * factor, z * factor]
}

#[cfg(test)]
mod rows_tests {
    use super::*;
    use crate::math::simd::{Isa, Kernel};

    /// Doubles five rows of a table.
    struct Doubled<'a, const N: usize>(&'a mut [[f32; N]]);

    impl<const N: usize> Kernel for Doubled<'_, N> {
        type Output = ();

        #[inline(always)]
        fn run<V: Vector>(self) {
            let chosen = [4, 0, 9, 3, 7];
            let none = [0.0; N];
            let rows =
                std::array::from_fn(|lane| chosen.get(lane).map_or(&none, |&row| &self.0[row]));
            let mut lanes = gather_rows::<V, N>(rows);
            for lanes in &mut lanes {
                *lanes = *lanes + *lanes;
            }
            scatter_rows(&lanes, &chosen, self.0);
        }
    }

    fn doubled<const N: usize>() {
        let number = |row: usize, i: usize| (row * N + i) as f32;
        let mut table: Vec<[f32; N]> =
            (0..10).map(|row| std::array::from_fn(|i| number(row, i))).collect();
        Isa::best().run(Doubled(&mut table));
        for (row, found) in table.iter().enumerate() {
            let factor = if [4, 0, 9, 3, 7].contains(&row) { 2.0 } else { 1.0 };
            assert_eq!(*found, std::array::from_fn(|i| factor * number(row, i)), "{row} of {N}");
        }
    }

    #[test]
    fn rows_come_back_whatever_their_length() {
        doubled::<8>();
        doubled::<11>();
        doubled::<28>();
        doubled::<55>();
    }
}
