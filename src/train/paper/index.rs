//! Index over the initial spatial means.
//!
//! After means have moved, the grid is built only on first use, because a device may build its own.
//! Everything that can fail is done earlier, when means move.

use crate::math::real::Real;
use crate::model::paper::mixture_device::{GridShape, MeanCells};
use crate::model::paper::state::{InitialMeans, InitialModel};
use crate::observation::points::Points;
use crate::train::candidates::{IndexError, MeanGrid, grid_shape};
use rayon::prelude::*;
use std::any::Any;
use std::sync::{Mutex, OnceLock, PoisonError};

const PART: usize = 1 << 12;
// Incremental updates are used if at most one component in 64 moves; otherwise sorting again is faster.
const FEW: usize = 64;
// Cells are recomputed once more than a quarter of the components have moved.
const STALE: usize = 4;

/// Index over the initial spatial means: a grid that is sorted on first use.
pub struct Index {
    shape: GridShape,
    /// Scratch memory for the sample of means from which the grid's shape is computed.
    sample: Vec<f32>,
    sorted: OnceLock<SortedMeans>,
    /// Memory of the previous grid, for reuse.
    spare: Mutex<SortedMeans>,
    moved: Vec<u32>,
    /// True if few components have changed since the last sort and the cells are unchanged. All changed
    /// components are then in `moved`.
    is_incremental: bool,
    n_moved: usize,
    revision: u64,
}

/// Means sorted by grid cell.
#[derive(Default)]
pub struct SortedMeans {
    /// Grid over the spatial means, rounded to f32.
    pub grid: MeanGrid,
    /// Mean colour (three values) and weight of each grid entry, for models in f32. In this order,
    /// fused kernels read neighbouring memory.
    pub appearance: Vec<[f32; 4]>,
    /// Spatial means rounded to f32, unless they are f32 already.
    narrowed: Vec<[f32; 3]>,
    shifted: Vec<[f32; 4]>,
}

impl Index {
    /// Builds the index over a model's finite means.
    pub fn new<R: PaperScalar>(model: &InitialModel<R>) -> Result<Self, IndexError> {
        let mut index = Self {
            shape: GridShape::default(),
            sample: Vec::new(),
            sorted: OnceLock::new(),
            spare: Mutex::default(),
            moved: Vec::new(),
            is_incremental: false,
            n_moved: 0,
            revision: 0,
        };
        index.shape = index.shape_of(model)?;
        index.sorted(model);
        Ok(index)
    }

    /// Registers that components of a model have moved; the index is updated on next use. On error the
    /// index is unchanged.
    pub fn update_moved<R: PaperScalar>(
        &mut self,
        model: &InitialModel<R>,
        moved: impl Iterator<Item = u32> + Clone,
    ) -> Result<(), IndexError> {
        let n = moved.clone().count();
        // A mean that is not finite takes the path through `shape_of`, which reports it.
        let is_finite = |id: u32| model.space[id as usize].iter().all(|v| v.to_f64().is_finite());
        let keeps_cells = STALE * (self.n_moved + n) <= model.len() && moved.clone().all(is_finite);
        let shape = if keeps_cells { self.shape } else { self.shape_of(model)? };
        self.shape = shape;
        self.n_moved = if keeps_cells { self.n_moved + n } else { 0 };
        // Without sorted means, an earlier move is still pending, and only the last one is listed.
        self.is_incremental = keeps_cells && FEW * n <= model.len() && self.sorted.get().is_some();
        if let Some(sorted) = self.sorted.take() {
            // The lock is held only to take the value, so a poisoned one still holds a whole grid.
            *self.spare.get_mut().unwrap_or_else(PoisonError::into_inner) = sorted;
        }
        self.moved.clear();
        self.moved.extend(moved);
        // Unique, since an entry is removed from its cell once.
        self.moved.sort_unstable();
        self.moved.dedup();
        self.revision += 1;
        Ok(())
    }

