//! Sums and visibility counts of all components.
//!
//! Rows are 32-bit integers in units of 2⁻¹⁵. They take half the memory of f64 and are exact in any
//! order of points, frames and threads. If a row could overflow, its sums move to a wide row: whole
//! quanta in f64, exact below 2⁵³ quanta. In the Kinect room, 2 % of the components need a wide row.
//! Sums in f64 would change the picture by less than 0.005 dB.

use crate::math::image::split_by_sizes;
use crate::model::scene::state::{QUANTUM, StoredSums, VisibilityCounts, WIDE_POINTS, WideRow};
use crate::model::scene::sums::{N_SUMS, SceneSums, clamp_moments, repair_scatter};
use crate::model::splat::observed_cone::ObservedCone;
use glam::DMat3;
use rayon::prelude::*;

/// Number of points from which a component is known: its plane and its colour are then compared with
/// frames.
pub const KNOWN_POINTS: f64 = 20.0;

// Expected returns are counted in 64ths.
const RETURN_QUANTA: f64 = 64.0;

#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct SumRow {
    /// Sums in the order given at [`N_SUMS`], in whole quanta.
    pub sums: [i32; N_SUMS],
    visibility: VisibilityCounts,
}

impl SumRow {
    const EMPTY: Self = Self {
        sums: [0; N_SUMS],
        visibility: VisibilityCounts { expected: 0, hits: 0, misses: 0 },
    };
}

/// Observation of a component by one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visibility {
    /// The frame measured a surface at the component.
    Hit,
    /// The frame measured a farther surface, or none, in the direction of the component.
    Miss,
}

impl SumRow {
    #[inline(always)]
    pub fn add(&mut self, terms: &[f32; N_SUMS]) {
        for (sum, &term) in self.sums.iter_mut().zip(terms) {
            // Wrapping only avoids the check: a row spills long before it could overflow.
            *sum = sum.wrapping_add(term_quanta(term));
        }
    }

    /// Adds the visibility of the component in one frame. `expected` is the number of points that the
    /// frame could have measured on the component.
    #[inline(always)]
    pub fn count_visibility(&mut self, visibility: Visibility, expected: f64) {
        // Whole quanta per frame: the sum is independent of the order of frames.
        let expected = (expected * RETURN_QUANTA) as u32;
        self.visibility = self.visibility.plus(match visibility {
            Visibility::Hit => VisibilityCounts { expected, hits: 1, misses: 0 },
            Visibility::Miss => VisibilityCounts { expected, hits: 0, misses: 1 },
        });
    }

    pub fn visibility(&self) -> VisibilityCounts {
        self.visibility
    }

    /// Returns the number of points that the component could have received.
    pub fn expected(&self) -> f64 {
        f64::from(self.visibility.expected) / RETURN_QUANTA
    }
}

/// Integer sums of all components. Sums that could overflow are moved to wide rows of f64.
#[derive(Default)]
pub struct ComponentSums {
    rows: Vec<SumRow>,
    wide: WideSums,
}

impl ComponentSums {
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn grow(&mut self, n: usize) {
        self.rows.resize(n, SumRow::EMPTY);
    }

    pub fn bytes(&self) -> usize {
        self.rows.len() * size_of::<SumRow>() + self.wide.len() * size_of::<[f64; N_SUMS]>()
    }

    /// Returns the integer sums and visibility counts of a component, without its wide row.
    pub fn row(&self, id: usize) -> &SumRow {
        &self.rows[id]
    }

    /// Returns all sums of a component: its integer row plus its wide row.
    pub fn sums(&self, id: usize) -> [f64; N_SUMS] {
        let mut sums = self.rows[id].sums.map(value);
        if let Some(wide) = self.wide.get(id as u32) {
            for (sum, wide) in sums.iter_mut().zip(wide) {
                *sum += wide;
            }
        }
        sums
    }

    /// Returns the number of a component's points, and the sums of their offsets from the seed and of
    /// their normals. Offsets are in units of the structural scale.
    #[inline(always)]
    pub fn plane_sums(&self, id: usize) -> (f64, [f64; 3], [f64; 3]) {
        self.wide.plane(id, &self.rows[id])
    }

