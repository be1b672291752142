//! Where a photograph's camera stood, given splats (`eval.md`, Poses aligned).
//!
//! The scene's own alignment of frames (`train::scene::align`) needs sums that exported models do not
//! hold, and the depth of a frame, which a photograph may lack. So this is the same estimate, a most
//! probable small motion by Gauss-Newton with Cauchy weights under a prior about the recorded pose, on
//! what every model has: its picture and the depth behind each pixel. From small images to the whole one,
//! because slopes of a photograph hold for about a pixel.
//!
//! Slopes are the render's, not the photograph's: detail that splats do not show would make the photograph
//! look steeper than what can match it, and steps that much too short.
//!
//! The result is judged, not trusted: of the poses visited the one is taken whose picture is nearest to
//! the photograph, so that an alignment which fails leaves the recorded pose.

use super::comparison::{COVERED, aligned_error};
use super::scale::area_averaged;
use super::sizes::MetricError;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::cholesky::Cholesky;
use crate::math::image::RgbImage;
use crate::math::pose::Pose;
use crate::render::Renderer;
use crate::render::cpu::Rendered;
use glam::{DQuat, DVec3};
use rayon::prelude::*;

/// Fractions of the photograph's sides, one drawing each.
const SCALES: [f64; 4] = [0.25, 0.5, 1.0, 1.0];
/// Gauss-Newton steps on one drawing at most.
const ROUNDS: usize = 10;
/// Shift in the image, pixels, of a step after which more would not pay.
const MIN_STEP: f64 = 0.01;
/// Standard deviation of a recorded orientation, radians.
const TURN_DEVIATION: f64 = 0.02;
/// Standard deviation of a recorded position, in mean depths of what is seen.
const SHIFT_DEVIATION: f64 = 0.02;
/// Neighbouring pixels err together: so many count as one.
const ALIKE: f64 = 100.0;
/// Residuals of so many mean ones weigh a half.
const ROBUST: f64 = 2.0;
/// Fewest pixels that determine a motion.
const MIN_PIXELS: usize = 200;
/// Pixels of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 4096;

/// A camera near the recorded one, and what it shows.
pub struct AlignedCamera {
    /// Where it stands.
    pub pose: Pose,
    /// The view from there.
    pub rendered: Rendered,
}

/// Moves a camera to where its view comes nearest to its photograph, colours aligned. `draw` renders
/// from a camera, `rendered` from the one given, by the same renderer.
///
/// # Errors
/// Photograph and view differ in size.
pub fn aligned(
    camera: &Camera,
    rendered: Rendered,
    truth: &RgbImage,
    renderer: Renderer,
    mut draw: impl FnMut(&Camera) -> Rendered,
) -> Result<AlignedCamera, MetricError> {
    let mut least = aligned_error(&rendered.color, &rendered.coverage, truth)?;
    let mut best = AlignedCamera { pose: camera.pose, rendered };
    let mut memory = SeenPoints::default();
    for scale in SCALES {
        let k = camera.intrinsics.scaled(scale);
        let size = [k.width as usize, k.height as usize];
        let points = shown(&best, &camera.intrinsics, &k, renderer);
        let photograph = area_averaged(truth, size);
        let moved = moved(&points, &photograph, &k, [&camera.pose, &best.pose], &mut memory);
        let Some(pose) = moved else { continue };
        let rendered = draw(&Camera { pose, ..*camera });
        let error = aligned_error(&rendered.color, &rendered.coverage, truth)?;
        if error < least {
            (least, best) = (error, AlignedCamera { pose, rendered });
        }
    }
    Ok(best)
}

/// A place in the world and the colour that splats give it.
struct ShownPoint {
    place: DVec3,
    color: [f64; 3],
    /// How the colour changes by column and row, per pixel.
    slope: [[f64; 2]; 3],
}

