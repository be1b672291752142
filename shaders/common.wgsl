// Structs shared with Rust. `src/render/gpu/layout.rs` mirrors them, and `tests/gpu/shaders.rs` compares
// sizes and offsets. This file is prepended to the other files, after the constants of
// `src/render/gpu/constants.rs`.

// Splat (`rendering.md`, Splat record). An invalid or empty splat is all zeros.
struct Splat {
    mean: vec3<f32>,            // world units
    opacity: f32,
    color: vec3<f32>,           // sRGB-encoded
    flags: u32,                 // bit 0: live
    rotation: vec4<f32>,        // unit quaternion x y z w
    scale: vec3<f32>,           // standard deviations, world units
}

// Record and its index; 80 bytes.
struct SparseSplat {
    splat: Splat,
    index: u32,
}

// Colour variation of a splat (`rendering.md`, Native appearance); 108 bytes. Rows are channels:
// `gradient[3 * channel + axis]`.
struct Appearance {
    gradient: array<f32, 9>,    // per world unit
    directional: array<f32, 9>, // times the unit direction from the camera to the mean
    observed: array<f32, 3>,    // mean of the unit directions it was observed from
    cone: array<f32, 6>,        // inverse of the observed cone, upper triangle: oᵀPo ≤ 1 inside
}

// Appearance and its index; 112 bytes.
struct SparseAppearance {
    appearance: Appearance,
    index: u32,
}

// Camera and render options. Camera axes follow OpenCV (x right, y down, z forward) and are given in world
// space; lengths are in pixels.
struct View {
    right: vec3<f32>,
    near: f32,                  // world units
    down: vec3<f32>,
    paint: u32,                 // one of PAINT_*
    forward: vec3<f32>,
    scale: f32,                 // factor on standard deviations
    centre: vec3<f32>,          // camera centre, world units
    opacity_cut: f32,
    centre_rest: vec3<f32>,     // rounding error of the f32 centre
    renderer: u32,              // one of RENDERER_*
    focal: vec2<f32>,           // fisheye: px per radian
    principal: vec2<f32>,
    viewport: vec2<f32>,
    // Clamping range of x/z and y/z in the Jacobian.
    tangent_min: vec2<f32>,
    tangent_max: vec2<f32>,
    depth_range: vec2<f32>,     // range of the depth paint, world units
    antialias: u32,             // one of ANTIALIAS_*
    lens: u32,                  // one of LENS_*
    is_antialiased: u32,        // 1 lowers opacities by the area that antialiasing adds
}

struct Composite {
    background: vec3<f32>,      // sRGB-encoded
    mode: u32,                  // one of COMPARE_*
    // Area of the second image, in fractions of the viewport.
    area_min: vec2<f32>,
    area_max: vec2<f32>,
    amount: f32,                // divider of a wipe (fraction of the width) or gain of a difference
    // Coverage at which a pixel counts as full, and factors on the colour, of each image.
    second_full_coverage: f32,
    exposure: vec3<f32>,
    full_coverage: f32,
    second_exposure: vec3<f32>,
}
