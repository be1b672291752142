//! Sums and visibility counts of all components.
//!
//! Rows are 32-bit integers in units of 2⁻¹⁵: half the memory of f64, and exact in any order of points,
//! frames and threads. A row that could overflow spills into a wide row of f64 whole quanta, exact below 2⁵³
//! of them; 2 % of the components of the Kinect room need one. Sums in f32 and f64 exist to show that no
//! precision is lost: all three give the same picture within 0.005 dB.

use super::sum_scalar::SumScalar;
use super::wide_sums::WideSums;
use crate::math::pieces::split_by_sizes;
use crate::math::sym3::Sym3;
use crate::model::scene::bounds::{clamp_moments, repair_scatter};
use crate::model::scene::state::{QUANTUM, StoredSums, VisibilityCounts, WideRow};
use crate::model::scene::sums::{N_SUMS, SceneSums};
use crate::model::splat::observed_cone::ObservedCone;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

// Expected returns are counted in 64ths.
const RETURN_QUANTA: f64 = 64.0;

/// Sums of one component.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct SumRow<W> {
    /// Sums in the order of [`N_SUMS`].
    pub sums: [W; N_SUMS],
    visibility: VisibilityCounts,
}

impl<W: SumScalar> Default for SumRow<W> {
    fn default() -> Self {
        Self { sums: [W::default(); N_SUMS], visibility: VisibilityCounts::default() }
    }
}

/// Observation of a component by one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Visibility {
    /// The frame measured a surface at the component.
    Hit,
    /// The frame measured a farther surface through the component.
    Miss,
}

impl<W: SumScalar> SumRow<W> {
    /// Adds the terms of one point.
    #[inline(always)]
    pub fn add(&mut self, terms: &[W::Term; N_SUMS]) {
        for (sum, &term) in self.sums.iter_mut().zip(terms) {
            *sum = sum.plus(W::of(term));
        }
    }

    /// Counts a frame that could have given `expected` returns.
    #[inline(always)]
    pub fn count_visibility(&mut self, visibility: Visibility, expected: f64) {
        // Whole quanta per frame: the sum is independent of the order of frames.
        let expected = (expected * RETURN_QUANTA) as u32;
        self.visibility = self.visibility.plus(match visibility {
            Visibility::Hit => VisibilityCounts { expected, hits: 1, misses: 0 },
            Visibility::Miss => VisibilityCounts { expected, hits: 0, misses: 1 },
        });
    }

    /// Returns the visibility counts.
    pub fn visibility(&self) -> VisibilityCounts {
        self.visibility
    }

    /// Returns the number of points that the component could have received.
    pub fn expected(&self) -> f64 {
        f64::from(self.visibility.expected) / RETURN_QUANTA
    }
}

/// Read access to the wide rows.
#[derive(Clone, Copy)]
pub struct WideRows<'a>(&'a WideSums);

impl<'a> WideRows<'a> {
    /// Returns `N`, `Σ d` and `Σ n` of a component.
    #[inline(always)]
    pub fn plane<W: SumScalar>(self, id: usize, row: &SumRow<W>) -> (f64, [f64; 3], [f64; 3]) {
        let sum = self.reader(id, row);
        (sum(0), [sum(1), sum(2), sum(3)], [sum(22), sum(23), sum(24)])
    }

    #[inline(always)]
    fn reader<W: SumScalar>(self, id: usize, row: &'a SumRow<W>) -> impl Fn(usize) -> f64 + 'a {
        let wide = self.0.get(id as u32);
        move |i| row.sums[i].value() + wide.map_or(0.0, |wide| wide[i])
    }
}

/// Rows of all components; rows that could overflow spill into wide ones.
pub struct ComponentSums<W> {
    rows: Vec<SumRow<W>>,
    wide: WideSums,
}

impl<W: SumScalar> Default for ComponentSums<W> {
    fn default() -> Self {
        Self { rows: Vec::new(), wide: WideSums::default() }
    }
}

impl<W: SumScalar> ComponentSums<W> {
    /// Number of components.
    pub fn len(&self) -> usize {
        self.rows.len()
    }

