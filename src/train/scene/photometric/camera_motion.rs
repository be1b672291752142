//! Alignment of a photograph's camera with the splats (`photographs.md`, Poses of photographs).
//!
//! The pose of a frame is that of its points. Its photograph may have been taken at another moment or with another
//! lens, so the pose of the photograph differs by a fraction of a pixel to a few pixels. That blurs what splats learn.
//!
//! The scene is rendered once from the pose of the points. The photograph's pixels of known depth are projected into
//! the picture, and Gauss-Newton steps with Cauchy weights find the camera's most probable motion under a prior.
//! Gradients are the picture's: those of the photograph include detail that splats lack, which would shorten steps.

use super::comparers::TrainingView;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pose::Pose;
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::CpuRenderer;
use crate::train::scene::rigid_equations::{Motion, RigidEquations};
use crate::train::scene::track::{Reference, ReferenceLevel, brightness};
use glam::{DQuat, DVec3};
use rayon::prelude::*;

/// Approximate number of compared pixels of a photograph with depth everywhere.
const PIXELS: f64 = 4000.0;
/// Maximum number of pixels of the picture.
const PICTURE_PIXELS: f64 = 40_000.0;
/// Maximum number of Gauss-Newton steps.
const STEPS: usize = 8;
/// Step, relative to the prior deviations, below which the iteration has converged.
const SMALL_STEP: f64 = 0.01;
/// Number of neighbouring pixels that count as one measurement, because their errors are correlated.
const CORRELATED_PIXELS: f64 = 100.0;
/// Residual, in multiples of the mean, at which a pixel has weight ½.
const HALF_WEIGHT_MEANS: f64 = 2.0;
/// Value of a colour channel from which the photograph may be clipped.
const CLIPPED: f32 = 0.97;
/// Minimum number of compared pixels.
const MIN_PIXELS: usize = 200;
/// Number of pixels per partial sum. Because it is fixed, sums do not depend on the number of threads.
const CHUNK: usize = 1024;

/// A pixel of the photograph.
struct Pixel {
    /// Surface point in the photograph's camera frame, world units.
    place: DVec3,
    brightness: f64,
}

/// A pixel compared with the picture. Axes are those of the camera from which the picture was drawn.
struct Compared {
    arm: DVec3,
    seen: f64,
    shown: f64,
    slope: DVec3,
}

/// Returns the pose of a photograph that fits the rendered splats best. `deviations` are the prior standard
/// deviations of its rotation (radians) and position (world units) about the pose in `view`. `None` if too few pixels
/// can be compared.
pub fn aligned_pose(
    renderer: &mut CpuRenderer,
    splats: SplatView<'_>,
    view: &TrainingView,
    photograph: &Image<MeasuredPixel>,
    deviations: [f64; 2],
) -> Option<Pose> {
    let pose = view.camera.pose;
    let stored = photograph.data.len() as f64 / f64::from(view.rows.stride());
    let columns = (stored / PIXELS).ceil().max(1.0) as usize;
    let pixels = pixels(view, photograph, columns);
    if pixels.len() < MIN_PIXELS {
        return None;
    }
    let block = (photograph.data.len() as f64 / PICTURE_PIXELS).sqrt().ceil() as usize;
    let picture = Reference::draw(renderer, splats, &pose, &view.camera.intrinsics, block, 0.0);
    let each = columns as f64 * f64::from(view.rows.stride());
    let correlated = (CORRELATED_PIXELS / each).max(1.0);
    let motion = motion(&pixels, &picture.levels[0], correlated, deviations)?;
    Some(pose.attached_camera(motion.shift, motion.turn))
}

/// Returns pixels of known depth: one of every `stride` columns of the compared rows.
fn pixels(view: &TrainingView, photograph: &Image<MeasuredPixel>, stride: usize) -> Vec<Pixel> {
    let k = &view.camera.intrinsics;
    let rows = (view.rows.first() as usize..photograph.height).step_by(view.rows.stride() as usize);
    let of_row = |row: usize| {
        let columns = (0..photograph.width).step_by(stride);
        columns.filter_map(move |column| {
            let pixel = photograph.at(column, row);
            let is_clipped = pixel.color.iter().any(|channel| *channel >= CLIPPED);
            (pixel.per_tolerance > 0.0 && !is_clipped).then(|| Pixel {
                place: k.ray(column, row) * f64::from(pixel.depth),
                brightness: brightness(pixel.color),
            })
        })
    };
    rows.flat_map(of_row).collect()
}

