//! WGSL of each module; [`crate::render::gpu::constants`] come in front.

/// `tiles/sort.wgsl`: the stable radix sort, used by depth and by tile.
pub const SORT: &str = concat!(
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/sort.wgsl")
);
/// `tiles/preprocess.wgsl`: splats to records, depth keys and footprints in tiles.
pub const PREPROCESS: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/paint.wgsl"),
    include_str!("../../../../shaders/record.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/packed.wgsl"),
    include_str!("../../../../shaders/tiles/footprint.wgsl"),
    include_str!("../../../../shaders/tiles/preprocess.wgsl")
);
/// `tiles/bin.wgsl`: an entry for each tile that a splat reaches, then where each tile's entries
/// begin.
pub const BIN: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/footprint.wgsl"),
    include_str!("../../../../shaders/tiles/bin.wgsl")
);
/// `tiles/raster.wgsl`: one workgroup a tile blends its entries.
pub const RASTER: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/paint.wgsl"),
    include_str!("../../../../shaders/record.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/packed.wgsl"),
    include_str!("../../../../shaders/tiles/raster.wgsl")
);
