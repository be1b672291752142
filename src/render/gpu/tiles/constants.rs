//! Sizes of the tile path. Constants shared with shaders are in [`crate::render::gpu::constants`].

/// Side length of a tile in pixels.
pub(super) const TILE_PIXELS: u32 = crate::render::TILE as u32;
