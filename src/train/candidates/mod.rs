//! Exact C-nearest search over the initial spatial means: a uniform grid searched tile by tile in
//! f32, `kiddo`'s immutable KD-tree in f64, the oracle. In f32 `kiddo` wins at no size that
//! `benches/candidates.rs` tries (10 to 10⁵ means, 1 to 1024 neighbours), so nothing switches to it.

mod columns;
mod grid;
mod kernel;
mod search;

pub use grid::Grid;
pub use search::Scratch;

use crate::math::points::Points;
use crate::math::real::Real;
use crate::model::state::Means;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;
use std::ops::Range;

/// The index could not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "building the candidate index over {components} components failed: {reason}; try fewer --components"
)]
pub struct IndexError {
    /// Number of means.
    pub components: usize,
    /// What the index said.
    pub reason: String,
}

/// A precision in which candidates can be searched.
///
/// Nearest means those of smallest squared distance `(dx² + dy²) + dz²`, computed in this
/// precision; among equals those of lowest id. All methods append ids in that order.
pub trait Scalar: Real {
    /// The index over means of this precision.
    type Index: Send + Sync;
    /// Memory of a search that is worth keeping; its contents never change a result.
    type Scratch: Default + Send;

    /// Builds the index over finite means.
    fn build(means: &[[Self; 3]]) -> Result<Self::Index, IndexError>;

    /// Builds the index again over other means. On error it is as it was.
    fn rebuild(index: &mut Self::Index, means: &[[Self; 3]]) -> Result<(), IndexError>;

    /// Appends the ids of the `n` nearest means; fewer if there are fewer.
    fn nearest(index: &Self::Index, query: &[Self; 3], n: NonZero<usize>, ids: &mut Vec<u32>);

    /// Means of this precision, as checkpoints hold them.
    fn means(space: &[[Self; 3]], color: &[[Self; 3]]) -> Means;

    /// Appends, point by point, the ids of the `n` nearest means of every point in `range`: as
    /// many for each, `n` or the number of means if that is less. Fast where the points of the
    /// range are neighbours.
    fn nearest_in_tile(
        index: &Self::Index,
        scratch: &mut Self::Scratch,
        points: &Points<Self>,
        range: Range<usize>,
        n: NonZero<usize>,
        ids: &mut Vec<u32>,
    );
}

impl Scalar for f32 {
    type Index = Grid;
    type Scratch = Scratch;

    fn means(space: &[[f32; 3]], color: &[[f32; 3]]) -> Means {
        Means::F32 { space: space.to_vec(), color: color.to_vec() }
    }

    fn build(means: &[[f32; 3]]) -> Result<Grid, IndexError> {
        let mut grid = Grid::default();
        grid.rebuild(means)?;
        Ok(grid)
    }

    fn rebuild(index: &mut Grid, means: &[[f32; 3]]) -> Result<(), IndexError> {
        index.rebuild(means)
    }

    fn nearest(index: &Grid, query: &[f32; 3], n: NonZero<usize>, ids: &mut Vec<u32>) {
        let [x, y, z] = query.map(|v| [v]);
        Scratch::default().nearest(index, [&x, &y, &z], n, ids);
    }

    fn nearest_in_tile(
        index: &Grid,
        scratch: &mut Scratch,
        points: &Points<f32>,
        range: Range<usize>,
        n: NonZero<usize>,
        ids: &mut Vec<u32>,
    ) {
        let tile = [&points.x[range.clone()], &points.y[range.clone()], &points.z[range]];
        scratch.nearest(index, tile, n, ids);
    }
}

impl Scalar for f64 {
    type Index = ImmutableKdTree<f64, 3>;
    type Scratch = ();

    fn means(space: &[[f64; 3]], color: &[[f64; 3]]) -> Means {
        Means::F64 { space: space.to_vec(), color: color.to_vec() }
    }

    fn build(means: &[[f64; 3]]) -> Result<Self::Index, IndexError> {
        ImmutableKdTree::new_from_slice(means)
            .map_err(|e| IndexError { components: means.len(), reason: e.to_string() })
    }

    fn rebuild(index: &mut Self::Index, means: &[[f64; 3]]) -> Result<(), IndexError> {
        *index = Self::build(means)?;
        Ok(())
    }

    fn nearest(index: &Self::Index, query: &[f64; 3], n: NonZero<usize>, ids: &mut Vec<u32>) {
        // One more than asked for shows whether the last one has an equal.
        let query = index.query(query);
        let found = query.nearest_n::<SquaredEuclidean<f64>>(n.saturating_add(1)).execute();
        let mut found: Vec<(f64, u32)> = found.iter().map(|f| (f.distance, f.item)).collect();
        if let Some(&(beyond, _)) = found.get(n.get())
            && found[n.get() - 1].0 == beyond
        {
            let equals = query.within::<SquaredEuclidean<f64>>(beyond).execute();
            found = equals.iter().map(|f| (f.distance, f.item)).collect();
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ids.extend(found.iter().take(n.get()).map(|&(_, id)| id));
    }

    fn nearest_in_tile(
        index: &Self::Index,
        _scratch: &mut (),
        points: &Points<f64>,
        range: Range<usize>,
        n: NonZero<usize>,
        ids: &mut Vec<u32>,
    ) {
        for point in range {
            Self::nearest(index, &points.position(point), n, ids);
        }
    }
}
