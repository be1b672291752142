//! Draws splats by compute shaders: sorted by depth, then by tile, and blended by one workgroup per tile
//! (`rendering.md`, Tiles by compute). Suits chips with much compute and few raster units.
//!
//! 1. Preprocess: computes a record, a depth key and the covered tiles of each splat.
//! 2. Sort: sorts by depth and drops invisible splats. Then writes, in depth order, one entry per tile of
//!    each splat, and sorts the entries by tile, which preserves the depth order.
//! 3. Draw: one workgroup per tile blends its entries front to back until its pixels are full.
//!
//! No stage waits for the GPU, and no counter is read back within a frame: kernels run on grids
//! large enough for any count and exit early.

mod buffers;
mod capacity;
mod constants;
mod plan;
mod renderer;
pub mod shader;
pub mod sort;

pub(super) use renderer::{TileFrame, TilePath};
