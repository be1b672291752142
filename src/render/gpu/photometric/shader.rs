//! WGSL of each module; [`crate::render::gpu::constants`] come in front.

/// `photometric/draw.wgsl`: draws the splats and compares pixels with the photograph.
pub const DRAW: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/draw.wgsl")
);
/// `photometric/walk.wgsl`: sums of every splat in every tile.
pub const WALK: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/place.wgsl"),
    include_str!("../../../../shaders/photometric/walk.wgsl")
);
/// `photometric/add.wgsl`: sums of every splat.
pub const ADD: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/place.wgsl"),
    include_str!("../../../../shaders/photometric/add.wgsl")
);
