//! Checks poses, depth unit and focal length without ground truth: depth of a frame, transformed by both
//! poses into a neighbouring frame, must match the neighbour's depth.
//!
//! A wrong convention loads without an error and yields a useless model. So other conventions, depth
//! units and faults of recordings are tried on the same pairs of frames, and a far better one is
//! suggested. The camera must have moved within a pair: without motion every convention fits, and with pure
//! rotation every unit fits. Photographs of another frame do not show in depth; their colours are compared.

use super::calibration::ColorCamera;
use super::capture_check::reduced_luma;
use super::entry::map_photographs;
use super::entry::{DatasetSplit, FrameEntry};
use super::opened::Dataset;
use super::range::median;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::{Pose, PoseError};
use glam::{DMat3, DMat4, DVec3, DVec4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use strum::{EnumIter, EnumMessage, EnumString, IntoEnumIterator, IntoStaticStr, VariantNames};

const MAX_PAIRS: usize = 8;
/// Distances between the frames of a pair, in frames; tried in order until the camera has moved enough.
const GAPS: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// Sufficient camera motion within a pair of frames: translation as a share of the median depth, or
/// rotation in radians.
const MIN_MOTION: [f64; 2] = [0.05, 0.1];
/// Number of frames of a growing recording after which its poses can be checked. With fewer frames, the
/// camera has hardly moved.
pub const ENOUGH_FRAMES: usize = 33;
/// Approximate number of samples along a row or column of a depth image.
const SAMPLES: usize = 36;
/// Largest relative difference between depths that count as matching.
const TOLERANCE: f64 = 0.04;
/// Minimum share of samples that must project into the neighbour's image. If fewer do, the missing
/// samples are counted as mismatches.
const MIN_OVERLAP: f64 = 0.25;
/// Largest depth factor that is searched; the smallest is its reciprocal. It includes metres for steps of
/// a tenth of a millimetre.
const MAX_UNIT: f64 = 10_000.0;
/// Ratio of neighbouring depth factors of the search. Depth within [`TOLERANCE`] of one of them agrees.
const UNIT_STEP: f64 = 1.05;
/// Conditions for suggesting another interpretation (pose convention with depth unit): minimum gain in
/// agreement over the interpretation in use, and minimum agreement.
const MIN_GAIN: [f64; 2] = [0.2, 0.5];
/// Conditions for suggesting another depth unit for the same poses with a smaller gain in agreement:
/// minimum gain, largest share of the relative error that remains, and minimum change of the unit.
const MIN_UNIT_GAIN: [f64; 3] = [0.02, 0.5, 0.05];

/// Ratio of neighbouring factors of the search near 1, on the focal length or the depth, and number of steps
/// to either side.
const NEAR_SEARCH: (f64, i32) = (1.02, 15);
/// Conditions for suggesting a factor near 1: largest share of the error that remains, and minimum change. At
/// most a quarter of the pairs may contradict it.
const MIN_NEAR_GAIN: [f64; 2] = [0.9, 0.03];
/// Conditions for a warning without a known cause: largest agreement, and minimum share of samples in front
/// of measured surfaces. Distant views of a good recording agree less, because surfaces hide others; at most
/// 0.06 were in front.
const UNUSUAL: [f64; 2] = [0.8, 0.1];
/// Maximum number of pairs whose photographs are compared, and minimum number for a finding.
const COLOR_PAIRS: [usize; 2] = [6, 3];
/// Approximate width of compared photographs, pixels.
const COLOR_COLUMNS: usize = 320;
/// Largest rotation between compared photographs, radians.
const MAX_COLOR_ROTATION: f64 = 0.5;
/// Limit to which luma differences are clamped (luma in 0 to 1). Reflections cause larger ones.
const MAX_COLOR_ERROR: f64 = 0.2;
/// Largest share of the luma difference that remains if photographs belong to another frame.
const MAX_COLOR_REMAINS: f64 = 0.8;

/// Result of the pose check.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseCheck {
    /// Number of compared pairs of frames.
    pub pairs: usize,
    /// Interpretation used when the recording was opened.
    pub opened: PoseTrial,
    /// True if the user chose the pose convention, false if it is the layout's.
    pub is_user_set: bool,
    /// Best interpretation; equals `opened` unless another one is far better.
    pub best: PoseTrial,
    /// Number of places by which photographs follow the depth that they belong to; 0 unless colours of
    /// neighbouring frames agree far better so.
    pub color_shift: i8,
    /// Horizontal focal length of the depth camera, pixels.
    pub focal: f64,
}