    /// Returns the mean colour of a component; `None` if the component has few points or was created in
    /// this frame.
    #[inline(always)]
    pub fn known_color(&self, id: u32) -> Option<[f64; 3]> {
        // `NONE` exceeds the number of rows too.
        let row = self.rows.get(id as usize)?;
        let sum = self.wide.reader(id as usize, row);
        let n = sum(0);
        (n >= KNOWN_POINTS).then(|| [sum(10) / n, sum(11) / n, sum(12) / n])
    }

    /// Returns the range of view directions of a component's points; the unknown range if there are no
    /// points.
    pub fn observed_cone(&self, id: usize) -> ObservedCone {
        // Directions are independent of the structural scale.
        SceneSums::new(&self.sums(id), 1.0).observed_cone()
    }

    /// Returns sums and visibility counts as stored in checkpoints. Equal sums give equal results,
    /// whatever the order of addition.
    pub fn state(&self) -> (StoredSums, Vec<VisibilityCounts>) {
        // Parallel, since training is blocked meanwhile.
        let ids = (0..self.rows.len() as u32).into_par_iter().with_min_len(4096);
        // Full rows count as wide, so that equal sums are stored alike before and after they spill.
        let is_wide = |id: &u32| self.wide.get(*id).is_some() || is_full(self.row(*id as usize));
        let wide = ids.filter(is_wide).map(|id| WideRow { id, sums: self.sums(id as usize) });
        let wide: Vec<WideRow> = wide.collect();
        let rows = self.rows.par_iter().with_min_len(4096);
        let (mut rows, visibility): (Vec<_>, Vec<_>) =
            rows.map(|row| (row.sums, row.visibility)).unzip();
        for row in &wide {
            rows[row.id as usize] = [0; N_SUMS];
        }
        (StoredSums { rows, wide }, visibility)
    }

    pub fn restore(sums: StoredSums, visibility: Vec<VisibilityCounts>) -> Self {
        let rows = sums.rows.into_iter().zip(visibility);
        let rows = rows.map(|(sums, visibility)| SumRow { sums, visibility }).collect();
        let wide = sums.wide.into_iter().map(|row| (row.id, row.sums)).collect();
        Self { rows, wide }
    }

    /// Calls `f` in parallel on at most `parts` disjoint ranges of consecutive rows. The arguments of
    /// `f` are the index of the first row of the range, the rows, and all wide sums.
    pub fn for_each_part(
        &mut self,
        parts: usize,
        f: impl Fn(usize, &mut [SumRow], &WideSums) + Sync,
    ) {
        let n = self.rows.len().div_ceil(parts).max(1);
        self.for_each_run(&Vec::from_iter((0..self.rows.len()).step_by(n)), f);
    }

    /// Calls `f` as [`Self::for_each_part`] does, on ranges that begin at the rows `firsts`, ascending
    /// from 0. Each range is one task, and the last range extends to the last row.
    pub fn for_each_run(
        &mut self,
        firsts: &[usize],
        f: impl Fn(usize, &mut [SumRow], &WideSums) + Sync,
    ) {
        let ends = firsts.iter().skip(1).copied().chain([self.rows.len()]);
        let sizes = ends.zip(firsts).map(|(end, first)| end.saturating_sub(*first));
        let runs =
            split_by_sizes(&mut self.rows, sizes).into_par_iter().zip(firsts).with_max_len(1);
        runs.for_each(|(rows, &first)| f(first, rows, &self.wide));
    }

