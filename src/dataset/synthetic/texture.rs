//! Surface colours: linear albedo as a function of the surface point.
//!
//! Details are blurred over `blur`, the footprint of a pixel in metres, since aliasing would differ between
//! views.

use super::fine_texture::FineTexture;
use glam::{DVec2, DVec3, Vec2, Vec3, vec3};

/// Texture of a surface. Colours are linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Texture {
    Walls,
    Paint(Vec3),
    Wood(Vec3),
    Fabric(Vec3),
    Marble(Vec3),
    Candy(Vec3),
    Checker(Vec3),
    Glaze(Vec3),
    Ball(Vec3),
    Cover(Vec3),
    Leaves,
    Rug,
    Books,
    Drawers,
    Landscape,
    Abstract,
    Window,
    Glow(Vec3),
    Fine(FineTexture),
}

impl Texture {
    /// True if `albedo` returns emitted radiance instead of albedo.
    pub fn is_emissive(&self) -> bool {
        matches!(self, Self::Window | Self::Glow(_))
    }

    /// Returns the albedo at a surface point, linear RGB. Emissive textures return emitted radiance.
    pub fn albedo(&self, at: &SurfaceSample) -> Vec3 {
        let metres = (at.uv * at.size).as_vec2();
        match *self {
            Self::Walls => match at.face {
                // Faces 4 and 5 are floor and ceiling, the low and high sides of z.
                4 => planks(metres, at),
                5 => vec3(0.80, 0.79, 0.76) * (0.97 + 0.03 * noise2(metres * 6.0, at.seed)),
                face => wall(metres, face, at),
            },
            Self::Paint(color) => color,
            Self::Wood(color) => wood(metres, color, at),
            Self::Fabric(color) => fabric(metres, color, at),
            Self::Marble(color) => marble(color, at),
            Self::Candy(color) => {
                let twist = (at.uv.x * 12.0 + at.uv.y * 2.0) as f32;
                Vec3::splat(0.82).lerp(color, band(twist, at.pixel_footprint * 12.0))
            }
            Self::Checker(color) => {
                let cell = metres / 0.055;
                let odd = wave(cell.x, at.pixel_footprint / 0.055)
                    * wave(cell.y, at.pixel_footprint / 0.055);
                Vec3::new(0.80, 0.74, 0.58).lerp(color, 0.5 + 0.5 * odd)
            }
            Self::Glaze(color) => glaze(color, at),
            Self::Ball(color) => {
                let wedge = band((at.uv.x * 6.0) as f32, at.pixel_footprint * 3.0);
                let cap = step((at.uv.y as f32 - 0.5).abs(), 0.46, at.pixel_footprint);
                Vec3::new(0.85, 0.83, 0.78).lerp(color, wedge * (1.0 - cap))
            }
            Self::Cover(color) => {
                let edge = (at.uv - 0.5).abs().max_element() as f32;
                color.lerp(Vec3::splat(0.85), stripe(edge, [0.36, 0.4], 0.02))
            }
            Self::Leaves => leaves(at),
            Self::Rug => rug(at),
            Self::Books if at.face == 0 => books(metres, at),
            Self::Books => wood(metres, vec3(0.24, 0.13, 0.07), at),
            Self::Drawers => drawers(metres, at),
            Self::Landscape => landscape(at),
            Self::Abstract => abstract_blocks(at),
            Self::Window => window(metres, at),
            Self::Glow(color) => color,
            Self::Fine(texture) => texture.albedo(metres, at),
        }
    }

    /// True if a lidar often receives no return, as from glossy, glass or black surfaces.
    pub fn is_poor_target(&self) -> bool {
        match *self {
            Self::Window | Self::Glaze(_) => true,
            Self::Paint(color) => color.max_element() < 0.05,
            Self::Fine(texture) => texture.is_poor_target(),
            _ => false,
        }
    }
}