/// Fault of a recording that shows where a frame is compared with its neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// Images are mirrored left to right against the poses.
    MirroredColumns,
    /// Images are mirrored top to bottom against the poses, or the poses' world is mirrored.
    MirroredRows,
    /// Images are rotated clockwise against the poses, in quarter turns from 1 to 3.
    Rotated(u8),
    /// The true focal length is this factor times the stated one.
    FocalLength(f64),
    /// Images belong to poses so many places later in the list; negative for earlier ones.
    Shifted(i8),
}

/// Interpretation of poses and depth (pose convention and depth unit), and how well it fits the compared
/// pairs of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseTrial {
    /// Convention of the pose matrices.
    pub poses: PoseConvention,
    /// Factor on the depth of the opened dataset.
    pub unit: f64,
    /// Fault of the recording that this interpretation undoes.
    pub fault: Option<Fault>,
    /// Share of samples that match the neighbour's depth, 0 to 1.
    pub agreement: f64,
    /// Share of samples in front of the surface that the neighbour measured, 0 to 1. Occlusion puts samples
    /// behind it, but none in front.
    pub in_front: f64,
    /// Median difference from the neighbour's depth along the optical axis, world units.
    pub error: f64,
}

impl PoseCheck {
    /// Returns a warning for each finding: what the frames indicate, and what to do.
    pub fn warnings(&self) -> Vec<String> {
        let percent = |agreement: f64| format!("{:.0} %", 100.0 * agreement);
        let (opened, best) = (&self.opened, &self.best);
        let mut warnings = Vec::new();
        if best != opened {
            let [found, advice] = self.reading();
            warnings.push(format!(
                "{found}: {} of depth agrees with neighbouring frames, {} as opened; {advice}",
                percent(best.agreement),
                percent(opened.agreement)
            ));
        } else if self.is_unusual() {
            warnings.push(format!(
                "only {} of depth agrees with neighbouring frames, expected {} or more; check poses, \
                 focal length, lens terms and depth unit",
                percent(opened.agreement),
                percent(UNUSUAL[0])
            ));
        }
        if self.color_shift != 0 {
            warnings.push(format!(
                "photographs seem to belong to the depth one frame {}: colours of neighbouring frames \
                 agree better so; correct the names or times of the photographs",
                earlier_or_later(-self.color_shift)
            ));
        }
        warnings
    }

    /// True if depth contradicts the frames as opened, whatever the cause.
    fn is_unusual(&self) -> bool {
        let [agreement, in_front] = UNUSUAL;
        // Few pairs may by chance show what noise, edges and moving objects do.
        self.pairs >= MAX_PAIRS / 2
            && self.opened.agreement < agreement
            && self.opened.in_front > in_front
    }

    /// Describes the best interpretation, and what to do about it.
    fn reading(&self) -> [String; 2] {
        let (opened, best) = (&self.opened, &self.best);
        let (mut found, mut advice) = (Vec::new(), Vec::new());
        if best.poses != opened.poses {
            let source = if self.is_user_set { "pose axes are set to" } else { "the layout has" };
            let (best, opened) = (best.poses.name(), opened.poses.name());
            found.push(format!("the poses match {best}, but {source} {opened}"));
            advice.push(format!("choose the pose axes (`--pose-axes {best}`)"));
        }
        // Exactly 1 is the unit as read.
        if best.unit != 1.0 {
            let unit = rounded(best.unit);
            found.push(format!("depth seems to be {unit} times as long as read"));
            advice.push(format!(
                "set the depth scale (`--depth-scale`) to {unit} times the present one"
            ));
        }
        match best.fault {
            None => {}
            Some(fault @ (Fault::MirroredColumns | Fault::MirroredRows)) => {
                let (way, axis) = match fault {
                    Fault::MirroredColumns => ("left to right", "x"),
                    _ => ("top to bottom", "y"),
                };
                found.push(format!("images and poses are mirrored {way} against each other"));
                advice.push(format!("mirror the images, or negate {axis} in the poses (S·pose·S)"));
            }
            Some(Fault::Rotated(turns)) => {
                let angle = 90 * u32::from(turns);
                found.push(format!(
                    "images are rotated by {angle} degrees clockwise against the poses"
                ));
                advice.push("rotate the images back, or the cameras of the poses".to_owned());
            }
            Some(Fault::FocalLength(factor)) => {
                let focal = self.focal * factor;
                let change = rounded(factor);
                found.push(format!(
                    "the focal length seems to be {change} times the stated one, {focal:.0} px"
                ));
                advice.push(
                    "correct it or the lens terms, or set the intrinsics (`--intrinsics`)"
                        .to_owned(),
                );
            }
            Some(Fault::Shifted(places)) => {
                let way = earlier_or_later(places);
                found.push(format!("images seem to belong to the poses one frame {way}"));
                advice.push("correct the list of poses".to_owned());
            }
        }
        [found.join(" and "), advice.join(" and ")]
    }
}