    /// Adds sums in whole quanta to the components `ids`, which must be ascending. Runs in parallel on
    /// at most `parts` parts of equal numbers of components.
    pub fn add_quanta(&mut self, ids: &[u32], sums: &[[i32; N_SUMS]], parts: usize) {
        let firsts = ids.iter().step_by(ids.len().div_ceil(parts).max(1)).map(|&id| id as usize);
        // The first run begins at row 0, whichever component comes first.
        let firsts: Vec<usize> = std::iter::once(0).chain(firsts.skip(1)).collect();
        self.for_each_run(&firsts, |first, rows, _| {
            let at = |id: usize| ids.partition_point(|&other| (other as usize) < id);
            let mine = at(first)..at(first + rows.len());
            for (&id, sums) in ids[mine.clone()].iter().zip(&sums[mine]) {
                let row = rows[id as usize - first].sums.iter_mut().zip(sums);
                row.for_each(|(sum, &more)| *sum = sum.wrapping_add(more));
            }
        });
    }

    /// Returns the rows that the given components would have after [`Self::add_quanta`].
    pub fn rows_with(&self, ids: &[u32], sums: &[[i32; N_SUMS]]) -> Vec<[i32; N_SUMS]> {
        let with = |(&id, sums): (&u32, &[i32; N_SUMS])| {
            let row = &self.rows[id as usize].sums;
            std::array::from_fn(|i| row[i].wrapping_add(sums[i]))
        };
        ids.iter().zip(sums).map(with).collect()
    }

    /// Moves the sums of components in `touched` to wide rows if the next frame could make the sums
    /// overflow.
    pub fn spill_to_wide_rows(&mut self, touched: &[u32]) {
        let full = touched.par_iter().with_min_len(1024);
        let full = full.filter(|id| is_full(self.row(**id as usize)));
        for &id in full.collect::<Vec<_>>() {
            let row = &mut self.rows[id as usize];
            let sums = std::mem::replace(&mut row.sums, [0; N_SUMS]);
            self.add_wide(id, sums.map(value));
        }
    }

    /// Adds the sums and visibility counts of component `dropped` to component `kept`, and empties
    /// `dropped`. `sums` are the sums of `dropped` about the seed of `kept`. Second moments are
    /// repaired, since rounding can make a variance negative by a quantum.
    pub fn merge(&mut self, kept: usize, dropped: usize, sums: &[f64; N_SUMS]) {
        let visibility = std::mem::take(&mut self.rows[dropped].visibility);
        // A later birth may reuse the row.
        self.rows[dropped].sums = [0; N_SUMS];
        self.wide.remove(dropped as u32);
        let row = &mut self.rows[kept];
        row.visibility = row.visibility.plus(visibility);
        // Below the limit, the row has room for the next frame.
        if value(row.sums[0]) + sums[0] < FULL {
            let sums = sums.map(sum_quanta);
            row.sums.iter_mut().zip(sums).for_each(|(sum, other)| *sum = sum.wrapping_add(other));
        } else {
            // Shifting leaves fractions, but wide rows stay exact only in whole quanta.
            self.add_wide(kept as u32, sums.map(whole_quanta));
        }
        let mut union = self.sums(kept);
        let is_restrained = clamp_moments(&mut union);
        if repair_scatter(&mut union) || is_restrained {
            self.replace(kept, &union);
        }
    }

    /// Appends a component with the given sums, in whole quanta, and visibility counts. Second moments
    /// that rounding made negative by a quantum are repaired.
    pub fn push(&mut self, sums: &[f64; N_SUMS], visibility: VisibilityCounts) {
        let id = self.rows.len();
        let mut sums = *sums;
        clamp_moments(&mut sums);
        repair_scatter(&mut sums);
        self.rows.push(SumRow { sums: [0; N_SUMS], visibility });
        if sums[0] < FULL {
            self.rows[id].sums = sums.map(sum_quanta);
        } else {
            self.add_wide(id as u32, sums);
        }
    }

    /// Rotates the offsets, normals and directions in all sums by `turn`, about each component's seed.
    pub fn rotate(&mut self, turn: DMat3) {
        let turned = |sums: &[f64; N_SUMS]| {
            let mut turned = SceneSums::new(sums, 1.0).rotated(turn).to_array();
            clamp_moments(&mut turned);
            repair_scatter(&mut turned);
            turned
        };
        let wide = self.wide.ids();
        // Computed before the rows rotate, since the sums of a wide component include its row.
        let all: Vec<_> = wide.map(|id| (id as usize, turned(&self.sums(id as usize)))).collect();
        self.rows.par_iter_mut().with_min_len(256).for_each(|row| {
            row.sums = turned(&row.sums.map(value)).map(sum_quanta);
        });
        // Wide rows hold whole quanta, so that later additions stay exact.
        for (id, sums) in all {
            self.replace(id, &sums.map(whole_quanta));
        }
    }

