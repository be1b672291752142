//! WGSL modules, to be prefixed by [`crate::render::gpu::constants`].

/// `photometric/draw.wgsl`: draws the splats and compares the pixels with the photograph.
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
/// `photometric/add.wgsl`: sums of every splat over its tiles.
pub const ADD: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/place.wgsl"),
    include_str!("../../../../shaders/photometric/add.wgsl")
);