fn earlier_or_later(places: i8) -> &'static str {
    if places < 0 { "earlier" } else { "later" }
}

fn rounded(factor: f64) -> String {
    // Three digits of small factors, too.
    let text = format!("{factor:.7}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

impl Fault {
    /// Faults that concern all frames alike, whatever their order and camera.
    const OF_IMAGES: [Self; 5] = [
        Self::MirroredColumns,
        Self::MirroredRows,
        Self::Rotated(1),
        Self::Rotated(2),
        Self::Rotated(3),
    ];

    /// Returns the matrix from viewing rays of the camera as opened to those of the true camera.
    fn camera(self) -> DMat3 {
        let diagonal = |x, y| DMat3::from_diagonal(DVec3::new(x, y, 1.0));
        match self {
            Self::MirroredColumns => diagonal(-1.0, 1.0),
            Self::MirroredRows => diagonal(1.0, -1.0),
            // Exact, unlike a rotation by sine and cosine. Image y points down, so x to y is clockwise.
            Self::Rotated(1) => DMat3::from_cols(DVec3::NEG_Y, DVec3::X, DVec3::Z),
            Self::Rotated(2) => diagonal(-1.0, -1.0),
            Self::Rotated(_) => DMat3::from_cols(DVec3::Y, DVec3::NEG_X, DVec3::Z),
            Self::FocalLength(factor) => diagonal(1.0 / factor, 1.0 / factor),
            Self::Shifted(_) => DMat3::IDENTITY,
        }
    }
}

/// Compares the depth of a split's frames with that of neighbouring frames, for several pose
/// conventions and depth units. Returns `None` if no two frames can be compared, or if poses are left
/// to tracking.
///
/// ```
/// use vbgs_studio::dataset::{PoseConvention, pose_check};
///
/// let room = vbgs_studio::dataset::synthetic::demo()?;
/// let check = pose_check::check(&room, 0).ok_or("too few frames")?;
/// assert!(check.opened.agreement > 0.8 && check.warnings().is_empty(), "{check:?}");
/// assert_eq!(check.opened.poses, PoseConvention::Opencv);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check(dataset: &Dataset, split: usize) -> Option<PoseCheck> {
    if dataset.options.track {
        return None;
    }
    let split = dataset.splits.get(split)?;
    let stated = dataset.options.poses.unwrap_or(dataset.layout.pose_convention());
    let pairs = pairs(split);
    let focal = pairs.first()?.intrinsics.fx;
    let trial = |poses, unit, fault| PoseTrial::of(&pairs, stated, poses, unit, fault);
    let opened = trial(stated, 1.0, None);
    // Higher agreement leaves no room for a better interpretation.
    let is_open = |poses: &PoseConvention| {
        let gain = if *poses == stated { MIN_UNIT_GAIN[0] } else { MIN_GAIN[0] };
        opened.agreement < 1.0 - gain
    };
    let of_convention = |poses: PoseConvention| {
        let shifts: &[_] = match poses == stated {
            true => &[Fault::Shifted(-1), Fault::Shifted(1)],
            false => &[],
        };
        let faults = Fault::OF_IMAGES.iter().chain(shifts);
        let mut trials: Vec<_> = faults.map(|&fault| trial(poses, 1.0, Some(fault))).collect();
        trials.push(best_unit(|unit| trial(poses, unit, None)));
        trials
    };
    let conventions: Vec<_> = PoseConvention::iter().filter(is_open).collect();
    let trials: Vec<_> = conventions.into_par_iter().flat_map_iter(of_convention).collect();
    let better =
        trials.into_iter().filter(|t| t.agreement > MIN_GAIN[1] && t.is_better_than(&opened));
    let far = better.max_by(PoseTrial::by_agreement).unwrap_or(opened);
    let near = [
        best_near(&pairs, &opened, |factor| (1.0, Some(Fault::FocalLength(factor)))),
        best_near(&pairs, &opened, |unit| (unit, None)),
    ];
    let best = near
        .into_iter()
        .flatten()
        .fold(far, |best, found| if found.relative() < best.relative() { found } else { best });
    Some(PoseCheck {
        pairs: pairs.len(),
        opened,
        is_user_set: dataset.options.poses.is_some(),
        best,
        color_shift: color_shift(dataset, split),
        focal,
    })
}

/// Finds the factor near 1 of the smallest error, if it is far smaller than as opened and most pairs of
/// frames agree. Such factors change agreement by little. `reading` returns depth unit and fault for a factor.
fn best_near(
    pairs: &[FramePair],
    opened: &PoseTrial,
    reading: fn(f64) -> (f64, Option<Fault>),
) -> Option<PoseTrial> {
    let trial = |pairs: &[FramePair], factor| {
        let (unit, fault) = reading(factor);
        PoseTrial::of(pairs, opened.poses, opened.poses, unit, fault)
    };
    let error = |pairs: &[FramePair], factor| trial(pairs, factor).relative();
    let (step, n) = NEAR_SEARCH;
    let factors: Vec<f64> = (-n..=n).map(|i| step.powi(i)).collect();
    let errors: Vec<_> = factors.into_par_iter().map(|f| (f, error(pairs, f))).collect();
    let (coarse, _) = errors.into_iter().min_by(|(_, a), (_, b)| a.total_cmp(b))?;
    let factor = refined(coarse, step.ln(), |factor| error(pairs, factor));
    let found = trial(pairs, factor);
    let [remains, change] = MIN_NEAR_GAIN;
    // Beyond the search, the error may have another cause.
    let is_inside = factor.ln().abs() < f64::from(n) * step.ln();
    let improves = |pair: &&FramePair| {
        let pair = std::slice::from_ref(*pair);
        error(pair, factor) < error(pair, 1.0)
    };
    let is_far_better = is_inside
        && factor.ln().abs() > change
        && found.relative() < remains * opened.relative()
        && found.agreement > MIN_GAIN[1]
        && 4 * pairs.iter().filter(improves).count() >= 3 * pairs.len();
    is_far_better.then_some(found)
}

/// Refines a factor to the least of `error`, with three digits.
fn refined(start: f64, step: f64, error: impl Fn(f64) -> f64) -> f64 {
    let (mut best, mut step) = (start, step);
    while step > 1e-3 {
        let near = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|i: f64| best * (i * step).exp());
        let errors = near.map(|factor| (factor, error(factor)));
        let least = errors.into_iter().min_by(|(_, a), (_, b)| a.total_cmp(b));
        best = least.map_or(best, |(factor, _)| factor);
        step *= 0.5;
    }
    // Through text: the nearest number, which prints with three digits.
    format!("{best:.2e}").parse().unwrap_or(best)
}

