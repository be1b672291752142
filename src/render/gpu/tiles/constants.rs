//! Sizes that Rust and the shaders of the tile path share.

/// Lanes of a workgroup; `GROUP` in `tiles/stages.wgsl`.
pub(super) const GROUP: u32 = 256;
/// Pixels a side of a tile; `TILE` there.
pub(super) const TILE_PIXELS: u32 = crate::render::TILE as u32;
