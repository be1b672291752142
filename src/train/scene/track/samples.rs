//! A frame as tracking compares it with the scene: few points with depth and brightness, at several
//! resolutions.

use crate::observation::surface::Observation;
use glam::DVec3;

/// Columns of the finest level, about.
const COLUMNS: usize = 160;
/// Blocks of a whole picture that err each by themselves.
const INDEPENDENT: f64 = 1000.0;
/// Levels, each with half the columns of the one before.
pub const LEVELS: usize = 3;
/// Points of a block belong to one surface if their ranges differ by at most this share.
const ONE_SURFACE: f32 = 0.03;

/// The mean of the points of a block of pixels.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// In the axes of the depth camera, world units from its centre.
    pub position: DVec3,
    /// Unit normal of the surface, in the same axes; zero where it is not known.
    pub normal: DVec3,
    /// Brightness in `[0, 1]`.
    pub brightness: f64,
    /// Half-width of the depth noise, world units.
    pub noise: f64,
}

/// Samples of one resolution.
pub struct SampleLevel {
    /// In rows from the top.
    pub samples: Vec<Sample>,
    /// How many neighbours err together and count as one: more, the finer the level.
    pub alike: f64,
}

/// A frame's samples, the finest level first.
pub struct FrameSamples {
    /// By level.
    pub levels: [SampleLevel; LEVELS],
    /// Pixels of the frame along one of the finest level's.
    pub block: usize,
    /// Median depth along the optical axis, world units.
    pub depth: f64,
    /// Mean brightness, 0 to 1.
    pub brightness: f64,
}

/// Brightness of an sRGB-encoded colour.
pub fn brightness(color: [f32; 3]) -> f64 {
    let [red, green, blue] = color.map(f64::from);
    0.299 * red + 0.587 * green + 0.114 * blue
}

/// Sums over the points of a block that lie on the surface of its first.
#[derive(Clone, Copy, Default)]
struct Block {
    range: f32,
    n: f64,
    position: DVec3,
    normal: DVec3,
    brightness: f64,
    noise: f64,
}

impl FrameSamples {
    /// Of a frame as it was prepared, wherever its pose says that it stood.
    pub fn of(frame: &Observation) -> Self {
        let width = frame.camera.intrinsics.width as usize;
        let block = (width / COLUMNS).max(1);
        let levels: [_; LEVELS] = std::array::from_fn(|level| samples(frame, block << level));
        let finest = &levels[0].samples;
        let mut depths: Vec<f64> = finest.iter().map(|sample| sample.position.z).collect();
        depths.sort_unstable_by(f64::total_cmp);
        let depth = depths.get(depths.len() / 2).copied().unwrap_or(0.0);
        let n = finest.len().max(1) as f64;
        let brightness = finest.iter().map(|sample| sample.brightness).sum::<f64>() / n;
        Self { levels, block, depth, brightness }
    }
}

fn samples(frame: &Observation, block: usize) -> SampleLevel {
    let intrinsics = &frame.camera.intrinsics;
    // Pictures without columns, as of frames that are made by hand, have blocks without points.
    let [width, height] = [intrinsics.width.max(1), intrinsics.height].map(|side| side as usize);
    let (columns, rows) = (width.div_ceil(block), height.div_ceil(block));
    let mut blocks = vec![Block::default(); columns * rows];
    for point in &frame.points {
        let (column, row) = (point.pixel as usize % width, point.pixel as usize / width);
        let Some(block) = blocks.get_mut(row / block * columns + column / block) else { continue };
        if block.n == 0.0 {
            block.range = point.range;
        } else if (point.range - block.range).abs() > ONE_SURFACE * block.range {
            continue;
        }
        block.n += 1.0;
        block.position += point.position_vector();
        block.normal += point.normal_vector();
        block.brightness += brightness(point.color);
        block.noise += f64::from(point.noise);
    }
    let (rotation, shift) = frame.camera.pose.inverse();
    let sample = |block: &Block| Sample {
        position: rotation * (block.position / block.n + frame.origin) + shift,
        normal: (rotation * block.normal).normalize_or_zero(),
        brightness: block.brightness / block.n,
        noise: block.noise / block.n,
    };
    let alike = (blocks.len() as f64 / INDEPENDENT).max(1.0);
    let samples = blocks.iter().filter(|block| block.n > 0.0).map(sample).collect();
    SampleLevel { samples, alike }
}