/// Finds the depth factor of the highest agreement, and then that of the smallest relative error near it,
/// with three digits. Of factors that agree alike, the one nearest to 1 is taken.
fn best_unit(trial: impl Fn(f64) -> PoseTrial) -> PoseTrial {
    let n = (MAX_UNIT.ln() / UNIT_STEP.ln()).ceil() as i32;
    // `max_by` returns the last of equals, so the nearest to 1 comes last.
    let near_last = (1..=n).rev().flat_map(|i| [-i, i]).chain([0]);
    let coarse = near_last.map(|i| trial(UNIT_STEP.powi(i))).max_by(PoseTrial::by_agreement);
    let coarse = coarse.map_or(1.0, |trial| trial.unit);
    trial(refined(coarse, UNIT_STEP.ln(), |unit| trial(unit).relative()))
}

/// Depth samples of one frame in its camera's axes, and the depth of a neighbouring frame with the same
/// surfaces.
struct FramePair {
    samples: Vec<DVec3>,
    from: NearPoses,
    to: NearPoses,
    intrinsics: Intrinsics,
    measured: Image<f64>,
}

/// Poses of the frame before, of a frame and of the frame after.
type NearPoses = [Option<Pose>; 3];

fn near_poses(frames: &[FrameEntry], index: usize) -> NearPoses {
    let pose = |index: Option<usize>| Some(frames.get(index?)?.camera.pose);
    [pose(index.checked_sub(1)), pose(Some(index)), pose(index.checked_add(1))]
}