fn planks(m: Vec2, at: &SurfaceSample) -> Vec3 {
    const WIDTH: f32 = 0.16;
    const LENGTH: f32 = 1.3;
    let row = (m.y / WIDTH).floor();
    // Each row is shifted at random, so that joints of planks do not line up.
    let along = m.x / LENGTH + hash(row as i32, 7, at.seed);
    let tint = hash(row as i32, along.floor() as i32, at.seed ^ 0x51);
    let grain = noise2(Vec2::new(m.x * 4.0 + tint * 40.0, m.y * 60.0), at.seed);
    let knots = noise2(m * 5.0, at.seed ^ 0x77);
    let color = vec3(0.42, 0.25, 0.12).lerp(vec3(0.56, 0.36, 0.19), tint);
    let gap = antialiased_line(m.y / WIDTH, 0.004 / WIDTH, at.pixel_footprint / WIDTH)
        .max(antialiased_line(along, 0.004 / LENGTH, at.pixel_footprint / LENGTH));
    color * (0.72 + 0.3 * grain + 0.16 * knots) * (1.0 - 0.7 * gap)
}

fn wall(m: Vec2, face: usize, at: &SurfaceSample) -> Vec3 {
    const RAIL: f32 = 0.95;
    let speckle = 0.95 + 0.1 * noise2(m * 30.0, at.seed ^ face as u32);
    let rail = stripe(m.y, [RAIL - 0.04, RAIL + 0.02], at.pixel_footprint);
    let board = antialiased_line(m.x / 0.2, 0.04, at.pixel_footprint / 0.2) * 0.35
        + step(0.12, m.y, at.pixel_footprint) * 0.1;
    let panel = vec3(0.70, 0.68, 0.62) * (1.0 - board);
    let paper = match face {
        0 => vec3(0.46, 0.55, 0.47),
        1 => vec3(0.48, 0.54, 0.50),
        2 => vec3(0.60, 0.52, 0.40),
        _ => vec3(0.52, 0.24, 0.16),
    };
    let motif = damask(m / 0.3, at.pixel_footprint / 0.3);
    let upper = paper * (1.0 - 0.28 * motif) * speckle;
    let above = step(m.y, RAIL, at.pixel_footprint);
    panel.lerp(upper, above).lerp(Vec3::splat(0.80), rail)
}

/// Returns a pattern of diamonds on a staggered lattice, each with a dot.
fn damask(m: Vec2, blur: f32) -> f32 {
    let shifted = Vec2::new(m.x + 0.5 * (m.y.floor() as i32).rem_euclid(2) as f32, m.y);
    let p = (shifted - shifted.floor() - 0.5).abs();
    let diamond = p.x * 1.5 + p.y;
    let ring = stripe(diamond, [0.30, 0.40], blur);
    let dot = 1.0 - step(p.length(), 0.12, blur);
    ring.max(dot)
}

fn wood(m: Vec2, color: Vec3, at: &SurfaceSample) -> Vec3 {
    // The grain runs along the longer side.
    let long = if at.size.x >= at.size.y { m } else { Vec2::new(m.y, m.x) };
    let bend = noise2(long * Vec2::new(1.5, 5.0), at.seed) * 0.06;
    // Rings finer than a pixel would alias differently in each view.
    let fade = (1.0 - at.pixel_footprint / 0.02).clamp(0.0, 1.0);
    let rings = ((long.y + bend) * 240.0).sin() * 0.12 * fade;
    let grain = noise2(long * Vec2::new(6.0, 90.0), at.seed ^ 0x3) - 0.5;
    color * (1.0 + rings + 0.45 * grain)
}

fn fabric(m: Vec2, color: Vec3, at: &SurfaceSample) -> Vec3 {
    let weave = noise2(m * 70.0, at.seed) - 0.5;
    let folds = noise2(m * 5.0, at.seed ^ 0x9) - 0.5;
    let seam = antialiased_line(m.x / 0.62, 0.02, at.pixel_footprint / 0.62);
    color * (1.0 + 0.35 * weave + 0.5 * folds) * (1.0 - 0.5 * seam)
}

