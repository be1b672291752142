// Structs shared with Rust: `src/render/gpu/layout.rs` mirrors them and `tests/shaders.rs` compares
// every size and offset. Prepended to each of the other files.

// One splat as `rendering.md` (d) stores it. A record that cannot be drawn is all zeros.
struct Splat {
    mean: vec3<f32>,            // world units
    opacity: f32,
    color: vec3<f32>,           // sRGB-encoded, not negative
    flags: u32,                 // bit 0: live
    rotation: vec4<f32>,        // unit quaternion x y z w
    scale: vec3<f32>,           // standard deviations, world units, floored
    birth: u32,                 // frame; 0 when unknown
}

const FLAG_LIVE: u32 = 1u;

// A record and the place it belongs to; 80 bytes.
struct SparseSplat {
    splat: Splat,
    index: u32,
}

// One camera. World axes of an OpenCV camera (x right, y down, z forward); lengths in pixels.
struct View {
    right: vec3<f32>,
    near: f32,                  // world units
    down: vec3<f32>,
    extent_cap: f32,            // largest support of a splat, in its standard deviations
    forward: vec3<f32>,
    centre: vec3<f32>,          // of the camera, world units
    focal: vec2<f32>,
    principal: vec2<f32>,
    viewport: vec2<f32>,
    // Range of x/z and y/z that the Jacobian may see.
    tangent_min: vec2<f32>,
    tangent_max: vec2<f32>,
}

struct Composite {
    background: vec3<f32>,      // sRGB-encoded
    mode: u32,                  // one of COMPARE_*
    // Where the second picture lies, in shares of the viewport.
    area_min: vec2<f32>,
    area_max: vec2<f32>,
    amount: f32,                // divider of a wipe (share of the width), gain of a difference
}

const COMPARE_NOTHING: u32 = 0u;
const COMPARE_WIPE: u32 = 1u;
const COMPARE_DIFFERENCE: u32 = 2u;