/// What covered pixels show, at the size of `k`.
fn shown(
    view: &AlignedCamera,
    full: &Intrinsics,
    k: &Intrinsics,
    renderer: Renderer,
) -> Vec<ShownPoint> {
    let Rendered { color, coverage, depth, .. } = &view.rendered;
    let (width, height) = (k.width as usize, k.height as usize);
    let small = area_averaged(color, [width, height]);
    // Neither depth nor coverage is averaged: between a surface and another behind it there is nothing.
    let under = |column: usize, row: usize| {
        [(2 * column + 1) * color.width / (2 * width), (2 * row + 1) * color.height / (2 * height)]
    };
    let is_covered = |column: usize, row: usize| {
        let [x, y] = under(column, row);
        *coverage.at(x, y) >= COVERED
    };
    let mut points = Vec::new();
    // The rim has no slopes, nor has what lies beside a hole, where the background would make an edge.
    for row in 1..height.saturating_sub(1) {
        for column in 1..width.saturating_sub(1) {
            let at = under(column, row);
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
            let z = match renderer {
                Renderer::Projected => length,
                Renderer::Exact => length / ray.length(),
            };
            // Its depth, under the pixel of the smaller image that shows its colour.
            let place = view.pose.transform_point(k.ray(column, row) * z);
            points.push(ShownPoint { place, color: small.at(column, row).map(f64::from), slope });
        }
    }
    points
}

/// A point as the photograph shows it: its colour there, and how the render's changes with the camera's
/// turn and shift, channel by channel.
#[derive(Clone)]
struct PhotographedPoint {
    shown: [f64; 3],
    seen: [f64; 3],
    slope: [[f64; 6]; 3],
    z: f64,
}

/// Points that are in a photograph, in their order. Kept from round to round: fresh memory for some
/// 60 MB a round was a third of the time.
#[derive(Default)]
struct SeenPoints {
    parts: Vec<Vec<PhotographedPoint>>,
    all: Vec<PhotographedPoint>,
}

impl SeenPoints {
    /// Replaces them by what `look_up` finds of points.
    fn fill(
        &mut self,
        points: &[ShownPoint],
        look_up: impl Fn(&ShownPoint) -> Option<PhotographedPoint> + Sync,
    ) {
        let Self { parts, all } = self;
        parts.resize_with(points.len().div_ceil(CHUNK), Vec::new);
        parts.par_iter_mut().zip(points.par_chunks(CHUNK)).for_each(|(part, points)| {
            part.clear();
            part.extend(points.iter().filter_map(&look_up));
        });
        all.clear();
        parts.iter().for_each(|part| all.extend_from_slice(part));
    }
}

/// The pose, from the second of two on, that brings points to their colours in a photograph; the first
/// is the recorded one. `None` where too few are in it.
fn moved(
    points: &[ShownPoint],
    photograph: &RgbImage,
    k: &Intrinsics,
    [recorded, first]: [&Pose; 2],
    memory: &mut SeenPoints,
) -> Option<Pose> {
    let mut pose = *first;
    for _ in 0..ROUNDS {
        let (rotation, translation) = pose.inverse();
        memory.fill(points, |point| {
            look_up(photograph, k, rotation * point.place + translation, point)
        });
        let seen = &memory.all;
        if seen.len() < MIN_PIXELS {
            return None;
        }
        let depth = seen.iter().map(|point| point.z).sum::<f64>() / seen.len() as f64;
        let [turn, shift] = step(seen, recorded, &pose, SHIFT_DEVIATION * depth)?;
        pose = pose.attached(shift, DQuat::from_scaled_axis(turn));
        let pixels = k.fx.max(k.fy) * (turn.length() + shift.length() / depth);
        if pixels < MIN_STEP {
            break;
        }
    }
    Some(pose)
}

/// A point of the camera's frame in the photograph; `None` outside.
fn look_up(
    photograph: &RgbImage,
    k: &Intrinsics,
    p: DVec3,
    point: &ShownPoint,
) -> Option<PhotographedPoint> {
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
        // A camera that moves by `shift` and turns by `turn` sees the point at p − shift − turn × p.
        let place = DVec3::new(across, down, -(across * p.x + down * p.y) / p.z);
        let turn = place.cross(p);
        found.slope[i] = [turn.x, turn.y, turn.z, -place.x, -place.y, -place.z];
    }
    Some(found)
}

