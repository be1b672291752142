//! WGSL modules, to be prefixed by [`crate::render::gpu::constants`].

/// `tiles/sort.wgsl`: stable radix sort, used by depth and by tile.
pub const SORT: &str = concat!(
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/sort.wgsl")
);
/// `tiles/preprocess.wgsl`: converts splats to records, depth keys and tile footprints.
pub const PREPROCESS: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/paint.wgsl"),
    include_str!("../../../../shaders/record.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/packed.wgsl"),
    include_str!("../../../../shaders/tiles/footprint.wgsl"),
    include_str!("../../../../shaders/tiles/preprocess.wgsl")
);
/// `tiles/bin.wgsl`: writes an entry for each tile that a splat reaches, and later finds each tile's
/// range of entries.
pub const BIN: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/footprint.wgsl"),
    include_str!("../../../../shaders/tiles/bin.wgsl")
);
/// `tiles/raster.wgsl`: blends the entries of a tile, one workgroup per tile.
pub const RASTER: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/paint.wgsl"),
    include_str!("../../../../shaders/record.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/packed.wgsl"),
    include_str!("../../../../shaders/tiles/raster.wgsl")
);
