//! A uniform grid over the initial spatial means (`training.md`, Grid of means).
//!
//! Cells are filled by a counting sort that keeps means of one cell in the order of their ids. So each
//! row of cells is contiguous in memory, and of equally near means the one with the lower id is
//! preferred. Bounds are quantiles of a sample, so a stray mean does not stretch the cells over empty
//! space. Means outside the bounds go to border cells, which extend to infinity. A cell holds one mean
//! on average; half or twice as many change the search time by less than 7 %. If few means move, the
//! grid is updated incrementally ([`Edits`]).

use super::cell_sort::{CellSort, Edits};
use super::kernel::Columns;
use crate::model::paper::mixture_device::GridShape;
use crate::train::candidates::IndexError;
use rayon::prelude::*;

const MAX_CELLS: usize = 1 << 22;
const SAMPLE: usize = 2048;
/// Share of the sample that is trimmed at each end of an axis.
const TRIM: f64 = 0.005;
/// Margin added to the trimmed bounds at each end of an axis, as a share of their length.
const MARGIN: f64 = 0.02;

const PART: usize = 1 << 12;

/// Means sorted by grid cell; a sorted mean is called an entry. Border cells extend to infinity.
#[derive(Debug, Default)]
pub struct MeanGrid {
    shape: GridShape,
    /// Cell `c` holds the entries `start[c]..start[c + 1]`.
    start: Vec<u32>,
    means: Columns,
    cell_of_id: Vec<u32>,
    cell_sort: CellSort,
    sample: Vec<f32>,
    /// Edits of the last [`MeanGrid::move_means`]. `shifted` holds the entries as they were before
    /// these edits.
    edits: Edits,
    shifted: Columns,
}

impl MeanGrid {
    /// Builds a grid over finite means.
    pub fn new(means: &[[f32; 3]]) -> Result<Self, IndexError> {
        let mut grid = Self::default();
        grid.rebuild(means)?;
        Ok(grid)
    }

    /// Rebuilds the grid over finite means, reusing memory. On error the grid is unchanged.
    pub fn rebuild(&mut self, means: &[[f32; 3]]) -> Result<(), IndexError> {
        let shape = grid_shape(means, &mut self.sample)?;
        self.fill(shape, means);
        Ok(())
    }

    /// Sorts means into the cells of `shape`, reusing memory.
    pub(in crate::train) fn fill(&mut self, shape: GridShape, means: &[[f32; 3]]) {
        self.shape = shape;
        self.cell_of_id.resize(means.len(), 0);
        let cells = self.cell_of_id.par_chunks_mut(PART).zip(means.par_chunks(PART));
        cells.for_each(|(cells, means)| {
            for (cell, &mean) in cells.iter_mut().zip(means) {
                *cell = cell_of(&shape, mean) as u32;
            }
        });
        self.sort(means);
    }

    /// Updates the cells of the `moved` components, each listed once. The result equals
    /// [`MeanGrid::fill`]. Other tables with one row per entry can be updated with [`MeanGrid::edits`].
    pub(in crate::train) fn move_means(&mut self, moved: &[u32], means: &[[f32; 3]]) {
        let Self { shape, start, means: sorted, cell_of_id, edits, shifted, .. } = self;
        edits.find(
            moved,
            cell_of_id,
            |id| cell_of(shape, means[id as usize]) as u32,
            |cell| {
                let first = start[cell as usize];
                (first, &sorted.tag[first as usize..start[cell as usize + 1] as usize])
            },
        );
        edits.shift_starts(start);
        shifted.reserve(sorted.len);
        shifted.len = sorted.len;
        let n = sorted.len;
        let Columns { x, y, z, tag, .. } = &mut *shifted;
        let axis = |from: &[f32], to: &mut [f32], axis: usize| {
            edits.apply(&from[..n], &mut to[..n], |id| means[id as usize][axis]);
        };
        rayon::join(
            || {
                axis(&sorted.x, x, 0);
                axis(&sorted.y, y, 1);
            },
            || {
                axis(&sorted.z, z, 2);
                edits.apply(&sorted.tag[..n], &mut tag[..n], |id| id);
            },
        );
        std::mem::swap(sorted, shifted);
        sorted.pad();
    }

    /// Returns the edits of the last [`MeanGrid::move_means`].
    pub(in crate::train) fn edits(&self) -> &Edits {
        &self.edits
    }

    /// Sorts the means by cell; the means of one cell stay in the order of their ids.
    fn sort(&mut self, means: &[[f32; 3]]) {
        let Self { shape, start, means: sorted, cell_of_id, cell_sort, .. } = self;
        sorted.reserve(means.len());
        sorted.len = means.len();
        let Columns { x, y, z, tag: ids, len } = sorted;
        let (x, y, z, ids) = (&mut x[..*len], &mut y[..*len], &mut z[..*len], &mut ids[..*len]);
        // Only ids are sorted; positions are then gathered in that order.
        cell_sort.sort(cell_of_id, shape.n_cells(), start, ids);
        let positions = x.par_chunks_mut(PART).zip(y.par_chunks_mut(PART));
        let positions = positions.zip(z.par_chunks_mut(PART)).zip(ids.par_chunks(PART));
        positions.for_each(|(((x, y), z), ids)| {
            for (((x, y), z), &id) in x.iter_mut().zip(y).zip(z).zip(ids) {
                [*x, *y, *z] = means[id as usize];
            }
        });
        sorted.pad();
    }

