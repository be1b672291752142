//! The index over the initial spatial means, in the form a configuration asks for.

use super::config::IndexKind;
use super::scalar::PaperScalar;
use crate::math::real::Real;
use crate::model::paper::mixture::InitialModel;
use crate::model::paper::mixture_device::MeanCells;
use crate::train::candidates::{IndexError, KdTree, MeanGrid};
use rayon::prelude::*;

/// Entries one task takes.
const PART: usize = 1 << 14;

/// A grid, always, and beside it a KD-tree where the plain path is asked for.
pub struct Index {
    grid: MeanGrid,
    tree: Option<KdTree>,
    /// Means rounded to f32, where they are not f32 already.
    narrowed: Vec<[f32; 3]>,
    /// By entry of the grid the mean colour and the weight, for a model kept in f32: what the fused
    /// kernels read, side by side where their components lie side by side.
    appearance: Vec<[f32; 4]>,
    /// Times it was built.
    revision: u64,
}

impl Index {
    /// Over the finite means of a model.
    pub fn new<R: PaperScalar>(
        model: &InitialModel<R>,
        kind: IndexKind,
    ) -> Result<Self, IndexError> {
        let mut index = Self {
            grid: MeanGrid::default(),
            tree: None,
            narrowed: Vec::new(),
            appearance: Vec::new(),
            revision: 0,
        };
        if kind == IndexKind::KdTree {
            index.tree = Some(tree(&model.space)?);
        }
        index.rebuild_grid(model)?;
        Ok(index)
    }

    /// Builds the index again after means have moved. On error it is as it was.
    pub fn rebuild<R: PaperScalar>(&mut self, model: &InitialModel<R>) -> Result<(), IndexError> {
        // Either may fail: nothing is replaced before both are built.
        let tree = self.tree.as_ref().map(|_| tree(&model.space)).transpose()?;
        self.rebuild_grid(model)?;
        self.tree = tree;
        Ok(())
    }

    fn rebuild_grid<R: PaperScalar>(&mut self, model: &InitialModel<R>) -> Result<(), IndexError> {
        let Self { grid, narrowed, appearance, .. } = self;
        grid.rebuild(R::narrow_rows(&model.space, narrowed))?;
        if let Some(model) = R::narrow_model(model) {
            appearance.resize(model.len(), [0.0; 4]);
            let parts = appearance.par_chunks_mut(PART).zip(grid.ids().par_chunks(PART));
            parts.for_each(|(appearance, ids)| {
                for (of_entry, &id) in appearance.iter_mut().zip(ids) {
                    let ([r, g, b], w) = (model.color[id as usize], model.weight[id as usize]);
                    *of_entry = [r, g, b, w];
                }
            });
        }
        self.revision += 1;
        Ok(())
    }

    /// The grid with what the fused kernels read beside it, for a device.
    pub fn cells(&self) -> MeanCells<'_> {
        self.grid.cells(&self.appearance)
    }

    /// A number that changes whenever the index does.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// By entry of the grid the mean colour and the weight; empty for a model kept in f64.
    pub fn appearance(&self) -> &[[f32; 4]] {
        &self.appearance
    }

    /// The grid, over the means rounded to f32.
    pub fn grid(&self) -> &MeanGrid {
        &self.grid
    }

    /// The KD-tree of the plain path.
    pub fn tree(&self) -> Option<&KdTree> {
        self.tree.as_ref()
    }
}

fn tree<R: Real>(means: &[[R; 3]]) -> Result<KdTree, IndexError> {
    let widened: Vec<[f64; 3]> = means.iter().map(|m| m.map(R::to_f64)).collect();
    KdTree::new(&widened)
}
