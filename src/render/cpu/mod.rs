//! The CPU renderer: evaluation everywhere, and the viewport where no real GPU exists.
//!
//! Four stages (`rendering.md`, CPU renderer): prepare (parallel), radix sort by depth, list splats
//! per row of tiles, rasterise (one task per row of tiles). A tile is drawn by one thread from one
//! sorted list, so an image has the same bits for any number of threads; every instruction set
//! gives them too.

mod bounds;
mod buckets;
mod conic;
mod drawn;
mod exact;
mod lanes;
mod lists;
mod longest_first;
pub mod photometric;
mod prepare;
mod projected;
mod raster;
mod record;
mod renderer;
mod rows;
mod shade;
mod sort;
mod tile;
mod view;

pub use renderer::{CpuRenderer, CpuStage, Rendered};
