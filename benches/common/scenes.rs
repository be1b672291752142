//! Frames and means for the benches.

use glam::DVec3;
use std::path::Path;
use vbgs_studio::dataset::frame::{DepthCodes, Frame};
use vbgs_studio::dataset::unproject::{
    CameraConvention, EdgeFilter, UnprojectSettings, Unprojector,
};
use vbgs_studio::dataset::{LoadOptions, open};
use vbgs_studio::math::image::Image;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::observation::points::Points;
use vbgs_studio::train::paper::init::InitialDraw;

/// Pixels per side of the smooth surface, a multiple of the tile size.
const SMOOTH_SIDE: usize = 440;

/// Three sets of means: the paper's random start, the state after reassignment (points of another frame), and
/// a cluster with 90 % of the means in a Gaussian of standard deviation 0.02.
pub fn draws(components: usize, other: &Points<f32>) -> [(&'static str, InitialDraw); 3] {
    let random = InitialDraw::random(components, 0);
    let mut rng = Rng::new(1, Purpose::Synthetic, 0);
    // Drawn without replacement, as in reassignment, until all points are used.
    let mut order: Vec<usize> = (0..other.len()).collect();
    rng.shuffle(&mut order);
    let row = |&i: &usize| {
        let ([x, y, z], [r, g, b]) = (other.position(i), other.color(i));
        [x, y, z, r, g, b].map(f64::from)
    };
    let (mut surface, mut cluster) = (random.clone(), random.clone());
    surface.means = order.iter().cycle().take(components).map(row).collect();
    let centre = row(&(other.len() / 2));
    for (_, mean) in cluster.means.iter_mut().enumerate().filter(|(k, _)| k % 10 != 0) {
        *mean = centre.map(|c| c + 0.02 * rng.normal());
    }
    [("random", random), ("surface", surface), ("cluster", cluster)]
}

/// Wavy surface seen from above, tile by tile.
pub fn smooth(phase: f32) -> Points<f32> {
    let mut points = Points::new();
    let pitch = 3.0 / SMOOTH_SIDE as f32;
    for tile in 0..(SMOOTH_SIDE / 8).pow(2) {
        let (column, row) = (tile % (SMOOTH_SIDE / 8) * 8, tile / (SMOOTH_SIDE / 8) * 8);
        for k in 0..64 {
            let (quad, line, i) = (k / 16, k / 4 % 4, k % 4);
            let x = (column + quad % 2 * 4 + i) as f32 * pitch - 1.5 + 1e-3 * phase;
            let y = (row + quad / 2 * 4 + line) as f32 * pitch - 1.5;
            let z = 0.5 * (2.0 * x + 0.01 * phase).sin() * (1.5 * y).cos();
            let color = [3.0 * x, 2.0 * y, x - y].map(|v| 1.5 * (4.0 * v).sin());
            points.push([x, y, z, color[0], color[1], color[2]]);
        }
        points.close_tile();
    }
    points
}

/// Points of the given frames of Lego at 800 pixels, one entry per frame; `None` without the dataset.
pub fn lego(indices: impl IntoIterator<Item = usize>) -> Option<Vec<Points<f32>>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/lego400");
    let Ok(dataset) = open(&path, &LoadOptions::default()) else {
        println!("skipped: {} not found", path.display());
        return None;
    };
    let split = dataset.splits.iter().position(|s| s.has_depth)?;
    let settings = UnprojectSettings {
        convention: CameraConvention::Paper,
        filter: EdgeFilter::DropMixed,
        normalization: Normalization::from_range(DVec3::NEG_ONE, DVec3::ONE),
    };
    let load = |index| {
        let mut points = Points::new();
        let frame = doubled(dataset.load(split, index).expect("a sound frame"));
        Unprojector::new().unproject(&frame, &settings, &mut points).expect("a frame with depth");
        points
    };
    Some(indices.into_iter().map(load).collect())
}

/// Merges the points of several frames into one.
pub fn together(frames: &[Points<f32>]) -> Points<f32> {
    let mut all = Points::new();
    for frame in frames {
        for i in 0..frame.len() {
            let ([x, y, z], [r, g, b]) = (frame.position(i), frame.color(i));
            all.push([x, y, z, r, g, b]);
        }
        all.close_tile();
    }
    all
}

/// Doubles the resolution of a frame by repeating every pixel in a 2×2 block.
pub fn doubled(mut frame: Frame) -> Frame {
    let k = &mut frame.camera.intrinsics;
    (k.width, k.height) = (2 * k.width, 2 * k.height);
    (k.fx, k.fy, k.cx, k.cy) = (2.0 * k.fx, 2.0 * k.fy, 2.0 * k.cx, 2.0 * k.cy);
    frame.color = double(&frame.color).into();
    if let Some(depth) = &mut frame.depth {
        match &mut depth.codes {
            DepthCodes::Inverse8(codes) => *codes = double(codes),
            DepthCodes::Linear16 { codes, .. } => *codes = double(codes),
            DepthCodes::Lengths(lengths) => *lengths = double(lengths),
        }
    }
    frame
}

fn double<T: Copy>(image: &Image<T>) -> Image<T> {
    let (width, height) = (2 * image.width, 2 * image.height);
    let at = |i: usize| *image.at(i % width / 2, i / width / 2);
    Image::from_vec(width, height, (0..width * height).map(at).collect())
}