/// Returns the most probable motion of the camera, in the axes of the camera that drew the picture.
fn motion(
    pixels: &[Pixel],
    picture: &ReferenceLevel,
    correlated: f64,
    deviations: [f64; 2],
) -> Option<Motion> {
    let mut motion = Motion { turn: DQuat::IDENTITY, shift: DVec3::ZERO };
    for _ in 0..STEPS {
        let compare = |pixel: &Pixel| {
            let arm = motion.turn * pixel.place;
            let texel = picture.at(arm + motion.shift)?;
            let (seen, shown) = (pixel.brightness, texel.brightness);
            Some(Compared { arm, seen, shown, slope: texel.brightness_slope })
        };
        let compared: Vec<_> = pixels.par_iter().with_min_len(CHUNK).filter_map(compare).collect();
        if compared.len() < MIN_PIXELS {
            return None;
        }
        let [turn, shift] = step(&compared, &motion, correlated, deviations)?;
        motion.turn = (DQuat::from_scaled_axis(turn) * motion.turn).normalize();
        motion.shift += shift;
        let [turns, shifts] = deviations;
        if turn.length() < SMALL_STEP * turns && shift.length() < SMALL_STEP * shifts {
            break;
        }
    }
    Some(motion)
}

/// Returns a Gauss-Newton step: rotation (axis times angle) and translation.
fn step(
    compared: &[Compared],
    motion: &Motion,
    correlated: f64,
    deviations: [f64; 2],
) -> Option<[DVec3; 2]> {
    let n = compared.len() as f64;
    // Exposures differ: only variations of brightness are compared.
    let mean = |of: fn(&Compared) -> f64| compared.iter().map(of).sum::<f64>() / n;
    let (seen, shown) = (mean(|c| c.seen), mean(|c| c.shown));
    let both = compared.iter().map(|c| (c.seen - seen) * (c.shown - shown)).sum::<f64>();
    let squares = compared.iter().map(|c| (c.shown - shown).powi(2)).sum::<f64>();
    let gain = if squares > 0.0 { both / squares } else { return None };
    let residual = |c: &Compared| gain * (c.shown - shown) - (c.seen - seen);
    let usual = compared.iter().map(|c| residual(c).abs()).sum::<f64>() / n;
    // Positive, so that an equal picture divides by no zero.
    let scale = (HALF_WEIGHT_MEANS * usual).max(f64::MIN_POSITIVE.sqrt());
    let trust = |residual: f64| 1.0 / (1.0 + (residual / scale).powi(2));
    let part = |part: &[Compared]| {
        let (mut sums, mut trusted, mut errors) = (RigidEquations::NONE, 0.0, 0.0);
        for c in part {
            let apart = residual(c);
            let weight = trust(apart);
            sums.add(apart, gain * c.slope, c.arm, weight);
            trusted += weight;
            errors += weight * apart * apart;
        }
        (sums, trusted, errors)
    };
    let parts: Vec<_> = compared.par_chunks(CHUNK).map(part).collect();
    let trusted = parts.iter().map(|part| part.1).sum::<f64>();
    let errors = parts.iter().map(|part| part.2).sum::<f64>();
    let variance = (correlated * errors / trusted).max(f64::MIN_POSITIVE.sqrt());
    let mut equations = RigidEquations::prior(motion, deviations);
    parts.iter().for_each(|(sums, ..)| equations.add_weighted(sums, variance.recip()));
    equations.solution()
}

/// A wall of splats and cameras before it.
#[cfg(test)]
pub(in crate::train::scene) mod fixtures {
    use crate::math::camera::{Camera, Intrinsics};
    use crate::math::pose::Pose;
    use crate::model::splat::splats::Splat;
    use glam::{DQuat, DVec3};

    pub const DEVIATIONS: [f64; 2] = [0.01, 0.02];

    /// A wall of overlapping splats at depth 2, bright and dark without a period.
    pub fn wall() -> Vec<Splat> {
        let splat = |i: usize| {
            let (x, y) = ((i % 40) as f32 * 0.1 - 2.0, (i / 40) as f32 * 0.1 - 1.5);
            let shade = 0.5 + 0.2 * (3.0 * x + 2.0 * y * y).sin() + 0.2 * (4.0 * y - x * x).cos();
            // Depths differ from splat to splat, so that a turn does not change which one is in front.
            let mean = [x, y, 2.0 + 0.02 * (5 * i % 13) as f32];
            Splat { mean, opacity: 0.99, scale: [0.1; 3], color: [shade; 3], ..Splat::default() }
        };
        (0..1200).map(splat).collect()
    }

