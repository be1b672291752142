// Settings of seed searches and sums of points (`scene.md`, On a device). All results are bit-identical to
// those of the CPU.

struct Settings {
    // Factor per colour channel.
    gain: vec3<f32>,
    // Inverse structural scale, per world unit.
    per_h: f32,
    // Number of pixels that a point represents.
    weight: f32,
    // −0.0, stored as a uniform so that no compiler can fold it.
    minus_zero: f32,
    per_cell: f32,
    // Limit of the cell coordinates; positions beyond it have no seed.
    max_cells: f32,
    // Search radius, slightly larger than the maximum distance of a seed.
    radius: f32,
    // Maximum squared distance of a seed.
    limit: f32,
    n_points: u32,
    // Index of the first new seed.
    first_seed: u32,
    n_seeds: u32,
    bucket_mask: u32,
}

// Memory layout of a frame's points; a scalar follows each vector.
struct Point {
    position: vec3<f32>,
    range: u32,
    color: vec3<f32>,
    noise: u32,
    normal: vec3<f32>,
    footprint: u32,
    direction: vec3<f32>,
    pixel: u32,
}

@group(0) @binding(0) var<uniform> settings: Settings;
@group(0) @binding(1) var<storage, read> points: array<Point>;

// Products with their own rounding. Drivers may fuse a product with a following sum, but not this fma with
// −0, which changes no bit.
fn product(a: f32, b: f32) -> f32 {
    return fma(a, b, settings.minus_zero);
}

fn product3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return fma(a, b, vec3<f32>(settings.minus_zero));
}
