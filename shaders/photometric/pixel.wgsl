// Common to both walks over a tile: chosen pixels, one per lane, and the response of a splat in a pixel.

struct Frame {
    // Image size, px.
    size: vec2<u32>,
    // Number of tile columns.
    columns: u32,
    n_splats: u32,
    // Every `every`-th pixel row is chosen, starting at `first`.
    every: u32,
    first: u32,
    full_coverage: f32,
    // `1/τ²`.
    per_tau: f32,
    // Squared weights of coverage and depth errors relative to colour.
    coverage: f32,
    depth: f32,
}

struct Splat {
    // Projected centre, px.
    centre: vec2<f32>,
    // `p = dot(p, offset)`, `q = q_y·offset.y`; the exponent of 2 is `−(p² + q²)`.
    p: vec2<f32>,
    q_y: f32,
    // Smallest exponent that passes the alpha cut.
    cut: f32,
    opacity: f32,
    red: f32,
    green: f32,
    blue: f32,
    // Change of each channel, per px.
    red_across: vec2<f32>,
    green_across: vec2<f32>,
    blue_across: vec2<f32>,
    // Depth change per px, and depth at the centre, world units.
    depth_across: vec2<f32>,
    depth: f32,
}

// Pixel state of the second walk.
struct Pixel {
    // Finished colour, and the factor of crack filling.
    behind: vec3<f32>,
    fill: f32,
    // Weighted residual, and curvature weight without the splat's own weight.
    residual: vec3<f32>,
    share: f32,
    // Final transmittance if the target coverage is known, else 0; weighted missing coverage.
    end: f32,
    lacking: f32,
    // Blended depth error, unweighted and weighted.
    wrong: f32,
    wronged: f32,
    // Measured depth, and inverse tolerance of a surface's depth; 0 if unknown.
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
// First entry of each tile, followed by the total number of entries.
@group(0) @binding(3) var<storage, read> starts: array<u32>;

// Chosen pixels per tile: all 256, or those of every 2nd, 4th, 8th or 16th row.
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

// Offset of a pixel from a splat's centre, px; added in the same order as on the CPU.
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

// Depth error of a splat: 0 at the measured depth, ½ at the tolerance, close to 1 far from it.
fn wrongness_of(splat: Splat, offset: vec2<f32>, depth: f32, per_tolerance: f32) -> f32 {
    let far = (splat.depth + dot(splat.depth_across, offset) - depth) * per_tolerance;
    return far * far / (1.0 + far * far);
}
