//! WGSL of each module.

/// `tiles/sort.wgsl`.
pub const SORT: &str = concat!(
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/sort.wgsl")
);
/// `tiles/preprocess.wgsl`.
pub const PREPROCESS: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/paint.wgsl"),
    include_str!("../../../../shaders/record.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/packed.wgsl"),
    include_str!("../../../../shaders/tiles/footprint.wgsl"),
    include_str!("../../../../shaders/tiles/preprocess.wgsl")
);
/// `tiles/bin.wgsl`.
pub const BIN: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/footprint.wgsl"),
    include_str!("../../../../shaders/tiles/bin.wgsl")
);
/// `tiles/raster.wgsl`.
pub const RASTER: &str = concat!(
    include_str!("../../../../shaders/common.wgsl"),
    include_str!("../../../../shaders/paint.wgsl"),
    include_str!("../../../../shaders/record.wgsl"),
    include_str!("../../../../shaders/tiles/stages.wgsl"),
    include_str!("../../../../shaders/tiles/packed.wgsl"),
    include_str!("../../../../shaders/tiles/raster.wgsl")
);