fn marble(color: Vec3, at: &SurfaceSample) -> Vec3 {
    // By world position, not by chart, so that the pattern has no seam.
    let p = at.world.as_vec3() * 9.0;
    let turbulence = noise3(p, at.seed) + 0.5 * noise3(p * 2.1, at.seed ^ 0x5);
    let vein = ((p.x + p.y + p.z) * 1.2 + turbulence * 7.0).sin().abs();
    Vec3::splat(0.88).lerp(color, (1.0 - vein).powi(2))
}

fn glaze(color: Vec3, at: &SurfaceSample) -> Vec3 {
    let v = at.uv.y as f32;
    let zigzag = 0.5 + 0.05 * (((at.uv.x as f32 * 16.0).fract() - 0.5).abs() * 4.0 - 1.0);
    let blur = at.pixel_footprint / at.size.y as f32;
    let band = stripe(v, [zigzag - 0.09, zigzag + 0.09], blur);
    let rim = step(v, 0.93, blur).max(1.0 - step(v, 0.06, blur));
    Vec3::new(0.84, 0.82, 0.76).lerp(color, band.max(rim))
}

fn leaves(at: &SurfaceSample) -> Vec3 {
    // By world position, not by chart, so that the pattern has no seam.
    let p = at.world.as_vec3() * 22.0;
    let cluster = noise3(p, at.seed) * 0.65 + noise3(p * 2.3, at.seed ^ 0x21) * 0.35;
    vec3(0.02, 0.07, 0.02).lerp(vec3(0.26, 0.48, 0.12), cluster * cluster * 1.6)
}

fn rug(at: &SurfaceSample) -> Vec3 {
    // The chart of the round rug is the square around it.
    let p = (at.uv - 0.5).as_vec2() * 2.0;
    let (radius, angle) = (p.length(), p.y.atan2(p.x));
    let blur = at.pixel_footprint / 1.45;
    let petals = 0.5 + 0.5 * (angle * 16.0).cos();
    let edge = 0.60 + 0.10 * petals;
    let cream = vec3(0.74, 0.64, 0.48);
    let flower = cream.lerp(vec3(0.46, 0.09, 0.08), 1.0 - step(radius, edge, blur));
    let rings = wave(radius * 5.0, blur * 5.0);
    let centre = vec3(0.10, 0.14, 0.28).lerp(vec3(0.62, 0.40, 0.14), 0.5 + 0.5 * rings);
    let inner = 1.0 - step(radius, 0.42 + 0.05 * petals, blur);
    let border = step(radius, 0.86, blur);
    let knots = 0.86 + 0.28 * noise2(p * 60.0, at.seed);
    flower.lerp(centre, inner).lerp(vec3(0.10, 0.14, 0.28), border) * knots
}

fn books(m: Vec2, at: &SurfaceSample) -> Vec3 {
    const SHELF: f32 = 0.325;
    const BOOK: f32 = 0.045;
    const SPINES: [Vec3; 8] = [
        vec3(0.42, 0.07, 0.05),
        vec3(0.05, 0.16, 0.30),
        vec3(0.08, 0.22, 0.12),
        vec3(0.55, 0.36, 0.10),
        vec3(0.62, 0.55, 0.42),
        vec3(0.26, 0.08, 0.16),
        vec3(0.05, 0.24, 0.26),
        vec3(0.14, 0.12, 0.11),
    ];
    let shelf = (m.y / SHELF).floor();
    let height = m.y - shelf * SHELF;
    let slot = m.x / BOOK + hash(shelf as i32, 3, at.seed);
    let id = slot.floor() as i32;
    let random = |k: u32| hash(id, shelf as i32, at.seed ^ k);
    let frame = 1.0 - step(height, 0.025, at.pixel_footprint);
    let top = 0.17 + 0.11 * random(1);
    let gap = antialiased_line(slot, 0.08, at.pixel_footprint / BOOK);
    let cover = SPINES[((random(2) * SPINES.len() as f32) as usize).min(7)];
    let cover = cover * (0.6 + 0.7 * random(5));
    let title = stripe(height, [top * 0.72, top * 0.8], at.pixel_footprint);
    let spine = cover.lerp(vec3(0.75, 0.65, 0.35), title * random(6)) * (1.0 - 0.75 * gap);
    let shown =
        spine.lerp(vec3(0.035, 0.022, 0.014), step(height, top + 0.025, at.pixel_footprint));
    shown.lerp(vec3(0.26, 0.15, 0.08), frame)
}