/// Turn (axis times angle) and shift of the camera in its own axes.
fn step(
    points: &[PhotographedPoint],
    recorded: &Pose,
    pose: &Pose,
    shift_deviation: f64,
) -> Option<[DVec3; 2]> {
    let lines = [0, 1, 2].map(|channel| line(points, channel));
    let residual = |point: &PhotographedPoint, i: usize| {
        point.seen[i] - lines[i][0] * point.shown[i] - lines[i][1]
    };
    let size =
        |point: &PhotographedPoint| (0..3).map(|i| residual(point, i).powi(2)).sum::<f64>().sqrt();
    let usual = points.iter().map(size).sum::<f64>() / points.len() as f64;
    // Equal images leave nothing to weigh by; any scale gives the same step of nothing.
    let scale = (ROBUST * usual).max(f64::MIN_POSITIVE.sqrt());
    let parts: Vec<CameraSums> = points
        .par_chunks(CHUNK)
        .map(|points| {
            let mut sums = CameraSums::ZERO;
            for point in points {
                let trust = 1.0 / (1.0 + (size(point) / scale).powi(2));
                for (i, [gain, _]) in lines.iter().enumerate() {
                    sums.add(residual(point, i), &point.slope[i].map(|slope| gain * slope), trust);
                }
            }
            sums
        })
        .collect();
    let mut sums = CameraSums::ZERO;
    parts.iter().for_each(|part| sums.add_sums(part));
    let variance = ALIKE * (sums.square / sums.weight).max(f64::MIN_POSITIVE.sqrt());
    let (mut matrix, mut right) =
        (sums.matrix.map(|v| v / variance), sums.right.map(|v| v / variance));
    // About the recorded pose in every round: about the last one, rounds could wander off.
    let back = pose.rotation().transpose();
    let turned = DQuat::from_mat3(&(recorded.rotation().transpose() * pose.rotation()));
    let (turn, shift) = (turned.to_scaled_axis(), back * (pose.centre() - recorded.centre()));
    for axis in 0..3 {
        for (i, value, deviation) in
            [(axis, turn[axis], TURN_DEVIATION), (axis + 3, shift[axis], shift_deviation)]
        {
            matrix[7 * i] += deviation.powi(-2);
            right[i] -= value * deviation.powi(-2);
        }
    }
    let x = Cholesky::new(6, &matrix)?.solve(&right);
    let [turn, shift] = [DVec3::from_slice(&x[..3]), DVec3::from_slice(&x[3..])];
    (turn.is_finite() && shift.is_finite()).then_some([turn, shift])
}

/// Factor and offset that bring a channel to the photograph's exposure.
fn line(points: &[PhotographedPoint], channel: usize) -> [f64; 2] {
    let n = points.len() as f64;
    let mean =
        |value: &dyn Fn(&PhotographedPoint) -> f64| points.iter().map(value).sum::<f64>() / n;
    let (x, y) = (mean(&|p| p.shown[channel]), mean(&|p| p.seen[channel]));
    let xx = mean(&|p| (p.shown[channel] - x).powi(2));
    let xy = mean(&|p| (p.shown[channel] - x) * (p.seen[channel] - y));
    // A render of one colour fits any line; the one with factor 1 is taken.
    let gain = if xx > 1e-8 { xy / xx } else { 1.0 };
    [gain, y - gain * x]
}

/// Normal equations of turn and shift.
struct CameraSums {
    /// Row by row; the lower triangle.
    matrix: [f64; 36],
    right: [f64; 6],
    square: f64,
    weight: f64,
}

impl CameraSums {
    const ZERO: Self = Self { matrix: [0.0; 36], right: [0.0; 6], square: 0.0, weight: 0.0 };

    fn add(&mut self, residual: f64, slope: &[f64; 6], weight: f64) {
        self.square += weight * residual * residual;
        self.weight += weight;
        for i in 0..6 {
            self.right[i] -= weight * residual * slope[i];
            for j in 0..=i {
                self.matrix[6 * i + j] += weight * slope[i] * slope[j];
            }
        }
    }

    fn add_sums(&mut self, other: &Self) {
        self.square += other.square;
        self.weight += other.weight;
        self.matrix.iter_mut().zip(other.matrix).for_each(|(a, b)| *a += b);
        self.right.iter_mut().zip(other.right).for_each(|(a, b)| *a += b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::image::Image;
    use crate::math::rng::{Purpose, Rng};

    const SIZE: (u32, u32) = (96, 72);

    /// A painted wall with a step in it, as a camera sees it whose centre and turn are given.
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
        let real = Pose::IDENTITY.attached(DVec3::new(0.02, -0.015, 0.01), turn);
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

    /// Slopes of the photograph would hold this detail too, and shorten every step.
    #[test]
    fn detail_that_splats_lack_does_not_hide_a_motion() {
        let real = Pose::IDENTITY.attached(DVec3::new(0.03, -0.02, 0.0), DQuat::IDENTITY);
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
}
