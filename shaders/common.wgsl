// Structs shared with Rust: `src/render/gpu/layout.rs` mirrors them and `tests/gpu/shaders.rs` compares
// every size and offset. Prepended to each of the other files; constants that Rust has too come in
// front of it, from `src/render/gpu/constants.rs`.

// One splat as `rendering.md`, Splat record, stores it. A record that cannot be drawn is all zeros.
struct Splat {
    mean: vec3<f32>,            // world units
    opacity: f32,
    color: vec3<f32>,           // sRGB-encoded
    flags: u32,                 // bit 0: live
    rotation: vec4<f32>,        // unit quaternion x y z w
    scale: vec3<f32>,           // standard deviations, world units
    birth: u32,                 // frame; 0 when unknown
}

// A record and the place it belongs to; 80 bytes.
struct SparseSplat {
    splat: Splat,
    index: u32,
}

// What a splat carries beyond position, shape and one colour (`rendering.md`, Native appearance);
// 108 bytes. Rows are channels: `gradient[3 * channel + axis]`.
struct Appearance {
    gradient: array<f32, 9>,    // per world unit
    directional: array<f32, 9>, // times the unit direction from the camera to the mean
    observed: array<f32, 3>,    // mean of the unit directions it was observed from
    cone: array<f32, 6>,        // upper triangle: offsets from the mean within it have a square of at most 1
}

// An appearance and the place it belongs to; 112 bytes.
struct SparseAppearance {
    appearance: Appearance,
    index: u32,
}

// One camera and what is asked of the renderer. World axes of an OpenCV camera (x right, y down, z
// forward); lengths in pixels.
struct View {
    right: vec3<f32>,
    near: f32,                  // world units
    down: vec3<f32>,
    extent_cap: f32,            // largest support of a splat, in its standard deviations
    forward: vec3<f32>,
    scale: f32,                 // factor on standard deviations
    centre: vec3<f32>,          // of the camera, world units
    opacity_cut: f32,
    centre_rest: vec3<f32>,     // what f32 left of the centre
    renderer: u32,              // one of RENDERER_*
    focal: vec2<f32>,           // fisheye: px per radian
    principal: vec2<f32>,
    viewport: vec2<f32>,
    // Range of x/z and y/z that the Jacobian may see.
    tangent_min: vec2<f32>,
    tangent_max: vec2<f32>,
    depth_range: vec2<f32>,     // ends of the depth paint, world units
    antialias: u32,             // one of ANTIALIAS_*
    lens: u32,                  // one of LENS_*
    paint: u32,                 // one of PAINT_*
}

struct Composite {
    background: vec3<f32>,      // sRGB-encoded
    mode: u32,                  // one of COMPARE_*
    // Where the second picture lies, in shares of the viewport.
    area_min: vec2<f32>,
    area_max: vec2<f32>,
    amount: f32,                // divider of a wipe (share of the width), gain of a difference
    // Coverage that counts as full, and factors on the colour, of either picture.
    second_full_coverage: f32,
    exposure: vec3<f32>,
    full_coverage: f32,
    second_exposure: vec3<f32>,
}