fn drawers(m: Vec2, at: &SurfaceSample) -> Vec3 {
    let base = wood(m, vec3(0.36, 0.20, 0.10), at);
    // Face 2 is the front, the low side of y.
    if at.face != 2 {
        return base;
    }
    // Two rows of three on 1.9 m; rounded up, so that no fourth column begins at the edge.
    let cell = m / Vec2::new(0.6334, 0.35);
    let p = cell - cell.floor() - 0.5;
    let from_edge = 0.5 - p.abs().max_element();
    let knob = 1.0 - step((p * Vec2::new(0.6334, 0.35)).length(), 0.022, at.pixel_footprint);
    let groove = 1.0 - step(from_edge, 0.02, at.pixel_footprint);
    (base * (1.0 - 0.7 * groove)).lerp(vec3(0.70, 0.56, 0.26), knob)
}

fn landscape(at: &SurfaceSample) -> Vec3 {
    let p = at.uv.as_vec2();
    let blur = at.pixel_footprint;
    let mut color = vec3(0.82, 0.50, 0.28).lerp(vec3(0.16, 0.34, 0.62), (p.y * 1.3 - 0.3).max(0.0));
    let sun = 1.0 - step((p * Vec2::new(1.6, 1.0)).distance(Vec2::new(1.1, 0.66)), 0.10, blur);
    color = color.lerp(vec3(0.95, 0.80, 0.42), sun);
    for (i, tone) in
        [(0, vec3(0.36, 0.36, 0.50)), (1, vec3(0.16, 0.30, 0.28)), (2, vec3(0.10, 0.20, 0.09))]
    {
        let x = p.x * (2.5 + i as f32) + 3.7 * i as f32;
        // Fixed seeds: the picture is the same in every room.
        let ridge = 0.46 - 0.15 * i as f32
            + 0.16 * noise2(Vec2::new(x, 0.5), 11)
            + 0.05 * noise2(Vec2::new(x * 4.0, 2.5), 12);
        let brush = 0.85 + 0.3 * noise2(p * Vec2::new(40.0, 90.0), 13);
        color = color.lerp(tone * brush, step(ridge, p.y, blur));
    }
    color
}

fn abstract_blocks(at: &SurfaceSample) -> Vec3 {
    const X: [f32; 3] = [0.28, 0.62, 0.86];
    const Y: [f32; 3] = [0.22, 0.55, 0.80];
    const COLORS: [Vec3; 5] = [
        vec3(0.82, 0.80, 0.72),
        vec3(0.64, 0.08, 0.05),
        vec3(0.04, 0.10, 0.38),
        vec3(0.80, 0.56, 0.06),
        vec3(0.82, 0.80, 0.72),
    ];
    let p = at.uv.as_vec2();
    let cell = |cuts: &[f32; 3], v: f32| cuts.iter().filter(|c| v > **c).count() as i32;
    // A fixed seed, as for the landscape.
    let pick = hash(cell(&X, p.x), cell(&Y, p.y), 29) * COLORS.len() as f32;
    let distance =
        |cuts: &[f32; 3], v: f32| cuts.iter().map(|c| (v - c).abs()).fold(f32::INFINITY, f32::min);
    let bar = 1.0 - step(distance(&X, p.x).min(distance(&Y, p.y)), 0.012, at.pixel_footprint);
    COLORS[(pick as usize).min(4)].lerp(Vec3::splat(0.02), bar)
}