fn pairs(split: &DatasetSplit) -> Vec<FramePair> {
    let n = split.frames.len();
    let anchors = n.min(MAX_PAIRS);
    // Evenly spaced over the recording: one unlucky stretch must not decide.
    (0..anchors).filter_map(|i| pair(&split.frames, i * n / anchors)).collect()
}

fn pair(frames: &[FrameEntry], index: usize) -> Option<FramePair> {
    let first = frames.get(index)?;
    let depth = trusted_z(first)?;
    let usual = usual_depth(&depth)?;
    let from = first.camera.pose;
    let has_moved = |(_, other): &(usize, &FrameEntry)| {
        let to = other.camera.pose;
        // Either suffices: a wrong pose may rotate where the camera moved straight.
        from.centre().distance(to.centre()) > MIN_MOTION[0] * usual
            || rotation_angle(&from, &to) > MIN_MOTION[1]
    };
    let candidates = || GAPS.iter().filter_map(|gap| Some((index + gap, frames.get(index + gap)?)));
    // If the camera hardly moves, the largest gap is compared.
    let (place, second) = candidates().find(has_moved).or_else(|| candidates().next_back())?;
    Some(FramePair {
        samples: samples(&depth, &first.camera.intrinsics),
        from: near_poses(frames, index),
        to: near_poses(frames, place),
        intrinsics: second.camera.intrinsics,
        measured: trusted_z(second)?,
    })
}

/// Returns points of a depth image on a grid, in camera axes.
fn samples(depth: &Image<f64>, k: &Intrinsics) -> Vec<DVec3> {
    let (columns, rows) = (stride(depth.width), stride(depth.height));
    let mut samples = Vec::new();
    for row in (rows / 2..depth.height).step_by(rows) {
        for column in (columns / 2..depth.width).step_by(columns) {
            let z = *depth.at(column, row);
            if z > 0.0 {
                samples.push(k.ray(column, row) * z);
            }
        }
    }
    samples
}

fn rotation_angle(from: &Pose, to: &Pose) -> f64 {
    let turn = to.rotation().transpose() * from.rotation();
    // Rounding may push the cosine beyond 1.
    (0.5 * (turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0)).clamp(-1.0, 1.0).acos()
}

fn stride(side: usize) -> usize {
    (side / SAMPLES).max(1)
}

fn usual_depth(depth: &Image<f64>) -> Option<f64> {
    median(depth.data.iter().copied().filter(|z| *z > 0.0).collect())
}

fn trusted_z(entry: &FrameEntry) -> Option<Image<f64>> {
    Some(entry.load_depth().ok().flatten()?.trusted_z(&entry.camera.intrinsics))
}

impl PoseTrial {
    fn by_agreement(&self, other: &Self) -> Ordering {
        self.agreement.total_cmp(&other.agreement)
    }

    /// Returns the error in units of recorded depth, comparable between depth units.
    fn relative(&self) -> f64 {
        self.error / self.unit
    }

    fn is_better_than(&self, other: &Self) -> bool {
        let gain = self.agreement - other.agreement;
        let [least, remaining, change] = MIN_UNIT_GAIN;
        let is_other = self.fault != other.fault || (self.unit / other.unit).ln().abs() > change;
        let is_closer = self.relative() < remaining * other.relative();
        gain > MIN_GAIN[0] || gain > least && self.poses == other.poses && is_other && is_closer
    }

