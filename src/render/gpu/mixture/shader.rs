//! WGSL of the pass; [`crate::render::gpu::constants`] come in front.

/// `mixture/pass.wgsl`: search, E-step and sums of every tile.
pub const PASS: &str = concat!(
    include_str!("../../../../shaders/mixture/cells.wgsl"),
    include_str!("../../../../shaders/mixture/pass.wgsl")
);
/// `mixture/index.wgsl`: sorts means into the cells of their grid.
pub const INDEX: &str = concat!(
    include_str!("../../../../shaders/mixture/cells.wgsl"),
    include_str!("../../../../shaders/mixture/index.wgsl")
);
