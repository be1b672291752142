//! The index over the initial spatial means, in the form a configuration asks for.

use super::candidates::{Grid, IndexError, KdTree};
use super::config::IndexKind;
use super::scalar::Scalar;
use crate::math::real::Real;

/// A grid, always, and beside it a KD-tree where the plain path is asked for.
pub struct Index {
    grid: Grid,
    tree: Option<KdTree>,
    /// Means rounded to f32, where they are not f32 already.
    narrowed: Vec<[f32; 3]>,
}

impl Index {
    /// Over finite means.
    pub fn new<R: Scalar>(means: &[[R; 3]], kind: IndexKind) -> Result<Self, IndexError> {
        let mut index = Self { grid: Grid::default(), tree: None, narrowed: Vec::new() };
        if kind == IndexKind::KdTree {
            index.tree = Some(tree(means)?);
        }
        index.rebuild_grid(means)?;
        Ok(index)
    }

    /// Builds the index again over other means. On error it is as it was.
    pub fn rebuild<R: Scalar>(&mut self, means: &[[R; 3]]) -> Result<(), IndexError> {
        let tree = self.tree.as_ref().map(|_| tree(means)).transpose()?;
        self.rebuild_grid(means)?;
        self.tree = tree;
        Ok(())
    }

    fn rebuild_grid<R: Scalar>(&mut self, means: &[[R; 3]]) -> Result<(), IndexError> {
        let Self { grid, narrowed, .. } = self;
        grid.rebuild(R::narrow_rows(means, narrowed))
    }

    /// The grid, over the means rounded to f32.
    pub fn grid(&self) -> &Grid {
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
