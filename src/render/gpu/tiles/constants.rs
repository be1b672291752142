//! Sizes of the tile path. What its shaders share stands in [`crate::render::gpu::constants`].

/// Pixels a side of a tile.
pub(super) const TILE_PIXELS: u32 = crate::render::TILE as u32;
