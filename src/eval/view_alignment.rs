//! Alignment of a view's camera pose to its photograph, given splats (`evaluation.md`, Poses aligned).
//!
//! Alignment during training (`train::scene::align`) needs sufficient statistics that exported models
//! lack, and depth that a photograph may lack. The alignment here makes the same estimate from the
//! render and its depth, which every model has. It finds the maximum a posteriori motion by Gauss-Newton
//! with Cauchy weights and a prior on the recorded pose. It proceeds from small images to full size,
//! because image gradients are valid for about a pixel.
//!
//! Gradients are the render's: the photograph's gradients include detail that the splats lack, so they
//! would be too steep and steps too short. Pixels of large images are sampled: their errors are correlated, so
//! most of them would add time and hardly any information.
//!
//! Of all visited poses the one with the smallest error is returned, so a failed alignment leaves the
//! recorded pose.

use super::comparison::{COVERED, Comparison, MIN_VARIANCE, aligned_error, compare};
use super::detail::Detail;
use super::metrics::{MetricError, is_left_out, mean};
use super::scale::area_averaged;
use super::sharpness;
use super::sharpness::{N_BANDS, SharpnessBand};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::{Image, RgbImage};
use crate::math::least_squares::NormalEquations;
use crate::math::pose::Pose;
use crate::render::Renderer;
use crate::render::cpu::Rendered;
use glam::{DQuat, DVec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

// Full size twice: the second render is from a corrected pose.
const SCALES: [f64; 4] = [0.25, 0.5, 1.0, 1.0];
/// Maximum number of Gauss-Newton steps per render.
const ROUNDS: usize = 10;
/// Step, in pixels of image shift, below which the iteration has converged.
const MIN_STEP: f64 = 0.01;
/// Prior standard deviation of a recorded orientation, radians.
const TURN_DEVIATION: f64 = 0.02;
/// Prior standard deviation of a recorded position, relative to the mean depth of the view.
const SHIFT_DEVIATION: f64 = 0.02;
/// Number of pixels that count as one measurement, because the errors of neighbouring pixels are
/// correlated.
const CORRELATED_PIXELS: f64 = 100.0;
/// Residual, in multiples of the mean, at which a point has weight ½.
const HALF_WEIGHT_MEANS: f64 = 2.0;
const MIN_PIXELS: usize = 200;
/// Number of pixels of an image that are compared, at most.
const MOST_PIXELS: usize = 40_000;
/// Number of points per partial sum. Because it is fixed, sums do not depend on the number of threads.
const CHUNK: usize = 2048;

pub(super) struct AlignedCamera {
    pub pose: Pose,
    pub rendered: Rendered,
}

/// Moves a camera to minimise the colour-aligned error of its view against the photograph. `draw`
/// renders the splats from a given camera; `rendered` is the view from `camera` by the same renderer.
pub(super) fn aligned(
    camera: &Camera,
    rendered: Rendered,
    truth: &RgbImage,
    renderer: Renderer,
    mut draw: impl FnMut(&Camera) -> Rendered,
) -> Result<AlignedCamera, MetricError> {
    let mut least = aligned_error(&rendered.color, &rendered.coverage, truth)?;
    let mut best = AlignedCamera { pose: camera.pose, rendered };
    for scale in SCALES {
        let k = camera.intrinsics.scaled(scale);
        let size = [k.width as usize, k.height as usize];
        // From the best pose so far: a scale that failed must not affect the next.
        let points = rendered_points(&best, &camera.intrinsics, &k, renderer);
        let photograph = area_averaged(truth, size);
        let moved = align_pose(&points, &photograph, &k, [&camera.pose, &best.pose]);
        let Some(pose) = moved else { continue };
        let rendered = draw(&Camera { pose, ..*camera });
        let error = aligned_error(&rendered.color, &rendered.coverage, truth)?;
        if error < least {
            (least, best) = (error, AlignedCamera { pose, rendered });
        }
    }
    Ok(best)
}

/// Every `stride`-th column and row of a render that has a surface.
struct RenderedPoints {
    points: Vec<RenderedPoint>,
    stride: usize,
}

struct RenderedPoint {
    place: DVec3,
    color: [f64; 3],
    /// Derivatives of each channel with respect to column and row, per pixel.
    slope: [[f64; 2]; 3],
}

/// Returns points of covered pixels whose neighbours are also covered, at the image size of `k`.
fn rendered_points(
    view: &AlignedCamera,
    full: &Intrinsics,
    k: &Intrinsics,
    renderer: Renderer,
) -> RenderedPoints {
    let Rendered { color, coverage, depth, .. } = &view.rendered;
    let (width, height) = (k.width as usize, k.height as usize);
    let small = area_averaged(color, [width, height]);
    // Depth and coverage are not averaged: a mean of two surfaces is on neither.
    let under = |column: usize, row: usize| {
        // The full-size pixel under the centre of the smaller one.
        [(2 * column + 1) * color.width / (2 * width), (2 * row + 1) * color.height / (2 * height)]
    };
    let is_covered = |column: usize, row: usize| {
        let [x, y] = under(column, row);
        *coverage.at(x, y) >= COVERED
    };
    let stride = ((width * height) as f64 / MOST_PIXELS as f64).sqrt().ceil().max(1.0) as usize;
    let mut points = Vec::new();
    // Excludes the border, which has no gradient, and neighbours of uncovered pixels, where the background
    // would add an edge.
    for row in (1..height.saturating_sub(1)).step_by(stride) {
        for column in (1..width.saturating_sub(1)).step_by(stride) {
            let at = under(column, row);
            // Full-size depth under the smaller image's pixel.
            let length = f64::from(*depth.at(at[0], at[1]));
            let beside =
                [(column - 1, row), (column + 1, row), (column, row - 1), (column, row + 1)];
            let is_inside = beside.iter().all(|&(x, y)| is_covered(x, y));
            if !is_covered(column, row) || !is_inside || length <= 0.0 {
                continue;
            }
            let [left, right, above, below] = beside.map(|(x, y)| small.at(x, y).map(f64::from));
            let slope =
                std::array::from_fn(|i| [0.5 * (right[i] - left[i]), 0.5 * (below[i] - above[i])]);
            let ray = full.ray(at[0], at[1]);
            // The projected renderer measures z, the exact one the distance along the ray.
            let z = match renderer {
                Renderer::Projected => length,
                Renderer::Exact => length / ray.length(),
            };
            let place = view.pose.transform_point(k.ray(column, row) * z);
            let color = small.at(column, row).map(f64::from);
            points.push(RenderedPoint { place, color, slope });
        }
    }
    RenderedPoints { points, stride }
}

/// A point sampled in the photograph: its colours in the render and the photograph, and its depth.
/// `slope` is the Jacobian of the rendered colour with respect to the camera's rotation and translation,
/// one row per channel.
struct PhotographedPoint {
    shown: [f64; 3],
    seen: [f64; 3],
    slope: [[f64; 6]; 3],
    z: f64,
}

/// Aligns a camera pose to a photograph by matching the points' colours, with a prior centred on the
/// pose `recorded`. The iteration starts at the pose `first`. Returns `None` if too few points are in
/// the image.
fn align_pose(
    RenderedPoints { points, stride }: &RenderedPoints,
    photograph: &RgbImage,
    k: &Intrinsics,
    [recorded, first]: [&Pose; 2],
) -> Option<Pose> {
    // Pixels that are apart share less of their errors.
    let correlated = (CORRELATED_PIXELS / (stride * stride) as f64).max(1.0);
    let mut pose = *first;
    for _ in 0..ROUNDS {
        let (rotation, translation) = pose.inverse();
        let look_up = |point: &RenderedPoint| {
            sample_photograph(photograph, k, rotation * point.place + translation, point)
        };
        let seen: Vec<_> = points.par_iter().with_min_len(CHUNK).filter_map(look_up).collect();
        if seen.len() * stride * stride < MIN_PIXELS {
            return None;
        }
        let depth = seen.iter().map(|point| point.z).sum::<f64>() / seen.len() as f64;
        let [turn, shift] = step(&seen, recorded, &pose, SHIFT_DEVIATION * depth, correlated)?;
        pose = pose.attached_camera(shift, DQuat::from_scaled_axis(turn));
        // Motion in the image at the mean depth.
        let pixels = k.fx.max(k.fy) * (turn.length() + shift.length() / depth);
        if pixels < MIN_STEP {
            break;
        }
    }
    Some(pose)
}

fn sample_photograph(
    photograph: &RgbImage,
    k: &Intrinsics,
    p: DVec3,
    point: &RenderedPoint,
) -> Option<PhotographedPoint> {
    // Relative to pixel centres, which are at +½, for the bilinear weights below.
    let [x, y] = [k.fx * p.x / p.z + k.cx - 0.5, k.fy * p.y / p.z + k.cy - 0.5];
    let (width, height) = (photograph.width, photograph.height);
    let is_inside =
        p.z > 0.0 && x >= 0.0 && y >= 0.0 && x < width as f64 - 1.0 && y < height as f64 - 1.0;
    if !is_inside {
        return None;
    }
    let (column, row) = (x as usize, y as usize);
    let (s, t) = (x - column as f64, y - row as f64);
    let texel = |i: usize, j: usize| photograph.at(column + i, row + j).map(f64::from);
    let [a, b, c, d] = [texel(0, 0), texel(1, 0), texel(0, 1), texel(1, 1)];
    let mut found =
        PhotographedPoint { shown: point.color, seen: [0.0; 3], slope: [[0.0; 6]; 3], z: p.z };
    for i in 0..3 {
        let (top, bottom) = (a[i] + (b[i] - a[i]) * s, c[i] + (d[i] - c[i]) * s);
        found.seen[i] = top + (bottom - top) * t;
        let [across, down] = [k.fx * point.slope[i][0] / p.z, k.fy * point.slope[i][1] / p.z];
        // Moving the camera by `shift` and rotating it by `turn` maps the point to p − shift − turn × p.
        let place = DVec3::new(across, down, -(across * p.x + down * p.y) / p.z);
        let turn = place.cross(p);
        found.slope[i] = [turn.x, turn.y, turn.z, -place.x, -place.y, -place.z];
    }
    (!is_left_out(&found.seen)).then_some(found)
}

/// Returns the Gauss-Newton step: rotation (axis times angle) and translation in the camera frame.
fn step(
    points: &[PhotographedPoint],
    recorded: &Pose,
    pose: &Pose,
    shift_deviation: f64,
    correlated: f64,
) -> Option<[DVec3; 2]> {
    let lines = [0, 1, 2].map(|channel| fit_exposure(points, channel));
    let residual = |point: &PhotographedPoint, i: usize| {
        point.seen[i] - lines[i][0] * point.shown[i] - lines[i][1]
    };
    let size =
        |point: &PhotographedPoint| (0..3).map(|i| residual(point, i).powi(2)).sum::<f64>().sqrt();
    let usual = points.iter().map(size).sum::<f64>() / points.len() as f64;
    // Avoids division by zero for equal images, where any scale yields a zero step.
    let scale = (HALF_WEIGHT_MEANS * usual).max(f64::MIN_POSITIVE.sqrt());
    let parts: Vec<NormalEquations<6>> = points
        .par_chunks(CHUNK)
        .map(|points| {
            let mut sums = NormalEquations::ZERO;
            for point in points {
                let trust = 1.0 / (1.0 + (size(point) / scale).powi(2));
                for (i, [gain, _]) in lines.iter().enumerate() {
                    // The residual contains `gain · shown`, so its slope has the gain as well.
                    let slope = point.slope[i].map(|slope| gain * slope);
                    sums.add_residual(residual(point, i), &slope, trust);
                    sums.n += trust;
                }
            }
            sums
        })
        .collect();
    let sums = NormalEquations::total(&parts);
    // Bounded for equal images, whose residuals are all zero.
    let variance = correlated * sums.variance().max(f64::MIN_POSITIVE.sqrt());
    let mut equations = NormalEquations::<6>::ZERO;
    equations.add(&sums, variance.recip());
    // The prior stays on the recorded pose in all iterations; on the previous one, poses could drift.
    let back = pose.rotation().transpose();
    let turned = DQuat::from_mat3(&(recorded.rotation().transpose() * pose.rotation()));
    let (turn, shift) = (turned.to_scaled_axis(), back * (pose.centre() - recorded.centre()));
    for axis in 0..3 {
        equations.add_prior(axis, turn[axis], TURN_DEVIATION);
        equations.add_prior(axis + 3, shift[axis], shift_deviation);
    }
    let step = equations.solution()?;
    Some([DVec3::from_slice(&step[..3]), DVec3::from_slice(&step[3..])])
}

/// Fits the gain and offset that map a channel of the render to the photograph's exposure.
fn fit_exposure(points: &[PhotographedPoint], channel: usize) -> [f64; 2] {
    let n = points.len() as f64;
    let mean =
        |value: &dyn Fn(&PhotographedPoint) -> f64| points.iter().map(value).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p.shown[channel]), mean(&|p| p.seen[channel]));
    let xx = mean(&|p| (p.shown[channel] - x).powi(2));
    let xy = mean(&|p| (p.shown[channel] - x) * (p.seen[channel] - y));
    // A constant channel fits any line; gain 1 is used.
    let gain = if xx > MIN_VARIANCE { xy / xx } else { 1.0 };
    [gain, y - gain * x]
}

