//! WGSL modules, to be prefixed by [`crate::render::gpu::constants`].

/// `points/file.wgsl`: inserts seeds into the hash grid.
pub const FILE: &str = concat!(
    include_str!("../../../../shaders/points/settings.wgsl"),
    include_str!("../../../../shaders/points/cells.wgsl"),
    include_str!("../../../../shaders/points/file.wgsl")
);
/// `points/find.wgsl`: finds the nearest seed of every point.
pub const FIND: &str = concat!(
    include_str!("../../../../shaders/points/settings.wgsl"),
    include_str!("../../../../shaders/points/cells.wgsl"),
    include_str!("../../../../shaders/points/find.wgsl")
);
/// `points/sum.wgsl`: sums of the points of every slot.
pub const SUM: &str = concat!(
    include_str!("../../../../shaders/points/settings.wgsl"),
    include_str!("../../../../shaders/points/sum.wgsl")
);