    fn shape_of<R: PaperScalar>(
        &mut self,
        model: &InitialModel<R>,
    ) -> Result<GridShape, IndexError> {
        let Self { sample, spare, .. } = self;
        let spare = spare.get_mut().unwrap_or_else(PoisonError::into_inner);
        // The grid is in f32 in either precision: margins of the search cover the rounding.
        grid_shape(R::narrow_rows(&model.space, &mut spare.narrowed), sample)
    }

    /// Returns the spatial means of the current model, sorted by cell.
    ///
    /// The first call sorts the means on all threads, so it must not be made from several threads at
    /// once.
    pub fn sorted<R: PaperScalar>(&self, model: &InitialModel<R>) -> &SortedMeans {
        self.sorted.get_or_init(|| {
            let mut sorted =
                std::mem::take(&mut *self.spare.lock().unwrap_or_else(PoisonError::into_inner));
            match self.is_incremental {
                true => sorted.shift(&self.moved, model),
                false => sorted.fill(self.shape, model),
            }
            sorted
        })
    }

    /// Returns the means for upload to a device that already holds the means of revision `known`.
    pub fn means_for_device<'a>(
        &'a self,
        model: &'a InitialModel<f32>,
        known: Option<u64>,
    ) -> MeanCells<'a> {
        let InitialModel { space, color, weight, .. } = model;
        // Only the last move is listed; a device that missed one needs all means.
        let is_last = known.is_some_and(|known| known + 1 == self.revision);
        let moved = is_last.then_some(&self.moved[..]);
        MeanCells { shape: self.shape, space, color, weight, changed_components: moved }
    }

    /// Returns the revision number, which grows by one whenever means move.
    pub fn revision(&self) -> u64 {
        self.revision
    }
}

impl SortedMeans {
    fn fill<R: PaperScalar>(&mut self, shape: GridShape, model: &InitialModel<R>) {
        let Self { grid, appearance, narrowed, .. } = self;
        grid.fill(shape, R::narrow_rows(&model.space, narrowed));
        // Only the fused kernels, which are in f32, read the appearance.
        let Some(model) = narrow::<_, InitialModel<f32>>(model) else { return };
        appearance.resize(model.len(), [0.0; 4]);
        let parts = appearance.par_chunks_mut(PART).zip(grid.ids().par_chunks(PART));
        parts.for_each(|(appearance, ids)| {
            for (of_entry, &id) in appearance.iter_mut().zip(ids) {
                *of_entry = appearance_of(model, id);
            }
        });
    }

    fn shift<R: PaperScalar>(&mut self, moved: &[u32], model: &InitialModel<R>) {
        let Self { grid, appearance, narrowed, shifted } = self;
        grid.move_means(moved, R::narrow_rows(&model.space, narrowed));
        let Some(model) = narrow::<_, InitialModel<f32>>(model) else { return };
        shifted.resize(model.len(), [0.0; 4]);
        grid.edits().apply(appearance, shifted, |id| appearance_of(model, id));
        std::mem::swap(appearance, shifted);
    }
}

fn appearance_of(model: &InitialModel<f32>, id: u32) -> [f32; 4] {
    let ([r, g, b], weight) = (model.color[id as usize], model.weight[id as usize]);
    [r, g, b, weight]
}

/// Returns `value` if its type is `B`, else `None`. With `B` in f32, this selects f32 data in code of
/// generic precision.
pub(super) fn narrow<A: Any, B: Any>(value: &A) -> Option<&B> {
    (value as &dyn Any).downcast_ref()
}

/// Number type of a mixture's points and means: `f32`, required by the fused kernels, or `f64`, the
/// reference.
pub trait PaperScalar: Real {
    /// Returns a frame's points in this number type, converted into `memory` if needed.
    fn points<'a>(points: &'a Points<f32>, memory: &'a mut Points<Self>) -> &'a Points<Self>;

    /// Returns rows rounded to f32, copied into `memory` if needed.
    fn narrow_rows<'a>(rows: &'a [[Self; 3]], memory: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]];

    /// Converts means of position and colour to the form stored in checkpoints.
    fn means(space: &[[Self; 3]], color: &[[Self; 3]]) -> InitialMeans;
}

impl PaperScalar for f32 {
    fn points<'a>(points: &'a Points<f32>, _: &'a mut Points<f32>) -> &'a Points<f32> {
        points
    }