    /// Replaces a component's sums by sums over the same number of points.
    fn replace(&mut self, id: usize, sums: &[f64; N_SUMS]) {
        let row = &mut self.rows[id].sums;
        match self.wide.get_mut(id as u32) {
            Some(wide) => (*row, *wide) = ([0; N_SUMS], *sums),
            None => *row = sums.map(sum_quanta),
        }
    }

    pub fn add_wide(&mut self, id: u32, sums: [f64; N_SUMS]) {
        self.wide.add(id, &sums);
    }
}

fn is_full(row: &SumRow) -> bool {
    value(row.sums[0]) >= FULL
}

/// Number of points from which a row's sums are moved to a wide row.
// A row holds twice as many: that many terms of 7.84, the maximum, are 2.105·10⁹ quanta, just below 2³¹.
pub const FULL: f64 = WIDE_POINTS as f64;

/// Rounds a term of a sum, within ±7.84, to whole quanta.
#[inline(always)]
pub fn term_quanta(term: f32) -> i32 {
    /// Adding this number rounds a number below 2²² to an integer (ties to even), stored in the low
    /// bits of the sum.
    const SHIFTER: f32 = 1.5 * (1 << 23) as f32;
    (term * QUANTA + SHIFTER).to_bits().wrapping_sub(SHIFTER.to_bits()) as i32
}

fn sum_quanta(sum: f64) -> i32 {
    (sum / QUANTUM).round_ties_even() as i32
}

/// Rounds a sum to a whole multiple of [`QUANTUM`].
pub fn whole_quanta(sum: f64) -> f64 {
    (sum / QUANTUM).round_ties_even() * QUANTUM
}

#[inline(always)]
pub fn value(quanta: i32) -> f64 {
    f64::from(quanta) * QUANTUM
}

/// Number of quanta per unit, the reciprocal of [`QUANTUM`].
const QUANTA: f32 = (1.0 / QUANTUM) as f32;

// Marks a component without wide sums.
const NONE: u32 = u32::MAX;

/// Sums in f64 of the components that have wide rows. Lookups occur for every point of a frame, so the
/// index is a direct table by component.
#[derive(Default)]
pub struct WideSums {
    /// For each component, its index in `rows`. Ends with the last component that has a wide row.
    places: Vec<u32>,
    rows: Vec<(u32, [f64; N_SUMS])>,
}

impl WideSums {
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    pub fn ids(&self) -> impl Iterator<Item = u32> {
        self.rows.iter().map(|(id, _)| *id)
    }

    #[inline(always)]
    pub fn get(&self, id: u32) -> Option<&[f64; N_SUMS]> {
        let place = *self.places.get(id as usize)?;
        // `NONE` lies beyond all rows, so it needs no test of its own.
        self.rows.get(place as usize).map(|(_, sums)| sums)
    }

    /// Returns the sums of [`ComponentSums::plane_sums`] for a component with the given row.
    #[inline(always)]
    pub fn plane(&self, id: usize, row: &SumRow) -> (f64, [f64; 3], [f64; 3]) {
        let sum = self.reader(id, row);
        (sum(0), [sum(1), sum(2), sum(3)], [sum(22), sum(23), sum(24)])
    }

    #[inline(always)]
    fn reader<'a>(&'a self, id: usize, row: &'a SumRow) -> impl Fn(usize) -> f64 + 'a {
        let wide = self.get(id as u32);
        move |i| value(row.sums[i]) + wide.map_or(0.0, |wide| wide[i])
    }

    pub fn get_mut(&mut self, id: u32) -> Option<&mut [f64; N_SUMS]> {
        let place = *self.places.get(id as usize)?;
        self.rows.get_mut(place as usize).map(|(_, sums)| sums)
    }

