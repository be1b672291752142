//! Textures with detail of about 1 mm, for scenes that a phone photographs at close range.
//!
//! Each octave fades out where it is finer than a pixel, as in [`super::texture`].

use super::texture::{SurfaceSample, antialiased_line, hash, noise2, step};
use glam::{Vec2, Vec3, vec3};

/// Texture of a surface with fine detail. Colours are linear RGB.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum FineTexture {
    /// Veneer with pores, fibres and knots; the grain runs along the longer side.
    Grain(Vec3),
    /// White paper with lines of letters; line height in metres.
    Printed(f32),
    Poster,
    /// Glazed 100 mm tiles with grout.
    Tiles,
    Steel,
    Rubber(Vec3),
    /// Walls, ceiling and floor of the hallway: rough plaster and tiles.
    Hallway,
}

impl FineTexture {
    pub fn albedo(self, m: Vec2, at: &SurfaceSample) -> Vec3 {
        match self {
            Self::Grain(color) => grain(m, color, at),
            Self::Printed(height) => paper(m, height, at),
            Self::Poster => poster(m, at),
            Self::Tiles => tiles(m, at),
            Self::Steel => steel(m, at),
            Self::Rubber(color) => color * (0.9 + 0.2 * octave(m * 300.0, 300.0, 0x61, at)),
            Self::Hallway => match at.face {
                4 => tiles(m, at),
                5 => plaster(m, vec3(0.80, 0.79, 0.76), at),
                3 => plaster(m, vec3(0.66, 0.62, 0.50), at),
                _ => plaster(m, vec3(0.50, 0.56, 0.58), at),
            },
        }
    }

    /// True if a lidar often receives no return from the surface.
    pub fn is_poor_target(self) -> bool {
        match self {
            Self::Steel => true,
            Self::Rubber(color) => color.max_element() < 0.05,
            _ => false,
        }
    }
}

/// Returns value noise in `[0, 1)` with `per_metre` cells per metre. It fades to its mean, 0.5, where a
/// pixel is wider than a cell.
fn octave(p: Vec2, per_metre: f32, salt: u32, at: &SurfaceSample) -> f32 {
    let fade = (1.5 - 1.5 * at.pixel_footprint * per_metre).clamp(0.0, 1.0);
    match fade > 0.0 {
        true => 0.5 + (noise2(p, at.seed ^ salt) - 0.5) * fade,
        false => 0.5,
    }
}

/// Averages 3 × 3 samples of `value` over a square of side `blur`, the footprint of a pixel (box
/// filter).
fn softened(p: Vec2, blur: f32, value: impl Fn(Vec2) -> f32) -> f32 {
    let shift = |i: usize| (i as f32 - 1.0) * blur / 3.0;
    let sample = |i: usize| value(p + Vec2::new(shift(i % 3), shift(i / 3)));
    (0..9).map(sample).sum::<f32>() / 9.0
}

fn grain(m: Vec2, color: Vec3, at: &SurfaceSample) -> Vec3 {
    // x runs across the grain, y along it.
    let p = if at.size.y >= at.size.x { m } else { Vec2::new(m.y, m.x) };
    let bend = noise2(p * Vec2::new(3.0, 0.9), at.seed) + 0.3 * noise2(p * 7.0, at.seed ^ 0x11);
    let (knot, near) = knot(p, at);
    let across = p.x + 0.06 * bend + 0.05 * near;
    let fade = (1.0 - at.pixel_footprint / 0.006).clamp(0.0, 1.0);
    let rings = (across * 330.0).sin() * (0.6 + 0.4 * (across * 71.0).sin()) * fade;
    let fibres = octave(Vec2::new(across * 420.0, p.y * 9.0), 420.0, 0x21, at) - 0.5;
    let streaks = octave(Vec2::new(across * 70.0, p.y * 1.7), 70.0, 0x22, at) - 0.5;
    let pores = octave(Vec2::new(p.x * 1300.0, p.y * 45.0), 900.0, 0x23, at);
    let dots = step(0.72, pores, 0.1);
    let tone = 1.0 + 0.14 * rings + 0.34 * fibres + 0.36 * streaks - 0.38 * dots;
    (color * tone).lerp(color * 0.32, knot)
}

/// Returns the share of a point that a knot covers, and how strongly the knot bends the surrounding
/// grain.
fn knot(p: Vec2, at: &SurfaceSample) -> (f32, f32) {
    const CELL: Vec2 = Vec2::new(0.31, 0.47);
    let cell = (p / CELL).floor();
    let (x, y) = (cell.x as i32, cell.y as i32);
    if hash(x, y, at.seed ^ 0x31) > 0.55 {
        return (0.0, 0.0);
    }
    let part = |salt: u32| 0.3 + 0.4 * hash(x, y, at.seed ^ salt);
    let centre = (cell + Vec2::new(part(0x32), part(0x33))) * CELL;
    let off = (p - centre) / Vec2::new(0.012, 0.018);
    let radius = off.length();
    let ripple = 0.85 + 0.15 * (radius * 14.0).sin();
    ((1.0 - step(radius, 0.9, 0.25)) * ripple, (-0.12 * radius * radius).exp())
}

fn paper(m: Vec2, height: f32, at: &SurfaceSample) -> Vec3 {
    let rim = Vec2::splat((1.2 * height).min(0.12 * at.size.min_element() as f32));
    let (low, high) = (rim, at.size.as_vec2() - rim);
    // Text rows run from the top down, the chart's v from the bottom up.
    let p = Vec2::new(m.x, at.size.y as f32 - m.y);
    let is_inside = p.cmpgt(low).all() && p.cmplt(high).all();
    let ink = if is_inside { text(p - low, height, at) } else { 0.0 };
    let fibre = 0.97 + 0.06 * octave(m * 250.0, 250.0, 0x41, at);
    (vec3(0.82, 0.81, 0.77) * fibre).lerp(vec3(0.035, 0.035, 0.05), ink)
}

