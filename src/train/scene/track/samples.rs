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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::{Camera, Intrinsics};
    use crate::math::image::Image;
    use crate::math::pose::Pose;
    use crate::observation::surface::{DepthTolerance, SurfacePoint};

    #[test]
    fn blocks_average_the_points_of_one_surface() {
        let point = |pixel: u32, range: f32, noise: f32| SurfacePoint {
            position: [range, 1.0, 2.0 * range],
            range,
            noise,
            color: [noise, 0.0, 0.0],
            normal: [0.0, 0.0, -1.0],
            pixel,
            ..SurfacePoint::default()
        };
        let points = vec![
            point(0, 2.0, 0.25),
            point(1, 2.05, 0.75),
            // Of another surface, in the next block, in the last row's block and beyond the image.
            point(4, 2.25, 9.0),
            point(6, 3.0, 0.5),
            point(11, 4.0, 0.125),
            point(16, 5.0, 9.0),
        ];
        let intrinsics = Intrinsics { width: 4, height: 3, fx: 2.0, fy: 2.0, cx: 2.0, cy: 1.5 };
        let frame = Observation {
            origin: DVec3::new(0.0, 1.0, 0.0),
            camera: Camera { intrinsics, pose: Pose::IDENTITY.with_origin(DVec3::Z) },
            points,
            point_weight: 1,
            ranges: Image::filled(4, 3, 0.0),
            tolerance: DepthTolerance { margin: [0.0; 2], refinement: 0.0, place: 0.0 },
            photograph: None,
        };
        let found = samples(&frame, 2);
        assert_eq!((found.samples.len(), found.alike), (3, 1.0));
        for (sample, [x, noise]) in
            found.samples.iter().zip([[2.025, 0.5], [3.0, 0.5], [4.0, 0.125]])
        {
            let expected = DVec3::new(x, 2.0, 2.0 * x + 1.0);
            assert!((sample.position - expected).length() < 1e-6, "{sample:?}");
            assert_eq!((sample.noise, sample.normal), (noise, DVec3::NEG_Z));
            assert!((sample.brightness - 0.299 * noise).abs() < 1e-12);
        }
        assert!((brightness([0.5, 0.25, 1.0]) - 0.410_25).abs() < 1e-7);
        let all = FrameSamples::of(&frame);
        assert_eq!((all.block, all.levels[0].samples.len(), all.depth), (1, 5, 5.5));
    }
}
