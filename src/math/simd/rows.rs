//! Conversion between rows in memory and vectors that hold one row per lane.

use super::vector::{LANES, Vector};

/// Loads each row into one vector.
#[inline(always)]
pub fn load_rows<V: Vector, const N: usize>(rows: &[[f32; LANES]; N]) -> [V; N] {
    let mut lanes = [V::splat(0.0); N];
    for (lanes, row) in lanes.iter_mut().zip(rows) {
        *lanes = V::load(row);
    }
    lanes
}

/// Loads one row per lane: vector `i` holds element `i` of all rows. `N` is at least eight.
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

/// Inverse of [`gather_rows`]: writes lane `i` to row `rows[i]` of a table.
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

#[cfg(test)]
mod tests {
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