    fn narrow_rows<'a>(rows: &'a [[f32; 3]], _: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        rows
    }

    fn means(space: &[[f32; 3]], color: &[[f32; 3]]) -> InitialMeans {
        InitialMeans::F32 { space: space.to_vec(), color: color.to_vec() }
    }
}

impl PaperScalar for f64 {
    fn points<'a>(points: &'a Points<f32>, memory: &'a mut Points<f64>) -> &'a Points<f64> {
        points.cast_into(memory);
        memory
    }

    fn narrow_rows<'a>(rows: &'a [[f64; 3]], memory: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        memory.clear();
        memory.extend(rows.iter().map(|row| row.map(|v| v as f32)));
        memory
    }

    fn means(space: &[[f64; 3]], color: &[[f64; 3]]) -> InitialMeans {
        InitialMeans::F64 { space: space.to_vec(), color: color.to_vec() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::paper::config::{PaperConfig, PaperOverrides};
    use crate::train::paper::init::InitialDraw;

    #[test]
    fn few_moves_leave_what_sorting_all_means_finds() {
        let n = 2000;
        let overrides = PaperOverrides { components: Some(n), ..PaperOverrides::default() };
        let config = PaperConfig::paper().with(&overrides).unwrap();
        let draw = InitialDraw::random(n, 0);
        let mut model = InitialModel::<f32>::new(config.hyper(), &draw.means, &draw.alpha);
        let mut index = Index::new(&model).unwrap();
        let (mut n_shifts, mut n_sorts) = (0, 0);
        for turn in 0..60u32 {
            let moved = (0..20).map(|i| (i * 97 + turn * 13) % n as u32);
            for id in moved.clone() {
                let at = id as f32 * 1e-3 - 0.01 * turn as f32;
                model.replace_mean(id as usize, ([at, at.sin(), 0.3], [at; 3]));
            }
            index.update_moved(&model, moved).unwrap();
            *(if index.is_incremental { &mut n_shifts } else { &mut n_sorts }) += 1;
            let mut all = SortedMeans::default();
            all.fill(index.shape, &model);
            let sorted = index.sorted(&model);
            assert_eq!(sorted.grid.ids(), all.grid.ids(), "{turn}");
            assert_eq!(sorted.appearance, all.appearance, "{turn}");
        }
        assert!(n_shifts > 40 && n_sorts > 1, "{n_shifts} shifts, {n_sorts} sorts");
    }

    #[test]
    fn whoever_heard_last_is_told_what_moved_and_others_of_all() {
        let overrides = PaperOverrides { components: Some(50), ..PaperOverrides::default() };
        let config = PaperConfig::paper().with(&overrides).unwrap();
        let draw = InitialDraw::random(config.components, 0);
        let mut model = InitialModel::<f32>::new(config.hyper(), &draw.means, &draw.alpha);
        let mut index = Index::new(&model).unwrap();
        let begun = index.revision();
        model.replace_mean(7, ([0.5; 3], [0.1; 3]));
        index.update_moved(&model, [7].into_iter()).unwrap();
        assert_eq!(index.means_for_device(&model, Some(begun)).changed_components, Some(&[7][..]));
        assert_eq!(index.means_for_device(&model, None).changed_components, None);
        model.replace_mean(9, ([-0.5; 3], [0.1; 3]));
        index.update_moved(&model, [9].into_iter()).unwrap();
        assert_eq!(index.means_for_device(&model, Some(begun)).changed_components, None);
        let sorted = index.sorted(&model);
        let place = sorted.grid.ids().iter().position(|&id| id == 9).unwrap();
        assert_eq!(sorted.grid.mean(place as u32), [-0.5; 3]);
        assert_eq!(sorted.appearance[place][..3], [0.1; 3]);
        model.replace_mean(3, ([f32::NAN; 3], [0.0; 3]));
        assert!(index.update_moved(&model, [3].into_iter()).is_err());
        assert_eq!(
            index.means_for_device(&model, Some(begun + 1)).changed_components,
            Some(&[9][..])
        );
    }
}