    fn of(
        pairs: &[FramePair],
        stated: PoseConvention,
        poses: PoseConvention,
        unit: f64,
        fault: Option<Fault>,
    ) -> Self {
        let (mut n_agreed, mut n_in_front, mut n_counted) = (0.0, 0.0, 0.0);
        let mut errors = Vec::new();
        let camera = fault.map_or(DMat3::IDENTITY, Fault::camera);
        let from_true = camera.inverse();
        let near = match fault {
            Some(Fault::Shifted(places)) => 1 + isize::from(places),
            _ => 1,
        };
        for pair in pairs {
            let pose =
                |poses: &NearPoses| poses.get(usize::try_from(near).ok()?).copied().flatten();
            // The first and last frame lack a neighbour.
            let Some((from, to)) = pose(&pair.from).zip(pose(&pair.to)) else { continue };
            // Never fails: a rigid pose is rigid in every convention.
            let read = |pose: Pose| poses.pose(stated.matrix(&pose)).unwrap_or(pose);
            let (from, to) = (read(from), read(to));
            let (rotation, shift) = to.inverse();
            let k = &pair.intrinsics;
            let mut n_inside = 0usize;
            for sample in &pair.samples {
                // A unit scales depth, but not the positions of the cameras.
                let world = from.transform_point(camera * *sample * unit);
                let p = from_true * (rotation * world + shift);
                // NaN or infinite for a point in the camera's plane; the test below is false then.
                let at = [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy];
                let is_inside = p.z > 0.0
                    && (0.0..f64::from(k.width)).contains(&at[0])
                    && (0.0..f64::from(k.height)).contains(&at[1]);
                if !is_inside {
                    continue;
                }
                let measured = unit * pair.measured.at(at[0] as usize, at[1] as usize);
                if measured > 0.0 {
                    n_inside += 1;
                    let error = (p.z - measured).abs();
                    errors.push(error);
                    n_agreed += f64::from(u8::from(error <= TOLERANCE * measured));
                    n_in_front += f64::from(u8::from(p.z < (1.0 - TOLERANCE) * measured));
                }
            }
            n_counted += (n_inside as f64).max(MIN_OVERLAP * pair.samples.len() as f64);
        }
        let error = median(errors).unwrap_or(f64::INFINITY);
        let share = |n: f64| n / f64::max(n_counted, 1.0);
        let (agreement, in_front) = (share(n_agreed), share(n_in_front));
        Self { poses, unit, fault, agreement, in_front, error }
    }
}

/// Returns the number of places by which photographs follow the depth that they belong to. Points of depth
/// seen in both frames of a pair must have one colour. Frames of a pair between which the camera moves
/// alike hide the error, so pairs of the most different motions are compared.
fn color_shift(dataset: &Dataset, split: &DatasetSplit) -> i8 {
    let calibrated = dataset.known_calibration().and_then(|known| known.color_camera);
    let n = split.frames.len();
    let [most, least] = COLOR_PAIRS;
    // Every photograph has a frame before and after it.
    let anchors = most.min(n.saturating_sub(3));
    let of = |i| color_errors(&split.frames, i * (n - 3) / anchors, calibrated.as_ref());
    let errors: Vec<[f64; 3]> = map_photographs(&split.frames, 0..anchors, of);
    let is_better = |near: fn(&[f64; 3]) -> f64| {
        let sum = errors.iter().map(near).sum::<f64>();
        let here = errors.iter().map(|[_, here, _]| here).sum::<f64>();
        let n = errors.iter().filter(|errors| near(errors) < errors[1]).count();
        sum < MAX_COLOR_REMAINS * here && errors.len() >= least && 4 * n >= 3 * errors.len()
    };
    match [is_better(|[before, ..]| *before), is_better(|[.., after]| *after)] {
        [true, false] => -1,
        [false, true] => 1,
        // If both were better, photographs would not be shifted by a frame.
        _ => 0,
    }
}

