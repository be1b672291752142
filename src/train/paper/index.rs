//! The index over the initial spatial means, in the form a configuration asks for.
//!
//! The grid is made when it is first asked for after means have moved: where a device makes its own, the
//! processor may never want it. What can fail fails before, when means move.

use super::config::IndexKind;
use super::scalar::PaperScalar;
use crate::math::real::Real;
use crate::model::paper::mixture::InitialModel;
use crate::model::paper::mixture_device::{GridShape, MeanCells};
use crate::train::candidates::{IndexError, KdTree, MeanGrid, grid_shape};
use rayon::prelude::*;
use std::sync::{Mutex, OnceLock, PoisonError};

/// Entries one task takes.
const PART: usize = 1 << 12;
/// Of so many components one may move for the others to keep their order: to sort all anew takes less where more move.
const FEW: usize = 64;
/// Of so many components one may have moved since cells were made for all of them.
const STALE: usize = 4;

/// A grid, always, and beside it a KD-tree where the plain path is asked for.
pub struct Index {
    tree: Option<KdTree>,
    shape: GridShape,
    /// Coordinates that the shape is taken from.
    sample: Vec<f32>,
    sorted: OnceLock<SortedMeans>,
    /// Memory of the last.
    spare: Mutex<SortedMeans>,
    /// Components that moved at last.
    moved: Vec<u32>,
    /// Whether these alone have moved since means were sorted, few of them, in the same cells.
    is_shift: bool,
    /// How many have moved since there are these cells.
    n_moved: usize,
    /// Times that means have moved.
    revision: u64,
}

/// Means in the order of their cells.
#[derive(Default)]
pub struct SortedMeans {
    /// The grid, over the means rounded to f32.
    pub grid: MeanGrid,
    /// By entry of the grid the mean colour and the weight, for a model kept in f32: what the fused
    /// kernels read, side by side where their components lie side by side.
    pub appearance: Vec<[f32; 4]>,
    /// Means rounded to f32, where they are not f32 already.
    narrowed: Vec<[f32; 3]>,
    /// Memory for the next appearance.
    shifted: Vec<[f32; 4]>,
}

impl Index {
    /// Over the finite means of a model.
    pub fn new<R: PaperScalar>(
        model: &InitialModel<R>,
        kind: IndexKind,
    ) -> Result<Self, IndexError> {
        let tree = (kind == IndexKind::KdTree).then(|| tree(&model.space)).transpose()?;
        let mut index = Self {
            tree,
            shape: GridShape::default(),
            sample: Vec::new(),
            sorted: OnceLock::new(),
            spare: Mutex::default(),
            moved: Vec::new(),
            is_shift: false,
            n_moved: 0,
            revision: 0,
        };
        index.shape = index.shape_of(model)?;
        index.sorted(model);
        Ok(index)
    }

    /// Takes over that components of a model have moved. On error it is as it was.
    pub fn renew<R: PaperScalar>(
        &mut self,
        model: &InitialModel<R>,
        moved: impl Iterator<Item = u32> + Clone,
    ) -> Result<(), IndexError> {
        let n = moved.clone().count();
        let is_finite = |id: u32| model.space[id as usize].iter().all(|v| v.to_f64().is_finite());
        let keeps_cells = STALE * (self.n_moved + n) <= model.len() && moved.clone().all(is_finite);
        // Either may fail: nothing is replaced before both are known.
        let shape = if keeps_cells { self.shape } else { self.shape_of(model)? };
        if self.tree.is_some() {
            self.tree = Some(tree(&model.space)?);
        }
        self.shape = shape;
        self.n_moved = if keeps_cells { self.n_moved + n } else { 0 };
        self.is_shift = keeps_cells && FEW * n <= model.len() && self.sorted.get().is_some();
        if let Some(sorted) = self.sorted.take() {
            *self.spare.get_mut().unwrap_or_else(PoisonError::into_inner) = sorted;
        }
        self.moved.clear();
        self.moved.extend(moved);
        // Each once: an entry leaves its cell once.
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
        grid_shape(R::narrow_rows(&model.space, &mut spare.narrowed), sample)
    }

