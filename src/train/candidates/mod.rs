//! Exact search for the C nearest initial spatial means: a uniform grid searched tile by tile.
//!
//! With a KD-tree, one query per point took four fifths of a frame's time. Rebuilding a grid takes a
//! fifth of the time of rebuilding a tree. The points of a tile share a list of candidate means, so
//! most work is done once per 64 points. `kiddo` is slower at all sizes in `benches/candidates.rs` (10
//! to 10⁵ means, 1 to 1024 neighbours).
//!
//! Rejected alternatives (`training.md`, Tried and dropped): insertion with branches or blends (the
//! kernel takes twice as long), chunks of 8 points, bounds for a whole tile (99 candidates instead of
//! 57), finer grids where means cluster (a tenth faster, but only on such data).

mod cell_sort;
mod extent;
mod grid;
mod kernel;
mod lists;
mod nearest;

pub(in crate::train) use extent::AnyWithin;
pub use grid::MeanGrid;
pub(in crate::train) use grid::grid_shape;
pub(in crate::train) use kernel::{CHUNK, Columns};
pub(in crate::train) use lists::{ListKind, Lists, Nearest};
pub(in crate::train) use nearest::VisitChunk;
pub use nearest::{CandidateSearch, nearest_in_tile, nearest_in_tile_wide};

/// Error of building the candidate index.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "building the candidate index over {components} components failed: {reason}; try fewer components"
)]
pub struct IndexError {
    /// Number of means.
    pub components: usize,
    /// Reason why the index could not be built.
    pub reason: String,
}