/// Returns the mean luma difference of points common to a frame and a later one, with the photographs of the
/// frames before, of these and of those after. The first of the three frames is at `index`.
fn color_errors(
    frames: &[FrameEntry],
    index: usize,
    calibrated: Option<&ColorCamera>,
) -> Option<[f64; 3]> {
    let three = |index: usize| frames.get(index..)?.first_chunk::<3>();
    let motion = |[_, here, next]: &[FrameEntry; 3]| here.camera.pose.offset_to(&next.camera.pose);
    let first = three(index)?;
    let [_, from, _] = first;
    let depth = trusted_z(from)?;
    let usual = usual_depth(&depth)?;
    let (shift, turn) = motion(first);
    let difference = |other: &&[FrameEntry; 3]| {
        let (other_shift, other_turn) = motion(other);
        turn.angle_between(other_turn) + shift.distance(other_shift) / usual
    };
    let is_near = |[_, other, _]: &&[FrameEntry; 3]| {
        rotation_angle(&from.camera.pose, &other.camera.pose) < MAX_COLOR_ROTATION
    };
    let others = GAPS.iter().filter_map(|gap| three(index + gap)).filter(is_near);
    let second = others.max_by(|a, b| difference(a).total_cmp(&difference(b)))?;
    let [_, to, _] = second;
    let measured = trusted_z(to)?;
    let photographs = |three: &[FrameEntry; 3]| {
        let photograph = |frame: &FrameEntry| {
            let color = frame.has_photograph().then(|| frame.load_color().ok())??;
            Some(reduced_luma(&color, COLOR_COLUMNS))
        };
        let [before, here, after] = three.each_ref().map(photograph);
        Some([before?, here?, after?])
    };
    let (from_photographs, to_photographs) = (photographs(first)?, photographs(second)?);
    let cameras = [from, to].map(|frame| frame.photo_camera(calibrated));
    let (mut sums, mut n) = ([0.0; 3], 0.0);
    for sample in samples(&depth, &from.camera.intrinsics) {
        let world = from.camera.pose.transform_point(sample);
        let z = lookup(&to.camera, world, &measured).copied().unwrap_or_default();
        // Another surface, or a hole.
        if z <= 0.0 || (to.camera.project(world).1 - z).abs() > TOLERANCE * z {
            continue;
        }
        let error = |(from, to): (&Image<f32>, &Image<f32>)| {
            let [one, other] = [lookup(&cameras[0], world, from)?, lookup(&cameras[1], world, to)?];
            Some(f64::from((one - other).abs()))
        };
        let errors = from_photographs.iter().zip(&to_photographs).filter_map(error);
        let errors: Vec<f64> = errors.collect();
        if errors.len() == sums.len() {
            n += 1.0;
            let clamped = errors.iter().map(|error| error.min(MAX_COLOR_ERROR));
            sums.iter_mut().zip(clamped).for_each(|(sum, error)| *sum += error);
        }
    }
    (n > 0.0).then(|| sums.map(|sum| sum / n))
}

/// Returns the pixel of a picture, possibly a reduced one, at the projection of a point.
fn lookup<'a, T>(camera: &Camera, world: DVec3, picture: &'a Image<T>) -> Option<&'a T> {
    let (at, z) = camera.project(world);
    let Intrinsics { width, height, .. } = camera.intrinsics;
    let x = at.x / f64::from(width) * picture.width as f64;
    let y = at.y / f64::from(height) * picture.height as f64;
    let is_inside = z > 0.0
        && (0.0..picture.width as f64).contains(&x)
        && (0.0..picture.height as f64).contains(&y);
    is_inside.then(|| picture.at(x as usize, y as usize))
}

/// Convention of a recording's pose matrices.
///
/// ```
/// use vbgs_studio::dataset::PoseConvention;
/// use vbgs_studio::math::pose::Pose;
///
/// let opengl = PoseConvention::Opengl.matrix(&Pose::IDENTITY);
/// assert_eq!(PoseConvention::Opengl.pose(opengl), Ok(Pose::IDENTITY));
/// assert_ne!(PoseConvention::Opencv.pose(opengl), Ok(Pose::IDENTITY));
/// ```
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    EnumIter,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PoseConvention {
    /// Camera to world, x right, y down, z forward.
    Opencv,
    /// Camera to world, x right, y up, viewing along −z.
    Opengl,
    /// World to camera, x right, y down, z forward.
    OpencvWorldToCamera,
    /// World to camera, x right, y up, viewing along −z.
    OpenglWorldToCamera,
    /// Camera to world, x forward, y left, z up, as for the body of a robot.
    Robot,
}