/// Quality of a view rendered from the pose aligned to its photograph, or the mean over views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlignedView {
    /// Distance of the aligned pose from the original one, world units.
    pub shift: f64,
    /// Angle between the aligned and the original pose, degrees.
    pub turn: f64,
    /// PSNR over the whole frame, dB.
    pub psnr: f64,
    /// PSNR over covered pixels, dB.
    pub psnr_covered: f64,
    /// PSNR over covered pixels with colours aligned, dB.
    pub psnr_aligned_covered: f64,
    /// SSIM over window positions inside the image (`valid` padding).
    pub ssim: f64,
    /// SSIM with colours aligned.
    pub ssim_aligned: f64,
    /// SSIM of the gradient magnitudes with colours aligned.
    pub gradient_ssim: f64,
    /// Sharpness per octave from the finest, with colours aligned.
    pub bands: [SharpnessBand; N_BANDS],
}

impl AlignedView {
    /// Compares the render from the aligned camera with the photograph. Returns `None` if no pixel is
    /// covered or the photograph has no detail.
    pub(super) fn compare(
        [from, to]: [&Pose; 2],
        shown: &RgbImage,
        coverage: &Image<f32>,
        truth: &RgbImage,
    ) -> Result<Option<Self>, MetricError> {
        let Comparison { psnr, ssim, covered, .. } = compare(shown, coverage, truth)?;
        let Some(covered) = covered else { return Ok(None) };
        // At the photograph's exposure: a darker render has less energy but is not less sharp.
        let exposed = &covered.aligned;
        let Some(bands) = sharpness::bands(exposed, coverage, truth) else { return Ok(None) };
        let turn = DQuat::from_mat3(&(from.rotation().transpose() * to.rotation()));
        Ok(Some(Self {
            shift: (to.centre() - from.centre()).length(),
            turn: turn.to_scaled_axis().length().to_degrees(),
            psnr,
            psnr_covered: covered.psnr,
            psnr_aligned_covered: covered.aligned_psnr,
            ssim,
            ssim_aligned: covered.aligned_ssim,
            gradient_ssim: sharpness::gradient_ssim(exposed, truth)?,
            bands,
        }))
    }