/// Returns the ink coverage of lines of random letters at a point. Each letter is a 3 × 5 dot matrix.
fn text(p: Vec2, height: f32, at: &SurfaceSample) -> f32 {
    const MEAN_INK: f32 = 0.26;
    // A line has five rows of dots and two of spacing.
    let dot = height / 7.0;
    // Dots finer than a pixel would alias; their mean has the same brightness.
    if at.pixel_footprint > 1.5 * dot {
        return MEAN_INK;
    }
    softened(p, at.pixel_footprint, |p| {
        let cell = (p / dot).floor();
        let (column, row) = (cell.x as i32, cell.y as i32);
        let (letter, line) = (column.div_euclid(4), row.div_euclid(7));
        let (x, y) = (column.rem_euclid(4), row.rem_euclid(7));
        let pick = |salt: u32| hash(letter, line, at.seed ^ salt);
        // Blank columns between letters, blank letters between words, every eighth line blank.
        let is_blank = x == 3 || y > 4 || pick(0x42) < 0.17 || line.rem_euclid(8) == 7;
        // Some dots are always set, so that no letter is blank.
        let strokes = (pick(0x43) * 32768.0) as u32 | 0b010_000_010_000_010;
        let bit = strokes >> (x + 3 * y) & 1;
        f32::from(u8::from(!is_blank && bit == 1))
    })
}

fn poster(m: Vec2, at: &SurfaceSample) -> Vec3 {
    let size = at.size.as_vec2();
    let p = Vec2::new(m.x, size.y - m.y);
    let (rim, head) = (0.05 * size.x, 0.24 * size.y);
    let picture = 0.74 * size.y;
    if p.x < rim || p.x > size.x - rim || p.y < rim || p.y > size.y - rim {
        return vec3(0.70, 0.10, 0.08);
    }
    let cream = vec3(0.80, 0.74, 0.58);
    if p.y < head {
        let ink = text(p - rim, 0.36 * (head - rim), at);
        return cream.lerp(vec3(0.05, 0.10, 0.34), ink);
    }
    if p.y > picture {
        let ink = text(p - Vec2::new(rim, picture), 0.012, at);
        return cream.lerp(vec3(0.06, 0.05, 0.05), ink);
    }
    let v = (p.y - head) / (picture - head);
    let detail = octave(p * 130.0, 130.0, 0x51, at) + octave(p * 500.0, 500.0, 0x52, at) - 1.0;
    let hill = |i: f32| 0.30 + 0.2 * i + 0.2 * noise2(Vec2::new(p.x * (5.0 + 3.0 * i), i), 0x53);
    let mut color = vec3(0.18, 0.42, 0.66).lerp(vec3(0.86, 0.62, 0.36), v * 1.6);
    for (i, tone) in
        [vec3(0.30, 0.34, 0.46), vec3(0.14, 0.34, 0.20), vec3(0.36, 0.26, 0.07)].iter().enumerate()
    {
        let edge = hill(i as f32);
        color = color.lerp(*tone * (1.0 + 0.8 * detail), step(edge, v, at.pixel_footprint / 0.4));
    }
    color
}

fn tiles(m: Vec2, at: &SurfaceSample) -> Vec3 {
    const SIDE: f32 = 0.1;
    let cell = (m / SIDE).floor();
    let (x, y) = (cell.x as i32, cell.y as i32);
    let tint = hash(x, y, at.seed ^ 0x54);
    let p = m / SIDE - cell;
    // Quarter circles about two opposite corners; the hash picks the diagonal for each tile.
    let p = if hash(x, y, at.seed ^ 0x55) < 0.5 { p } else { Vec2::new(1.0 - p.x, p.y) };
    let near = p.length().min((Vec2::ONE - p).length());
    let soft = at.pixel_footprint / SIDE;
    let ring = step(near, 0.36, soft) - step(near, 0.46, soft);
    let speckle = octave(m * 700.0, 700.0, 0x56, at) - 0.5;
    let glaze = vec3(0.66, 0.66, 0.60).lerp(vec3(0.58, 0.64, 0.66), tint);
    let color = glaze.lerp(vec3(0.10, 0.22, 0.36), ring.abs()) * (1.0 + 0.3 * speckle);
    let gap = 0.003 / SIDE;
    let grout =
        antialiased_line(m.x / SIDE, gap, soft).max(antialiased_line(m.y / SIDE, gap, soft));
    color.lerp(vec3(0.26, 0.25, 0.23), grout)
}

fn plaster(m: Vec2, color: Vec3, at: &SurfaceSample) -> Vec3 {
    let coarse = octave(m * 38.0, 38.0, 0x57, at) - 0.5;
    let grit = octave(m * 190.0, 190.0, 0x58, at) - 0.5;
    let fine = octave(m * 620.0, 620.0, 0x59, at) - 0.5;
    let stains = noise2(m * 1.7, at.seed ^ 0x5a) - 0.5;
    color * (1.0 + 0.10 * coarse + 0.26 * grit + 0.24 * fine + 0.12 * stains)
}

fn steel(m: Vec2, at: &SurfaceSample) -> Vec3 {
    let p = if at.size.y >= at.size.x { m } else { Vec2::new(m.y, m.x) };
    let brush = octave(Vec2::new(p.x * 1500.0, p.y * 30.0), 1500.0, 0x5b, at) - 0.5;
    let bands = octave(Vec2::new(p.x * 160.0, p.y * 4.0), 160.0, 0x5c, at) - 0.5;
    vec3(0.42, 0.42, 0.44) * (1.0 + 0.4 * brush + 0.3 * bands)
}
