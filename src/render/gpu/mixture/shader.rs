//! WGSL modules of the pass, to be prefixed by [`crate::render::gpu::constants`].

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