fn window(m: Vec2, at: &SurfaceSample) -> Vec3 {
    let v = at.uv.y as f32;
    // Fixed seeds: the view is the same in every room.
    let clouds =
        noise2(m * Vec2::new(2.5, 5.0), 41) * 0.7 + noise2(m * Vec2::new(7.0, 13.0), 42) * 0.3;
    let sky = vec3(1.1, 1.6, 2.3).lerp(Vec3::splat(2.6), ((clouds - 0.45) * 3.0).clamp(0.0, 1.0));
    let hills = 0.24 + 0.13 * noise2(Vec2::new(m.x * 3.0, 0.5), 43);
    let meadow = vec3(0.30, 0.52, 0.20) * (0.7 + 0.5 * noise2(m * 24.0, 44));
    let scene = sky.lerp(meadow, step(hills, v, at.pixel_footprint));
    let bar = |metres: f32| antialiased_line(metres / 0.6, 0.05, at.pixel_footprint / 0.6);
    scene.lerp(Vec3::splat(0.62), bar(m.x).max(bar(m.y)))
}

pub(super) struct SurfaceSample {
    pub world: DVec3,
    /// Chart coordinates in `[0, 1]²`.
    pub uv: DVec2,
    /// Size of the chart along its two directions, metres.
    pub size: DVec2,
    pub face: usize,
    /// Width of a pixel on the surface, metres.
    pub pixel_footprint: f32,
    pub seed: u32,
}

/// Returns a step function: 0 below `edge`, 1 above, with a linear ramp of width `blur` between.
pub(super) fn step(value: f32, edge: f32, blur: f32) -> f32 {
    // A footprint of zero would divide by zero.
    ((value - edge) / blur.max(1e-4) + 0.5).clamp(0.0, 1.0)
}

/// Returns 1 between two edges and 0 elsewhere, with ramps of width `blur`.
fn stripe(value: f32, [low, high]: [f32; 2], blur: f32) -> f32 {
    step(value, low, blur) * (1.0 - step(value, high, blur))
}

/// Returns the coverage by lines at integer values: 1 within a line of `width`, 0 elsewhere. Lines are
/// blurred over `blur` with constant total ink.
pub(super) fn antialiased_line(value: f32, width: f32, blur: f32) -> f32 {
    let distance = (value - value.round()).abs();
    let spread = width.max(blur);
    (1.0 - step(distance, 0.5 * spread, blur)) * width / spread
}

/// Returns a square wave of −1 and 1 that changes sign at integers. It fades to 0 where its period is
/// finer than a pixel.
pub(super) fn wave(value: f32, blur: f32) -> f32 {
    let saw = (value * 0.5 - (value * 0.5).floor() - 0.5).abs() * 4.0 - 1.0;
    let soft = (saw / (2.0 * blur).max(1e-3)).clamp(-1.0, 1.0);
    soft * (1.5 - blur).clamp(0.0, 1.0)
}

/// Returns a square wave of 0 and 1 with period 1.
pub(super) fn band(value: f32, blur: f32) -> f32 {
    0.5 + 0.5 * wave(value * 2.0, blur)
}

/// Hashes a lattice point to a uniform number in `[0, 1)`.
pub(super) fn hash(x: i32, y: i32, seed: u32) -> f32 {
    // Coordinates are spread by xxHash's primes, then mixed by `prospector32` (C. Wellons, hash-prospector).
    let mut h = (x as u32).wrapping_mul(0x9E37_79B1) ^ (y as u32).wrapping_mul(0x85EB_CA77) ^ seed;
    h = (h ^ (h >> 15)).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ (h >> 12)).wrapping_mul(0x297A_2D39);
    // 24 bits, the mantissa of f32: rounding never reaches 1.
    ((h ^ (h >> 15)) >> 8) as f32 * (1.0 / (1u32 << 24) as f32)
}

/// Returns smooth value noise in `[0, 1)` on a unit lattice.
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

/// Returns smooth 3D value noise in `[0, 1)` on a unit lattice.
pub(super) fn noise3(p: Vec3, seed: u32) -> f32 {
    let floor = p.z.floor();
    let f = p.z - floor;
    let layer = |z: i32| noise2(p.truncate(), seed ^ (z as u32).wrapping_mul(0xC2B2_AE3D));
    let (low, high) = (layer(floor as i32), layer((floor as i32).wrapping_add(1)));
    low + (high - low) * f * f * (3.0 - 2.0 * f)
}
