//! Samples of a frame for tracking: a few points with depth and brightness at several resolutions.

use crate::observation::surface::Observation;
use glam::DVec3;

/// Approximate number of columns of samples at the finest level.
const COLUMNS: usize = 160;
/// Number of blocks with independent errors in a whole picture.
const INDEPENDENT: f64 = 1000.0;
/// Number of resolution levels, each with half the columns of the previous one.
pub const LEVELS: usize = 3;
/// Maximum relative difference in range between points of a block that belong to one surface.
const ONE_SURFACE: f32 = 0.03;

/// Mean of the points of a block of pixels.
#[derive(Clone, Copy, Debug)]
pub struct Sample {
    /// Position in the depth camera's frame, world units.
    pub position: DVec3,
    /// Unit surface normal in the depth camera's frame; zero if unknown.
    pub normal: DVec3,
    pub brightness: f64,
    /// Half-width of the depth noise, world units.
    pub noise: f64,
}

pub struct SampleLevel {
    /// Samples, row by row from the top.
    pub samples: Vec<Sample>,
    /// Number of neighbouring samples that count as one independent sample, since their errors
    /// correlate. Larger for finer levels.
    pub alike: f64,
}

/// Samples of a frame, finest level first.
pub struct FrameSamples {
    pub levels: [SampleLevel; LEVELS],
    /// Width of a block of the finest level, in pixels of the frame.
    pub block: usize,
    /// Median depth along the optical axis, world units.
    pub depth: f64,
    pub brightness: f64,
}

/// Returns the brightness of an sRGB-encoded colour, 0 to 1.
pub fn brightness(color: [f32; 3]) -> f64 {
    let [red, green, blue] = color.map(f64::from);
    // Luma weights of ITU-R BT.601.
    0.299 * red + 0.587 * green + 0.114 * blue
}

/// Sums over the points of a block that belong to the same surface as the block's first point.
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
    /// Samples a frame. Positions and normals are in the depth camera's frame, so the camera's pose has
    /// no effect.
    pub fn of(frame: &Observation) -> Self {
        let width = frame.camera.intrinsics.width as usize;
        let block = (width / COLUMNS).max(1);
        let levels: [_; LEVELS] = std::array::from_fn(|level| samples(frame, block << level));
        let finest = &levels[0].samples;
        let mut depths: Vec<f64> = finest.iter().map(|sample| sample.position.z).collect();
        // The median, since a few distant points would dominate a mean.
        depths.sort_unstable_by(f64::total_cmp);
        let depth = depths.get(depths.len() / 2).copied().unwrap_or(0.0);
        let n = finest.len().max(1) as f64;
        let brightness = finest.iter().map(|sample| sample.brightness).sum::<f64>() / n;
        Self { levels, block, depth, brightness }
    }
}

fn samples(frame: &Observation, block: usize) -> SampleLevel {
    let intrinsics = &frame.camera.intrinsics;
    // Hand-made frames may have images without columns; their blocks have no points.
    let [width, height] = [intrinsics.width.max(1), intrinsics.height].map(|side| side as usize);
    let (columns, rows) = (width.div_ceil(block), height.div_ceil(block));
    let mut blocks = vec![Block::default(); columns * rows];
    for point in &frame.points {
        let (column, row) = (point.pixel as usize % width, point.pixel as usize / width);
        // Points of hand-made frames may name pixels beyond the image.
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
