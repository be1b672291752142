//! CPU renderer, for evaluation and for the viewport on machines without a GPU.
//!
//! Four stages (`rendering.md`, CPU renderer): prepare records, list them per row of tiles, radix sort
//! each list by depth, rasterise (one task per row). One thread draws a tile from one sorted list, so
//! images are bit-identical for any number of threads and any instruction set.

mod bounds;
mod buckets;
mod exact;
pub mod photometric;
mod prepare;
pub(super) mod projected;
mod raster;
mod record;
mod renderer;
mod rows;
mod shade;
pub mod surfaces;
pub(super) mod textures;
mod tile;
pub(super) mod view;

pub use renderer::{CpuRenderer, CpuStage, Rendered};
