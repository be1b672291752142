//! Building blocks of textures: surface points, antialiased steps and lines, and value noise.

use glam::{DVec2, DVec3, Vec2, Vec3};

/// Surface point with the data that textures need.
pub(super) struct SurfaceSample {
    pub world: DVec3,
    /// Chart coordinates in `[0, 1]²`.
    pub uv: DVec2,
    /// Size of the chart, metres.
    pub size: DVec2,
    pub face: usize,
    /// Footprint of a pixel, metres.
    pub pixel_footprint: f32,
    pub seed: u32,
}

/// Step function: 0 below `edge`, 1 above, with a linear ramp of width `blur` between.
pub(super) fn step(value: f32, edge: f32, blur: f32) -> f32 {
    ((value - edge) / blur.max(1e-4) + 0.5).clamp(0.0, 1.0)
}

/// Lines at the integers: 1 within `width`, antialiased over `blur` with constant total ink.
pub(super) fn antialiased_line(value: f32, width: f32, blur: f32) -> f32 {
    let distance = (value - value.round()).abs();
    let spread = width.max(blur);
    (1.0 - step(distance, 0.5 * spread, blur)) * width / spread
}

/// Square wave of −1 and 1 that flips at the integers; fades to 0 where finer than a pixel.
pub(super) fn wave(value: f32, blur: f32) -> f32 {
    let saw = (value * 0.5 - (value * 0.5).floor() - 0.5).abs() * 4.0 - 1.0;
    let soft = (saw / (2.0 * blur).max(1e-3)).clamp(-1.0, 1.0);
    soft * (1.5 - blur).clamp(0.0, 1.0)
}

/// Square wave of 0 and 1 with period 1.
pub(super) fn band(value: f32, blur: f32) -> f32 {
    0.5 + 0.5 * wave(value * 2.0, blur)
}

/// Hashes a lattice point to a uniform number in `[0, 1)`.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    // 24 bits, the mantissa of f32: rounding never reaches 1.
    ((h ^ (h >> 15)) >> 8) as f32 * (1.0 / (1u32 << 24) as f32)
}

/// Smooth value noise in `[0, 1)` on a unit lattice.
pub(super) fn noise2(p: Vec2, seed: u32) -> f32 {
    let floor = p.floor();
    let (x, y) = (floor.x as i32, floor.y as i32);
    let f = p - floor;
    // Smoothstep: the derivative vanishes at the lattice points, so cell borders show no crease.
    let s = f * f * (3.0 - 2.0 * f);
    let row = |y: i32| {
        let (a, b) = (hash(x, y, seed), hash(x.wrapping_add(1), y, seed));
        a + (b - a) * s.x
    };
    let (low, high) = (row(y), row(y.wrapping_add(1)));
    low + (high - low) * s.y
}

/// Smooth 3D value noise in `[0, 1)` on a unit lattice.
pub(super) fn noise3(p: Vec3, seed: u32) -> f32 {
    let floor = p.z.floor();
    let f = p.z - floor;
    let layer = |z: i32| noise2(p.truncate(), seed ^ (z as u32).wrapping_mul(0xC2B2_AE3D));
    let (low, high) = (layer(floor as i32), layer((floor as i32).wrapping_add(1)));
    low + (high - low) * f * f * (3.0 - 2.0 * f)
}