impl PoseConvention {
    /// Returns the name in options and messages, such as `opencv-world-to-camera`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Converts a matrix of this convention to a pose.
    ///
    /// # Errors
    /// The matrix is not a rigid motion.
    pub fn pose(self, matrix: DMat4) -> Result<Pose, PoseError> {
        let axes = self.axes();
        match self.is_world_to_camera() {
            false => Pose::from_opencv(matrix * axes),
            // Checked before the inversion, so that the error reports the numbers of the file.
            true => Pose::from_opencv(inverse(&Pose::from_opencv(matrix)?) * axes),
        }
    }

    /// Converts a pose to a matrix of this convention.
    pub fn matrix(self, pose: &Pose) -> DMat4 {
        // The axes are orthogonal, so their transpose is their inverse.
        let world_from_camera = pose.to_opencv() * self.axes().transpose();
        match self.is_world_to_camera() {
            false => world_from_camera,
            true => world_from_camera.inverse(),
        }
    }

    fn is_world_to_camera(self) -> bool {
        matches!(self, Self::OpencvWorldToCamera | Self::OpenglWorldToCamera)
    }

    /// Returns the transform from OpenCV camera axes to the axes of this convention.
    fn axes(self) -> DMat4 {
        match self {
            Self::Opencv | Self::OpencvWorldToCamera => DMat4::IDENTITY,
            Self::Opengl | Self::OpenglWorldToCamera => {
                DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0))
            }
            Self::Robot => DMat4::from_cols(-DVec4::Y, -DVec4::Z, DVec4::X, DVec4::W),
        }
    }
}

fn inverse(pose: &Pose) -> DMat4 {
    let (rotation, translation) = pose.inverse();
    let mut m = DMat4::from_mat3(rotation);
    m.w_axis = translation.extend(1.0);
    m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_better_reading_is_named_with_its_option() {
        let opened = PoseTrial {
            poses: PoseConvention::Opencv,
            unit: 1.0,
            fault: None,
            agreement: 0.12,
            in_front: 0.5,
            error: 0.5,
        };
        let best = PoseTrial { poses: PoseConvention::Opengl, agreement: 0.96, ..opened };
        let check =
            PoseCheck { pairs: 8, opened, is_user_set: false, best, color_shift: 0, focal: 525.0 };
        let expected = "the poses match opengl, but the layout has opencv: 96 % of depth agrees with \
                        neighbouring frames, 12 % as opened; choose the pose axes (`--pose-axes opengl`)";
        assert_eq!(check.warnings(), [expected]);
        let text = PoseCheck { is_user_set: true, ..check.clone() }.warnings().concat();
        assert!(text.contains("but pose axes are set to opencv"), "{text}");
        let scaled = PoseTrial { unit: 5.0, agreement: 0.9, ..opened };
        let text = PoseCheck { best: scaled, ..check.clone() }.warnings().concat();
        assert!(text.contains("depth seems to be 5 times") && text.contains("`--depth-scale`"));
        let fault = Some(Fault::FocalLength(0.95));
        let text = PoseCheck { best: PoseTrial { fault, ..best }, ..check.clone() }.warnings();
        assert!(text.concat().contains("0.95 times the stated one, 499 px"), "{text:?}");
        let good = PoseTrial { agreement: 0.9, ..opened };
        let check = PoseCheck { opened: good, best: good, ..check };
        assert!(check.warnings().is_empty());
        let low = PoseTrial { agreement: 0.5, ..opened };
        let text = PoseCheck { opened: low, best: low, color_shift: 1, ..check }.warnings();
        assert!(text[0].starts_with("only 50 % of depth agrees"), "{text:?}");
        assert!(text[1].contains("the depth one frame earlier"), "{text:?}");
    }

    #[test]
    fn every_convention_reads_back_what_it_writes() {
        let pose = Pose::look_at(DVec3::new(3.0, 0.5, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        for convention in PoseConvention::iter() {
            let back = convention.pose(convention.matrix(&pose)).unwrap();
            let error = back.to_opencv() - pose.to_opencv();
            let largest = error.to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
            assert!(largest < 1e-12, "{}: {largest}", convention.name());
        }
        assert_eq!(PoseConvention::OpencvWorldToCamera.name(), "opencv-world-to-camera");
    }
}
