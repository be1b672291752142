//! Exact C-nearest search over the initial spatial means: a uniform grid searched tile by tile, and
//! `kiddo`'s KD-tree as plain path and oracle. `kiddo` wins at no size that `benches/candidates.rs`
//! tries (10 to 10⁵ means, 1 to 1024 neighbours), so nothing switches to it.

mod columns;
mod grid;
mod kd_tree;
mod kernel;
mod lists;
mod nearest;
mod search;

pub(in crate::train) use columns::Columns;
pub use grid::Grid;
pub use kd_tree::KdTree;
pub(in crate::train) use lists::{Among, Lists, Nearest};
pub use nearest::{nearest_in_tile, nearest_in_tile_wide};
pub use search::Search;
pub(in crate::train) use search::{CHUNK, VisitChunk};

/// The index could not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "building the candidate index over {components} components failed: {reason}; try fewer components"
)]
pub struct IndexError {
    /// Number of means.
    pub components: usize,
    /// What the index said.
    pub reason: String,
}
