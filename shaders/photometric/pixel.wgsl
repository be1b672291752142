// What the walks over a tile share: chosen pixels, one for each lane, and how a splat shows in one.

struct Frame {
    // Pixels.
    size: vec2<u32>,
    // Of tiles.
    columns: u32,
    n_splats: u32,
    // Every so many rows of pixels one is chosen, from the first on.
    every: u32,
    first: u32,
    full_coverage: f32,
    // `1/τ²`.
    per_tau: f32,
    // How much coverage counts beside colour, squared, and how much depth does.
    coverage: f32,
    depth: f32,
}

struct Splat {
    // Projected centre, px.
    centre: vec2<f32>,
    // `p = dot(p, offset)`, `q = q_y·offset.y`, and the exponent of 2 is `−(p² + q²)`.
    p: vec2<f32>,
    q_y: f32,
    // Smallest exponent that is drawn.
    cut: f32,
    opacity: f32,
    red: f32,
    green: f32,
    blue: f32,
    // Change of each channel, per px.
    red_across: vec2<f32>,
    green_across: vec2<f32>,
    blue_across: vec2<f32>,
    // Change of depth per px, and depth at the centre.
    depth_across: vec2<f32>,
    depth: f32,
}

// What the second walk needs of a pixel.
struct Pixel {
    // Finished colour, and the factor of crack filling.
    behind: vec3<f32>,
    fill: f32,
    // Weighted residual, and the weight of curvature but for the splat's own weight.
    residual: vec3<f32>,
    share: f32,
    // What is left to the background where it is known what should be; weighted coverage that lacks.
    end: f32,
    lacking: f32,
    // How wrong what is drawn is beside the depth that was measured, and that weighted.
    wrong: f32,
    wronged: f32,
    // What was measured, and one over how far a surface may lie from it: 0 where nothing was.
    depth: f32,
    per_tolerance: f32,
}

struct Response {
    // Whitened offset from the centre.
    at: vec2<f32>,
    exponent: f32,
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> entries: array<u32>;
// First entry of each tile, and at the end their number.
@group(0) @binding(3) var<storage, read> starts: array<u32>;

// Chosen pixels of a tile: all 256, or those of every 2nd, 4th, 8th or 16th row.
override LANES: u32 = 256u;

fn entries_of(tile: vec2<u32>) -> vec2<u32> {
    let i = tile.y * frame.columns + tile.x;
    return vec2<u32>(starts[i], starts[i + 1u]);
}

fn row_of(lane: u32) -> u32 {
    return lane / TILE * frame.every + frame.first;
}

fn is_inside(tile: vec2<u32>, lane: u32) -> bool {
    return all(tile * TILE + vec2<u32>(lane % TILE, row_of(lane)) < frame.size);
}

// From a splat's centre to a pixel, px; added up as the processor does.
fn offset_of(splat: Splat, tile: vec2<u32>, lane: u32) -> vec2<f32> {
    let x = f32(lane % TILE) + (f32(tile.x * TILE) + 0.5 - splat.centre.x);
    let y = f32(tile.y * TILE + row_of(lane)) + 0.5 - splat.centre.y;
    return vec2<f32>(x, y);
}

fn response(splat: Splat, offset: vec2<f32>) -> Response {
    let p = splat.p.x * offset.x + splat.p.y * offset.y;
    let q = splat.q_y * offset.y;
    return Response(vec2<f32>(p, q), -(p * p + q * q));
}

fn color_of(splat: Splat, offset: vec2<f32>) -> vec3<f32> {
    let change = vec3<f32>(
        dot(splat.red_across, offset),
        dot(splat.green_across, offset),
        dot(splat.blue_across, offset),
    );
    let held = clamp(change, vec3<f32>(-GRADIENT_LIMIT), vec3<f32>(GRADIENT_LIMIT));
    return max(vec3<f32>(splat.red, splat.green, splat.blue) + held, vec3<f32>(0.0));
}

// How wrong a splat's place is: 0 at the measured depth, half at the tolerance, 1 far from it.
fn wrongness_of(splat: Splat, offset: vec2<f32>, depth: f32, per_tolerance: f32) -> f32 {
    let far = (splat.depth + dot(splat.depth_across, offset) - depth) * per_tolerance;
    return far * far / (1.0 + far * far);
}
