//! Splats to pixels by compute: sorted by depth, sorted into tiles, blended by one workgroup a tile
//! (`rendering.md` (d)). The path for chips with much compute and few raster units.
//!
//! Nothing here waits for the GPU, and no count comes back within a frame.

mod kernel;
pub mod sort;

/// WGSL of each module.
pub mod shader {
    /// `tiles/sort.wgsl`.
    pub const SORT: &str = concat!(
        include_str!("../../../../shaders/tiles/scan.wgsl"),
        include_str!("../../../../shaders/tiles/sort.wgsl")
    );
}

/// Lanes of a workgroup; `GROUP` in `tiles/scan.wgsl`.
const GROUP: u32 = 256;