    /// Returns the detail at the aligned pose, which the two finest bands contain.
    pub fn detail(&self) -> Detail {
        let [finest, second, ..] = self.bands;
        Detail::of_bands(&[finest, second])
    }

    pub(super) fn mean(views: &[Self]) -> Option<Self> {
        let of = |value: fn(&Self) -> f64| mean(views.iter().map(value));
        let bands: Vec<_> = views.iter().map(|view| view.bands).collect();
        Some(Self {
            bands: sharpness::mean(&bands)?,
            shift: of(|view| view.shift)?,
            turn: of(|view| view.turn)?,
            psnr: of(|view| view.psnr)?,
            psnr_covered: of(|view| view.psnr_covered)?,
            psnr_aligned_covered: of(|view| view.psnr_aligned_covered)?,
            ssim: of(|view| view.ssim)?,
            ssim_aligned: of(|view| view.ssim_aligned)?,
            gradient_ssim: of(|view| view.gradient_ssim)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    const SIZE: (u32, u32) = (96, 72);

    fn wall(camera: &Camera) -> Rendered {
        let (width, height) = (SIZE.0 as usize, SIZE.1 as usize);
        let mut color = Image::filled(width, height, [0.0; 3]);
        let mut depth = Image::filled(width, height, 0.0);
        for i in 0..width * height {
            let ray = camera.pose.rotation() * camera.intrinsics.ray(i % width, i / width);
            let centre = camera.pose.centre();
            let hit = |z: f64| centre + ray * ((z - centre.z) / ray.z);
            let near = hit(1.6);
            let place = if near.x < 0.0 { near } else { hit(2.2) };
            let shade = |a: f64, b: f64| {
                (0.5 + 0.2 * (a * place.x).sin() + 0.2 * (b * place.y).cos()) as f32
            };
            color.data[i] = [shade(9.0, 7.0), shade(5.0, 11.0), shade(13.0, 4.0)];
            let local = camera.pose.rotation().transpose() * (place - centre);
            depth.data[i] = local.z as f32;
        }
        Rendered { color, coverage: Image::filled(width, height, 1.0), depth, n_invalid: 0 }
    }

    fn camera(pose: Pose) -> Camera {
        Camera { intrinsics: Intrinsics::from_horizontal_fov(SIZE.0, SIZE.1, 1.0), pose }
    }

    #[test]
    fn a_moved_camera_is_found_whatever_the_exposure() {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.01, -0.012, 0.008));
        let real = Pose::IDENTITY.attached_camera(DVec3::new(0.02, -0.015, 0.01), turn);
        let truth = wall(&camera(real)).color.map(|p| p.map(|v| 0.8 * v + 0.05));
        let recorded = camera(Pose::IDENTITY);
        let found = aligned(&recorded, wall(&recorded), &truth, Renderer::Projected, wall).unwrap();
        assert!((found.pose.centre() - real.centre()).length() < 1.5e-3, "{:?}", found.pose);
        let rest = DQuat::from_mat3(&(found.pose.rotation().transpose() * real.rotation()));
        assert!(rest.to_scaled_axis().length() < 8e-4, "{rest:?}");
        let [before, after] = [&wall(&recorded), &found.rendered]
            .map(|view| aligned_error(&view.color, &view.coverage, &truth).unwrap());
        assert!(after < 0.05 * before, "{before} {after}");
    }

    /// Gradients of the photograph would include detail that splats lack and would shorten every step.
    #[test]
    fn detail_that_splats_lack_does_not_hide_a_motion() {
        let real = Pose::IDENTITY.attached_camera(DVec3::new(0.03, -0.02, 0.0), DQuat::IDENTITY);
        let mut rng = Rng::new(4, Purpose::Synthetic, 0);
        let mut noisy = |v: f32| v + 0.3 * (rng.uniform() - 0.5) as f32;
        let truth = wall(&camera(real)).color.map(|p| p.map(&mut noisy));
        let recorded = camera(Pose::IDENTITY);
        let found = aligned(&recorded, wall(&recorded), &truth, Renderer::Projected, wall).unwrap();
        let [before, after] = [&wall(&recorded), &found.rendered].map(|view| {
            aligned_error(&view.color, &view.coverage, &wall(&camera(real)).color).unwrap()
        });
        assert!(after < 0.1 * before, "{before} {after} {:?}", found.pose);
    }

    #[test]
    fn a_right_pose_and_a_photograph_of_something_else_stay() {
        let recorded = camera(Pose::IDENTITY);
        let view = wall(&recorded);
        let draw = |c: &Camera| wall(c);
        let same =
            aligned(&recorded, view.clone(), &view.color, Renderer::Projected, draw).unwrap();
        assert!(same.pose.centre().length() < 1e-4, "{:?}", same.pose);
        let flat = Image::filled(view.color.width, view.color.height, [0.4; 3]);
        let kept = aligned(&recorded, view.clone(), &flat, Renderer::Projected, draw).unwrap();
        assert!(kept.pose.centre().length() < 1e-3, "{:?}", kept.pose);
        let empty = Rendered { coverage: view.coverage.map(|_| 0.0), ..view };
        let kept = aligned(&recorded, empty, &flat, Renderer::Projected, draw).unwrap();
        assert_eq!(kept.pose, Pose::IDENTITY);
    }

    /// Exposure is compensated before sharpness is compared.
    #[test]
    fn a_darker_view_is_as_sharp() {
        let mut rng = Rng::new(5, Purpose::Synthetic, 0);
        let pixel = |_| std::array::from_fn(|_| (0.2 + 0.5 * rng.uniform()) as f32);
        let truth = Image::from_vec(32, 24, (0..32 * 24).map(pixel).collect());
        let dark = truth.map(|p| p.map(|v| 0.5 * v));
        let turn = DQuat::from_rotation_y(0.5f64.to_radians());
        let to = Pose::IDENTITY.attached_camera(DVec3::new(0.0, 0.03, 0.04), turn);
        let coverage = Image::filled(32, 24, 1.0);
        let poses = [&Pose::IDENTITY, &to];
        let view = AlignedView::compare(poses, &dark, &coverage, &truth).unwrap().unwrap();
        assert!((view.shift - 0.05).abs() < 1e-9 && (view.turn - 0.5).abs() < 1e-6, "{view:?}");
        assert!(view.psnr < 15.0 && view.psnr_aligned_covered > 80.0, "{view:?}");
        assert!(view.bands.iter().all(|band| (band.energy_ratio - 1.0).abs() < 1e-3), "{view:?}");
        assert!(view.gradient_ssim > 0.999, "{view:?}");
        let other = AlignedView { shift: 0.15, ..view };
        assert!((AlignedView::mean(&[view, other]).unwrap().shift - 0.1).abs() < 1e-9);
        assert_eq!(AlignedView::mean(&[]), None);
        let nothing = AlignedView::compare(poses, &dark, &coverage.map(|_| 0.1), &truth).unwrap();
        assert_eq!(nothing, None);
    }
}