    /// Grows to `n` components.
    pub fn grow(&mut self, n: usize) {
        self.rows.resize(n, SumRow::default());
    }

    /// Returns the memory used by the rows, in bytes.
    pub fn bytes(&self) -> usize {
        self.rows.len() * size_of::<SumRow<W>>() + self.wide.len() * size_of::<[f64; N_SUMS]>()
    }

    /// Returns the row of a component without its wide part.
    pub fn row(&self, id: usize) -> &SumRow<W> {
        &self.rows[id]
    }

    /// Returns all sums of a component, including its wide part.
    pub fn sums(&self, id: usize) -> [f64; N_SUMS] {
        let mut sums = self.rows[id].sums.map(W::value);
        if let Some(wide) = self.wide.get(id as u32) {
            for (sum, wide) in sums.iter_mut().zip(wide) {
                *sum += wide;
            }
        }
        sums
    }

    /// Returns `N`, `Σ d` and `Σ n` of a component.
    #[inline(always)]
    pub fn plane_sums(&self, id: usize) -> (f64, [f64; 3], [f64; 3]) {
        WideRows(&self.wide).plane(id, &self.rows[id])
    }

    /// Returns `N` and `Σ c` of a component.
    #[inline(always)]
    pub fn color_sums(&self, id: usize) -> (f64, [f64; 3]) {
        let sum = WideRows(&self.wide).reader(id, &self.rows[id]);
        (sum(0), [sum(10), sum(11), sum(12)])
    }

    /// Returns the range of view directions of a component's points; unknown without points.
    pub fn observed_cone(&self, id: usize) -> ObservedCone {
        let sum = WideRows(&self.wide).reader(id, &self.rows[id]);
        let n = sum(0);
        if n < 1.0 {
            return ObservedCone::default();
        }
        let mean = DVec3::new(sum(25), sum(26), sum(27)) / n;
        let (xx, yy) = (sum(28) / n, sum(31) / n);
        // Directions are unit vectors, so their squares sum to the count.
        let second = [xx, sum(29) / n, sum(30) / n, yy, sum(32) / n, 1.0 - xx - yy];
        ObservedCone::new(mean, Sym3::from_array(second).add_scaled(-1.0, Sym3::outer(mean)))
    }

    /// Returns sums and visibility counts of the components in `order`, in checkpoint form. Equal sums are
    /// stored alike, whatever the order of addition.
    pub fn state(&self, order: &[u32]) -> (StoredSums, Vec<VisibilityCounts>) {
        // Parallel, since training is blocked meanwhile.
        let order = order.par_iter().with_min_len(4096);
        let is_wide = |id: u32| self.wide.get(id).is_some() || is_full(self.row(id as usize));
        let wide = order.clone().enumerate().filter(|(_, id)| is_wide(**id));
        let wide = wide.map(|(at, &id)| WideRow { id: at as u32, sums: self.sums(id as usize) });
        let wide: Vec<WideRow> = wide.collect();
        let row = |&id: &u32| (self.row(id as usize).sums, self.row(id as usize).visibility);
        let (mut rows, visibility): (Vec<_>, Vec<_>) = order.map(row).unzip();
        for row in &wide {
            rows[row.id as usize] = [W::default(); N_SUMS];
        }
        (W::stored(rows, wide), visibility)
    }

    /// Restores what [`Self::state`] returned; `None` if its sums have another form.
    pub fn restore(sums: StoredSums, visibility: Vec<VisibilityCounts>) -> Option<Self> {
        let (sums, wide) = W::restored(sums)?;
        let rows = sums.into_iter().zip(visibility);
        let rows = rows.map(|(sums, visibility)| SumRow { sums, visibility }).collect();
        let wide = wide.into_iter().map(|row| (row.id, row.sums)).collect();
        Some(Self { rows, wide })
    }