    /// Means in the order of their cells, of the model that was handed over last. Whoever asks for the
    /// first time sorts them on all threads, and must not be one of several that ask at once.
    pub fn sorted<R: PaperScalar>(&self, model: &InitialModel<R>) -> &SortedMeans {
        self.sorted.get_or_init(|| {
            let mut sorted =
                std::mem::take(&mut *self.spare.lock().unwrap_or_else(PoisonError::into_inner));
            match self.is_shift {
                true => sorted.shift(&self.moved, model),
                false => sorted.fill(self.shape, model),
            }
            sorted
        })
    }

    /// The means of a model for a device that has those of a revision.
    pub fn cells<'a>(&'a self, model: &'a InitialModel<f32>, known: Option<u64>) -> MeanCells<'a> {
        let InitialModel { space, color, weight, .. } = model;
        let is_last = known.is_some_and(|known| known + 1 == self.revision);
        let moved = is_last.then_some(&self.moved[..]);
        MeanCells { shape: self.shape, space, color, weight, moved }
    }

    /// A number that changes whenever means have moved.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The KD-tree of the plain path.
    pub fn tree(&self) -> Option<&KdTree> {
        self.tree.as_ref()
    }
}

impl SortedMeans {
    fn fill<R: PaperScalar>(&mut self, shape: GridShape, model: &InitialModel<R>) {
        let Self { grid, appearance, narrowed, .. } = self;
        grid.fill(shape, R::narrow_rows(&model.space, narrowed));
        let Some(model) = R::narrow_model(model) else { return };
        appearance.resize(model.len(), [0.0; 4]);
        let parts = appearance.par_chunks_mut(PART).zip(grid.ids().par_chunks(PART));
        parts.for_each(|(appearance, ids)| {
            for (of_entry, &id) in appearance.iter_mut().zip(ids) {
                *of_entry = appearance_of(model, id);
            }
        });
    }

    /// Takes over that few components have moved.
    fn shift<R: PaperScalar>(&mut self, moved: &[u32], model: &InitialModel<R>) {
        let Self { grid, appearance, narrowed, shifted } = self;
        grid.shift(moved, R::narrow_rows(&model.space, narrowed));
        let Some(model) = R::narrow_model(model) else { return };
        shifted.resize(model.len(), [0.0; 4]);
        grid.edits().apply(appearance, shifted, |id| appearance_of(model, id));
        std::mem::swap(appearance, shifted);
    }
}

/// Mean colour and weight of a component.
fn appearance_of(model: &InitialModel<f32>, id: u32) -> [f32; 4] {
    let ([r, g, b], weight) = (model.color[id as usize], model.weight[id as usize]);
    [r, g, b, weight]
}

fn tree<R: Real>(means: &[[R; 3]]) -> Result<KdTree, IndexError> {
    let widened: Vec<[f64; 3]> = means.iter().map(|m| m.map(R::to_f64)).collect();
    KdTree::new(&widened)
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
        let mut index = Index::new(&model, config.index).unwrap();
        let (mut n_shifts, mut n_sorts) = (0, 0);
        for turn in 0..60u32 {
            let moved = (0..20).map(|i| (i * 97 + turn * 13) % n as u32);
            for id in moved.clone() {
                let at = id as f32 * 1e-3 - 0.01 * turn as f32;
                model.replace_mean(id as usize, ([at, at.sin(), 0.3], [at; 3]));
            }
            index.renew(&model, moved).unwrap();
            *(if index.is_shift { &mut n_shifts } else { &mut n_sorts }) += 1;
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
        let mut index = Index::new(&model, config.index).unwrap();
        let begun = index.revision();
        model.replace_mean(7, ([0.5; 3], [0.1; 3]));
        index.renew(&model, [7].into_iter()).unwrap();
        assert_eq!(index.cells(&model, Some(begun)).moved, Some(&[7][..]));
        assert_eq!(index.cells(&model, None).moved, None);
        model.replace_mean(9, ([-0.5; 3], [0.1; 3]));
        index.renew(&model, [9].into_iter()).unwrap();
        assert_eq!(index.cells(&model, Some(begun)).moved, None);
        let sorted = index.sorted(&model);
        let place = sorted.grid.ids().iter().position(|&id| id == 9).unwrap();
        assert_eq!(sorted.grid.mean(place as u32), [-0.5; 3]);
        assert_eq!(sorted.appearance[place][..3], [0.1; 3]);
        model.replace_mean(3, ([f32::NAN; 3], [0.0; 3]));
        assert!(index.renew(&model, [3].into_iter()).is_err());
        assert_eq!(index.cells(&model, Some(begun + 1)).moved, Some(&[9][..]));
    }
}
