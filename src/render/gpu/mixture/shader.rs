//! WGSL of the pass; [`crate::render::gpu::constants`] come in front.

/// `mixture/pass.wgsl`: search, E-step and sums of every tile.
pub const PASS: &str = include_str!("../../../../shaders/mixture/pass.wgsl");