    pub fn add(&mut self, id: u32, sums: &[f64; N_SUMS]) {
        match self.get_mut(id) {
            // Integer quanta below 2⁵³ are exact in f64, hence independent of the order.
            Some(wide) => wide.iter_mut().zip(sums).for_each(|(wide, sum)| *wide += sum),
            None => {
                let n = self.places.len().max(id as usize + 1);
                self.places.resize(n, NONE);
                self.places[id as usize] = self.rows.len() as u32;
                self.rows.push((id, *sums));
            }
        }
    }

    pub fn remove(&mut self, id: u32) {
        let Some(place) = self.places.get_mut(id as usize) else { return };
        let place = std::mem::replace(place, NONE) as usize;
        if place < self.rows.len() {
            self.rows.swap_remove(place);
            // The last row fills the gap, so its index changes.
            if let Some((moved, _)) = self.rows.get(place) {
                self.places[*moved as usize] = place as u32;
            }
        }
    }
}

impl FromIterator<(u32, [f64; N_SUMS])> for WideSums {
    fn from_iter<I: IntoIterator<Item = (u32, [f64; N_SUMS])>>(rows: I) -> Self {
        let mut wide = Self::default();
        rows.into_iter().for_each(|(id, sums)| wide.add(id, &sums));
        wide
    }
}

#[cfg(test)]
mod sum_scalar_tests {
    use super::*;

    #[test]
    fn quanta_round_to_nearest() {
        for x in [0.1f32, -0.7, 3.999, -4.0, 1e-6] {
            assert!((value(term_quanta(x)) - f64::from(x)).abs() <= 0.5 / 32768.0 + 1e-7, "{x}");
        }
    }
}

#[cfg(test)]
mod wide_sums_tests {
    use super::*;

    #[test]
    fn sums_stay_with_their_component() {
        let sums = |value: f64| [value; N_SUMS];
        let mut wide: WideSums =
            [(7, sums(1.0)), (2, sums(2.0)), (9, sums(3.0))].into_iter().collect();
        wide.add(2, &sums(0.5));
        wide.remove(7);
        wide.remove(7);
        wide.remove(100);
        let found = [2, 7, 9, 100].map(|id| wide.get(id).map(|sums| sums[N_SUMS - 1]));
        assert_eq!((found, wide.len()), ([Some(2.5), None, Some(3.0), None], 2));
        wide.add(7, &sums(4.0));
        *wide.get_mut(9).unwrap() = sums(5.0);
        let found = [2, 7, 9].map(|id| wide.get(id).map(|sums| sums[0]));
        assert_eq!(found, [Some(2.5), Some(4.0), Some(5.0)]);
        assert!(wide.get_mut(8).is_none());
    }
}

#[cfg(test)]
mod quanta_tests {
    use super::*;

    #[test]
    fn quanta_are_added_to_the_rows_of_their_components() {
        let (ids, mut sums) = ([1, 2, 4, 5], ComponentSums::default());
        let more = [10, 20, 40, 50].map(|quanta| [quanta; N_SUMS]);
        sums.grow(7);
        sums.add_quanta(&ids, &more, 2);
        sums.add_quanta(&ids[2..], &more[2..], 8);
        let first = |sums: &ComponentSums| Vec::from_iter(sums.rows.iter().map(|row| row.sums[0]));
        assert_eq!(first(&sums), [0, 10, 20, 0, 80, 100, 0]);
        let with = sums.rows_with(&ids[1..], &more[1..]);
        assert_eq!(with, [40, 120, 150].map(|quanta| [quanta; N_SUMS]));
        assert_eq!(first(&sums), [0, 10, 20, 0, 80, 100, 0]);
        let rows = 7 * size_of::<SumRow>();
        assert_eq!(sums.bytes(), rows);
        sums.add_wide(3, [1.0; N_SUMS]);
        sums.add_wide(5, [1.0; N_SUMS]);
        assert_eq!(sums.bytes(), rows + 2 * N_SUMS * size_of::<f64>());
    }
}
