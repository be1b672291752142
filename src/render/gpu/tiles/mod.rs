//! Splats to pixels by compute: sorted by depth, sorted into tiles, blended by one workgroup a tile
//! (`rendering.md`, Tiles by compute). The path for chips with much compute and few raster units.
//!
//! 1. Preprocess: a record, a key of depth and the tiles it reaches for each splat.
//! 2. Sort: by depth, what is not drawn falls out; then, in order of depth, an entry for each tile of
//!    each splat; then by tile, which keeps the order of depth.
//! 3. Draw: one workgroup a tile blends its entries front to back until its pixels are full.
//!
//! Nothing here waits for the GPU, and no count comes back within a frame: kernels run on grids that
//! are large enough for any count and end early.

mod buffers;
mod capacity;
mod constants;
mod plan;
mod renderer;
pub mod shader;
pub mod sort;

pub(super) use renderer::{TileFrame, TilePath};