    /// Number of means.
    pub fn len(&self) -> usize {
        self.means.len
    }

    /// True if there are no means.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    pub(in crate::train) fn ids(&self) -> &[u32] {
        &self.means.tag[..self.means.len]
    }

    #[inline(always)]
    pub(in crate::train) fn mean(&self, entry: u32) -> [f32; 3] {
        self.means.position(entry as usize)
    }

    pub(super) fn cell(&self) -> f32 {
        self.shape.cell
    }

    /// Returns the largest distance along an axis between a box and the grid's bounds; 0 if they
    /// overlap.
    pub(super) fn gap(&self, lo: [f32; 3], hi: [f32; 3]) -> f32 {
        let GridShape { lo: first, cell, dims, .. } = self.shape;
        (0..3).fold(0f32, |gap, axis| {
            let last = first[axis] + cell * dims[axis] as f32;
            gap.max(first[axis] - hi[axis]).max(lo[axis] - last)
        })
    }

    /// Fills `list` with all entries in the box `lo..hi` grown by `radius`, and possibly others near it.
    #[inline(always)]
    pub(super) fn gather(&self, lo: [f32; 3], hi: [f32; 3], radius: f32, list: &mut Columns) {
        let shape = &self.shape;
        list.len = 0;
        // Loops, because arrays built by closures are compiled for the baseline instruction set.
        let (mut first, mut last) = ([0; 3], [0; 3]);
        for axis in 0..3 {
            first[axis] = coordinate(shape, lo[axis] - radius, axis);
            last[axis] = coordinate(shape, hi[axis] + radius, axis);
        }
        for z in first[2]..=last[2] {
            for y in first[1]..=last[1] {
                let row = (z * shape.dims[1] + y) * shape.dims[0];
                let span = self.start[row + first[0]]..self.start[row + last[0] + 1];
                list.append(&self.means, span.start as usize..span.end as usize);
            }
        }
        list.pad();
    }

    pub(super) fn gather_all(&self, list: &mut Columns) {
        list.len = 0;
        list.append(&self.means, 0..self.means.len);
        list.pad();
    }
}

/// Chooses a grid's geometry in the trimmed bounding box of the means, with one mean per cell on
/// average. An axis shorter than a cell gets one layer of cells.
///
/// # Errors
/// [`IndexError`] if a mean is not finite or there are too many.
pub(in crate::train) fn grid_shape(
    means: &[[f32; 3]],
    sample: &mut Vec<f32>,
) -> Result<GridShape, IndexError> {
    let refuse =
        |reason: &str| Err(IndexError { components: means.len(), reason: reason.to_owned() });
    // Entries and ids are stored in 32 bits.
    if means.len() >= u32::MAX as usize {
        return refuse("too many components");
    }
    // No short circuit, so that the loop is vectorised.
    if !means.as_flattened().iter().fold(true, |all, v| all & v.is_finite()) {
        return refuse("an initial mean is not finite");
    }
    let (lo, extent) = bounds(means, sample);
    let mut longest_first = extent;
    // Of a thin cloud the short axes must not count towards the volume.
    longest_first.sort_by(|a, b| b.total_cmp(a));
    let n = means.len().clamp(1, MAX_CELLS) as f64;
    let [a, b, c] = longest_first;
    let mut cell = (a * b * c / n).cbrt();
    // A cloud thinner than a cell has no volume: cells then divide its face, or its length.
    if !(c >= cell && cell > 0.0) {
        cell = (a * b / n).sqrt();
    }
    if !(b >= cell && cell > 0.0) {
        cell = a / n;
    }
    // All means coincide: any cell size works.
    if cell == 0.0 {
        cell = 1.0;
    }
    let dims = |cell: f64| extent.map(|e| (e / cell) as usize + 1);
    // Short axes are rounded up to one layer each, which may far exceed one cell per mean.
    while dims(cell).iter().fold(1usize, |all, &d| all.saturating_mul(d)) > MAX_CELLS {
        cell *= 1.1;
    }
    // The reciprocal of a denormal cell size exceeds f32.
    let per_unit = (1.0 / cell).min(f64::from(f32::MAX)) as f32;
    let lo = lo.map(|v| v as f32);
    Ok(GridShape { lo, cell: cell as f32, per_unit, dims: dims(cell) })
}

/// Returns the index of a cell along one axis. The index is monotone in `value` even with rounding. So
/// a range of cells holds every mean in the corresponding range of values.
#[inline(always)]
fn coordinate(shape: &GridShape, value: f32, axis: usize) -> usize {
    // The cast saturates, so every value has a cell; infinite ones are clamped to the border.
    let cell = ((value - shape.lo[axis]) * shape.per_unit) as i32;
    cell.clamp(0, shape.dims[axis] as i32 - 1) as usize
}

