//! Exact C-nearest search over the initial spatial means: a uniform grid searched tile by tile, and
//! `kiddo`'s KD-tree as plain path and oracle. `kiddo` wins at no size that `benches/candidates.rs`
//! tries (10 to 10⁵ means, 1 to 1024 neighbours), so nothing switches to it.

mod columns;
mod error;
mod extent;
mod grid;
mod kd_tree;
mod kernel;
mod lists;
mod nearest;
mod search;

pub(in crate::train) use columns::Columns;
pub use error::IndexError;
pub use grid::MeanGrid;
pub use kd_tree::KdTree;
pub(in crate::train) use lists::{Among, CHUNK, Lists, Nearest};
pub use nearest::{nearest_in_tile, nearest_in_tile_wide};
pub use search::CandidateSearch;
pub(in crate::train) use search::VisitChunk;