    pub fn camera(pose: Pose) -> Camera {
        Camera { intrinsics: Intrinsics::from_horizontal_fov(160, 120, 1.0), pose }
    }

    /// Pose that differs from the identity by some milliradians.
    pub fn moved() -> Pose {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.003, -0.004, 0.005));
        Pose::IDENTITY.attached_camera(DVec3::new(0.004, -0.003, 0.002), turn)
    }

    /// Returns by how much a point of the wall seems to move between two poses, radians.
    pub fn apart(pose: &Pose, other: &Pose) -> f64 {
        let (shift, turn) = pose.offset_to(other);
        (turn * (DVec3::Z * 2.0) + shift - DVec3::Z * 2.0).truncate().length() / 2.0
    }
}

#[cfg(test)]
mod tests {
    use super::fixtures::{DEVIATIONS, apart, camera, moved, wall};
    use super::*;
    use crate::render::cpu::photometric::RowSubset;
    use crate::render::{RenderMethod, RenderOptions};

    fn view(pose: Pose) -> TrainingView {
        TrainingView {
            camera: camera(pose),
            near: 0.2,
            rows: RowSubset::new(2, 1),
            outlier_factor: 6.0,
            per_depth_pixel: 1.0,
            frame: 0,
        }
    }

    /// Returns a photograph of the wall in another exposure.
    fn photograph(splats: SplatView<'_>, pose: Pose) -> Image<MeasuredPixel> {
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let drawn = CpuRenderer::new().render(splats, &view(pose).camera, &options);
        let pixel = |(&[r, g, b], &depth): (&[f32; 3], &f32)| {
            let color = [r, g, b].map(|channel| 0.7 * channel + 0.1);
            MeasuredPixel::without_depth([color[0], color[1], color[2], 1.0])
                .with_depth(depth, [0.02, 0.0])
        };
        let pixels = drawn.color.data.iter().zip(&drawn.depth.data).map(pixel).collect();
        Image::from_vec(160, 120, pixels)
    }

    fn aligned(image: &Image<MeasuredPixel>, deviations: [f64; 2]) -> Option<Pose> {
        let splats = wall();
        let splats = SplatView::new(&splats, &[])?;
        let mut renderer = CpuRenderer::new();
        aligned_pose(&mut renderer, splats, &view(Pose::IDENTITY), image, deviations)
    }

    #[test]
    fn a_moved_photograph_is_found_whatever_its_exposure() {
        let real = moved();
        let splats = wall();
        let image = photograph(SplatView::new(&splats, &[]).unwrap(), real);
        let found = aligned(&image, DEVIATIONS).unwrap();
        let (before, after) = (apart(&Pose::IDENTITY, &real), apart(&found, &real));
        assert!(before > 4e-3 && after < 0.1 * before, "{before} {after}");
        // A narrow prior holds the photograph at the pose of its points.
        let held = aligned(&image, DEVIATIONS.map(|deviation| 1e-3 * deviation)).unwrap();
        assert!(apart(&held, &Pose::IDENTITY) < 0.1 * before, "{held:?}");
    }

    #[test]
    fn a_photograph_of_nothing_or_without_depth_has_no_pose_of_its_own() {
        let splats = wall();
        let image = photograph(SplatView::new(&splats, &[]).unwrap(), Pose::IDENTITY);
        let still = apart(&aligned(&image, DEVIATIONS).unwrap(), &Pose::IDENTITY);
        assert!(still < 3e-4, "{still}");
        let without_depth = image.map(|pixel| MeasuredPixel { per_tolerance: 0.0, ..*pixel });
        assert_eq!(aligned(&without_depth, DEVIATIONS), None);
        let clipped = image.map(|pixel| MeasuredPixel { color: [1.0; 3], ..*pixel });
        assert_eq!(aligned(&clipped, DEVIATIONS), None);
        let grey = image.map(|pixel| MeasuredPixel { color: [0.5; 3], ..*pixel });
        assert_eq!(aligned(&grey, DEVIATIONS).map(|pose| pose.centre()), Some(DVec3::ZERO));
        let broken = image.map(|pixel| MeasuredPixel { color: [f32::NAN; 3], ..*pixel });
        assert_eq!(aligned(&broken, DEVIATIONS), None);
    }
}