#[inline(always)]
fn cell_of(shape: &GridShape, mean: [f32; 3]) -> usize {
    let [x, y, z] = std::array::from_fn(|axis| coordinate(shape, mean[axis], axis));
    (z * shape.dims[1] + y) * shape.dims[0] + x
}

/// Returns the lower corner and the edge lengths of the trimmed bounding box of a sample of the means.
fn bounds(means: &[[f32; 3]], sample: &mut Vec<f32>) -> ([f64; 3], [f64; 3]) {
    let (mut lo, mut extent) = ([0.0; 3], [0.0; 3]);
    if means.is_empty() {
        return (lo, extent);
    }
    // A sample suffices: bounds only set the size of cells.
    let stride = means.len().div_ceil(SAMPLE);
    for axis in 0..3 {
        sample.clear();
        sample.extend(means.iter().step_by(stride).map(|m| m[axis]));
        let trimmed = (sample.len() as f64 * TRIM) as usize;
        let last = sample.len() - 1;
        let mut quantile = |rank| f64::from(*sample.select_nth_unstable_by(rank, f32::total_cmp).1);
        let (first, last) = (quantile(trimmed), quantile(last - trimmed));
        let margin = MARGIN * (last - first);
        lo[axis] = first - margin;
        extent[axis] = last - first + 2.0 * margin;
    }
    (lo, extent)
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    #[test]
    fn a_gathered_box_holds_its_means_in_ascending_id_per_cell() {
        let mut rng = Rng::new(1, Purpose::Init, 0);
        let mut means: Vec<[f32; 3]> =
            (0..5000).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect();
        means[17] = [1e6, 0.0, -1e30];
        means.push(means[3]);
        let grid = MeanGrid::new(&means).unwrap();
        assert_eq!(grid.len(), means.len());
        let mut list = Columns::default();
        for _ in 0..200 {
            let lo: [f32; 3] = std::array::from_fn(|_| rng.range(-1.5, 1.0) as f32);
            let hi = lo.map(|v| v + 0.3);
            grid.gather(lo, hi, 0.1, &mut list);
            let mut found: Vec<u32> =
                list.tag[..list.len].iter().map(|&entry| grid.ids()[entry as usize]).collect();
            found.sort_unstable();
            assert!(found.windows(2).all(|w| w[0] < w[1]));
            let inside = |m: &[f32; 3]| (0..3).all(|i| (lo[i] - 0.1..=hi[i] + 0.1).contains(&m[i]));
            for (id, _) in means.iter().enumerate().filter(|(_, m)| inside(m)) {
                assert!(found.binary_search(&(id as u32)).is_ok());
            }
        }
        grid.gather_all(&mut list);
        assert_eq!(list.len, means.len());
        let (first, copy) = (means[3], means.len() as u32 - 1);
        let at = |id| grid.ids().iter().position(|&i| i == id).unwrap();
        assert!(at(3) < at(copy));
        assert_eq!(list.position(at(copy)), first);
    }

    #[test]
    fn shifted_means_lie_where_sorting_puts_them() {
        let mut rng = Rng::new(2, Purpose::Init, 0);
        let mut at = || -> [f32; 3] { std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32) };
        let mut means: Vec<[f32; 3]> = (0..3000).map(|_| at()).collect();
        let mut grid = MeanGrid::new(&means).unwrap();
        for turn in 0..30 {
            // Within the same cell, to other cells, all to one place, and beyond the border.
            let moved: Vec<u32> = (0..97).map(|i| (i * 31 + turn * 7) % 3000).collect();
            for &id in &moved {
                let old = means[id as usize];
                means[id as usize] = match id % 4 {
                    0 => old.map(|v| v + 1e-6),
                    1 => [0.25; 3],
                    2 => old.map(|v| 10.0 * v),
                    _ => at(),
                };
            }
            grid.move_means(&moved, &means);
            let mut sorted = MeanGrid::default();
            sorted.fill(grid.shape, &means);
            assert_eq!((&grid.start, &grid.cell_of_id), (&sorted.start, &sorted.cell_of_id));
            assert_eq!(grid.ids(), sorted.ids());
            for entry in 0..3000 {
                assert_eq!(grid.mean(entry), sorted.mean(entry));
            }
        }
    }

    #[test]
    fn degenerate_bounds_make_few_cells() {
        for means in [
            vec![],
            vec![[3.0; 3]],
            vec![[1.0; 3]; 1000],
            (0..1000).map(|i| [i as f32 * 1e-42, 0.0, 0.0]).collect(),
            (0..1000).map(|i| [i as f32, 5.0, 5.0]).collect(),
            (0..1000).map(|i| [(i % 32) as f32, (i / 32) as f32, 5.0]).collect(),
            (0..1000).map(|i| [(i - 500) as f32 * 6e35; 3]).collect(),
        ] {
            let grid = MeanGrid::new(&means).unwrap();
            assert!(grid.shape.n_cells() <= 3 * means.len() + 8, "{:?}", grid.shape);
            let mut list = Columns::default();
            grid.gather([-f32::MAX; 3], [f32::MAX; 3], f32::INFINITY, &mut list);
            assert_eq!(list.len, means.len());
        }
    }
}
