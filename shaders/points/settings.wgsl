// What searches for seeds and sums of points read (`scene.md`, On a device). Every number that leaves the
// device has the processor's bits.

struct Settings {
    // Factor on each channel.
    gain: vec3<f32>,
    // Structural scales a world unit.
    per_h: f32,
    // Pixels that a point stands for.
    weight: f32,
    // Minus zero, which no compiler may know.
    minus_zero: f32,
    per_cell: f32,
    // Cells from the origin from which on no place has a seed.
    max_cells: f32,
    // How far seeds are looked for, a little farther than they may be.
    radius: f32,
    // Largest squared distance of a seed.
    limit: f32,
    n_points: u32,
    // Seeds from this one on are new.
    first_seed: u32,
    n_seeds: u32,
    bucket_mask: u32,
}

// As a frame holds it; a number follows each vector.
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

// Products rounded by themselves: drivers may fuse a product with a sum that follows, but not this sum,
// which changes no bit.
fn product(a: f32, b: f32) -> f32 {
    return fma(a, b, settings.minus_zero);
}

fn product3(a: vec3<f32>, b: vec3<f32>) -> vec3<f32> {
    return fma(a, b, vec3<f32>(settings.minus_zero));
}