    /// Calls `f` in parallel on disjoint ranges of consecutive rows, with the number of the first.
    pub fn for_each_part(
        &mut self,
        parts: usize,
        f: impl Fn(usize, &mut [SumRow<W>], WideRows<'_>) + Sync,
    ) {
        let n = self.rows.len().div_ceil(parts).max(1);
        self.for_each_run(&Vec::from_iter((0..self.rows.len()).step_by(n)), f);
    }

    /// The same on ranges that begin at the given rows, ascending, one task each; the first must be 0, the
    /// last extends to the end.
    pub fn for_each_run(
        &mut self,
        firsts: &[usize],
        f: impl Fn(usize, &mut [SumRow<W>], WideRows<'_>) + Sync,
    ) {
        let ends = firsts.iter().skip(1).copied().chain([self.rows.len()]);
        let sizes = ends.zip(firsts).map(|(end, first)| end.saturating_sub(*first));
        let runs =
            split_by_sizes(&mut self.rows, sizes).into_par_iter().zip(firsts).with_max_len(1);
        runs.for_each(|(rows, &first)| f(first, rows, WideRows(&self.wide)));
    }

    /// Adds sums of whole quanta to the given components (ascending), in parts of equal numbers of them.
    pub fn add_quanta(&mut self, ids: &[u32], sums: &[[i32; N_SUMS]], parts: usize) {
        let firsts = ids.iter().step_by(ids.len().div_ceil(parts).max(1)).map(|&id| id as usize);
        let firsts: Vec<usize> = std::iter::once(0).chain(firsts.skip(1)).collect();
        self.for_each_run(&firsts, |first, rows, _| {
            let at = |id: usize| ids.partition_point(|&other| (other as usize) < id);
            let mine = at(first)..at(first + rows.len());
            for (&id, sums) in ids[mine.clone()].iter().zip(&sums[mine]) {
                let row = rows[id as usize - first].sums.iter_mut().zip(sums);
                row.for_each(|(sum, &more)| *sum = sum.plus(W::of_quanta(more)));
            }
        });
    }

    /// Returns the rows of the given components after adding sums of whole quanta.
    pub fn rows_with(&self, ids: &[u32], sums: &[[i32; N_SUMS]]) -> Vec<[W; N_SUMS]> {
        let with = |(&id, sums): (&u32, &[i32; N_SUMS])| {
            let row = &self.rows[id as usize].sums;
            std::array::from_fn(|i| row[i].plus(W::of_quanta(sums[i])))
        };
        ids.iter().zip(sums).map(with).collect()
    }

    /// Adds changes of earlier contributions to the given components (ascending), with equal counts, in parts
    /// of equal numbers. Exact, except for second moments that no set of points could have any more.
    pub fn apply_changes(&mut self, ids: &[u32], changes: &[[i32; N_SUMS]], parts: usize) {
        self.add_quanta(ids, changes, parts);
        let mended = |&id: &u32| {
            let mut sums = self.sums(id as usize);
            let is_restrained = clamp_moments(&mut sums, W::SLACK);
            (repair_scatter(&mut sums) || is_restrained).then_some((id as usize, sums))
        };
        let mended: Vec<_> = ids.par_iter().with_min_len(256).filter_map(mended).collect();
        mended.into_iter().for_each(|(id, sums)| self.replace(id, &sums));
    }

    /// Moves rows that the next frame could overflow into wide ones.
    pub fn spill_to_wide_rows(&mut self, touched: &[u32]) {
        let full = touched.par_iter().with_min_len(1024);
        let full = full.filter(|id| is_full(self.row(**id as usize)));
        for &id in full.collect::<Vec<_>>() {
            let row = &mut self.rows[id as usize];
            let sums = std::mem::replace(&mut row.sums, [W::default(); N_SUMS]);
            self.add_wide(id, sums.map(W::value));
        }
    }

    /// Adds the sums and counts of `dropped`, where `sums` is already about the seed of `kept`, and empties
    /// `dropped`. Second moments are repaired, as moving them to another seed may make them negative by a
    /// quantum.
    pub fn merge(&mut self, kept: usize, dropped: usize, sums: &[f64; N_SUMS]) {
        let visibility = std::mem::take(&mut self.rows[dropped].visibility);
        self.rows[dropped].sums = [W::default(); N_SUMS];
        self.wide.remove(dropped as u32);
        let row = &mut self.rows[kept];
        row.visibility = row.visibility.plus(visibility);
        if row.sums[0].value() + sums[0] < W::FULL {
            let sums = sums.map(W::of_sum);
            row.sums.iter_mut().zip(sums).for_each(|(sum, other)| *sum = sum.plus(other));
        } else {
            let sums = sums.map(|sum| (sum / QUANTUM).round_ties_even() * QUANTUM);
            self.add_wide(kept as u32, sums);
        }
        let mut union = self.sums(kept);
        let is_restrained = clamp_moments(&mut union, W::SLACK);
        if repair_scatter(&mut union) || is_restrained {
            self.replace(kept, &union);
        }
    }

    /// Empties all components except the `most` with the most points (ties: lower numbers); returns those
    /// emptied.
    pub fn retain_fullest(&mut self, most: usize) -> Vec<u32> {
        let count = |id: &u32| self.sums(*id as usize)[0];
        let mut ids: Vec<u32> = (0..self.rows.len() as u32).filter(|id| count(id) > 0.0).collect();
        ids.sort_by(|a, b| count(b).total_cmp(&count(a)));
        let emptied = ids.split_off(most.min(ids.len()));
        for id in &emptied {
            self.rows[*id as usize].sums = [W::default(); N_SUMS];
            self.wide.remove(*id);
        }
        emptied
    }

    /// Adds a component with sums of whole quanta and its counts. Second moments that rounding made negative
    /// by a quantum are repaired.
    pub fn push(&mut self, sums: &[f64; N_SUMS], visibility: VisibilityCounts) {
        let id = self.rows.len();
        let mut sums = *sums;
        clamp_moments(&mut sums, W::SLACK);
        repair_scatter(&mut sums);
        self.rows.push(SumRow { sums: [W::default(); N_SUMS], visibility });
        if sums[0] < W::FULL {
            self.rows[id].sums = sums.map(W::of_sum);
        } else {
            self.add_wide(id as u32, sums);
        }
    }

    /// Rotates all sums by `turn`, about the same seeds.
    pub fn rotate(&mut self, turn: DMat3) {
        let turned = |sums: &[f64; N_SUMS]| {
            let mut turned = SceneSums::new(sums, 1.0).rotated(turn).to_array();
            clamp_moments(&mut turned, W::SLACK);
            repair_scatter(&mut turned);
            turned
        };
        let wide = self.wide.ids();
        let all: Vec<_> = wide.map(|id| (id as usize, turned(&self.sums(id as usize)))).collect();
        self.rows.par_iter_mut().with_min_len(256).for_each(|row| {
            row.sums = turned(&row.sums.map(W::value)).map(W::of_sum);
        });
        // Wide rows hold whole quanta, so that later additions stay exact.
        for (id, sums) in all {
            self.replace(id, &sums.map(|sum| (sum / QUANTUM).round_ties_even() * QUANTUM));
        }
    }

    /// Replaces a component's sums by ones of equal count.
    fn replace(&mut self, id: usize, sums: &[f64; N_SUMS]) {
        let row = &mut self.rows[id].sums;
        match self.wide.get_mut(id as u32) {
            Some(wide) => (*row, *wide) = ([W::default(); N_SUMS], *sums),
            None => *row = sums.map(W::of_sum),
        }
    }

    /// Adds sums that are too large for a row.
    pub fn add_wide(&mut self, id: u32, sums: [f64; N_SUMS]) {
        self.wide.add(id, &sums);
    }
}

fn is_full<W: SumScalar>(row: &SumRow<W>) -> bool {
    row.sums[0].value() >= W::FULL
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_that_fill_up_lose_nothing() {
        let mut component_sums = ComponentSums::<i32>::default();
        component_sums.grow(1);
        let mut terms = [-3.25f32; N_SUMS];
        terms[0] = 1.0;
        for _ in 0..20 {
            for _ in 0..1000 {
                component_sums.rows[0].add(&terms);
            }
            component_sums.spill_to_wide_rows(&[0]);
        }
        assert_eq!(component_sums.sums(0)[0], 20_000.0);
        assert_eq!(component_sums.sums(0)[5], -65_000.0);
    }
}
