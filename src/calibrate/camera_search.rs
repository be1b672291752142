//! The search for the colour camera, from coarse images to fine ones.
//!
//! What is minimised is the variance of colour inside components that several views see. The
//! search begins with images at an eighth of their size, where slopes hold far enough for a camera
//! far from the truth to see which way it is, and refines. Gains are estimated in between, because
//! exposure that differs between views looks like a wrong camera.
//!
//! A minimum always exists, so finding one proves nothing: another camera must lower the variance
//! by [`MIN_FALL`] and shift colours by [`MIN_SHIFT`], and each of its values is then given back
//! to the start unless keeping the start's costs [`MIN_RISE`]. These thresholds were chosen on
//! Lego and on the Kinect of 7-Scenes; that they hold there is no independent evidence.

use super::exposure::exposure;
use super::input::CalibrationInput;
use super::matches::Matches;
use super::normal_equations::NormalEquations;
use super::photometric::PhotometricCost;
use super::pinhole::{CameraUnknowns, FOCAL, N, ROLL, registered};
use super::pyramid::Pyramid;
use super::value::{CalibratedValue, MIN_RISE};
use crate::dataset::calibration::ColorCamera;
use crate::dataset::error::FrameError;
use crate::math::cholesky::Cholesky;

/// Sizes of the images; at the smallest a pixel is eight.
pub(super) const LEVELS: usize = 4;
/// Fits at every size, with gains estimated in between.
const ROUNDS: usize = 2;
/// Steps of a fit.
const MAX_STEPS: usize = 12;
/// Fall of the variance, relative, at which a fit ends.
const MIN_STEP: f64 = 1e-6;
/// Fall of the variance, relative, that another camera must bring. On the 7-Scenes Kinect, whose
/// camera is known, wrong poses and depths bring 3 %, and views held out are worse for it; on Lego,
/// whose colours are registered, 1.4 %.
const MIN_FALL: f64 = 0.05;
/// Mean shift, pixels, that another camera must bring; on Lego they bring 0.4.
const MIN_SHIFT: f64 = 1.0;
/// Shift, pixels, up to which a value counts as confirmed rather than changed.
const SAME: f64 = 1.0;

/// What is known of the colour camera.
pub(super) struct FoundCamera {
    /// `None` where the colours are registered.
    pub camera: Option<ColorCamera>,
    pub values: Vec<CalibratedValue>,
    /// What there is to say of the camera as a whole.
    pub note: Option<String>,
}

/// The camera under which components are of one colour, with the calibration's depth.
pub(super) fn search(
    input: &CalibrationInput,
    images: &[Pyramid],
    mut tick: impl FnMut(),
) -> Result<FoundCamera, FrameError> {
    let known = input.calibration.color_camera;
    let start = known.unwrap_or_else(|| registered(&input.frames[0].camera.intrinsics));
    let start = CameraUnknowns::of(start);
    let mut best = start;
    let mut gains = vec![[1.0; 3]; images.len()];
    for level in (1..LEVELS).rev() {
        refine(input, images, level, &mut best, &mut gains)?;
        tick();
    }
    let matches = refine(input, images, 0, &mut best, &mut gains)?;
    let cost = PhotometricCost { matches: &matches, images, gains: &gains, level: 0 };
    let found = judge(&cost, &start, best, known.is_some());
    tick();
    Ok(found)
}

/// Fits camera and gains at a size of the images; what was matched for it.
fn refine(
    input: &CalibrationInput,
    images: &[Pyramid],
    level: usize,
    best: &mut CameraUnknowns,
    gains: &mut Vec<[f64; 3]>,
) -> Result<Matches, FrameError> {
    let all: Vec<usize> = (0..N).collect();
    let settings = input.settings(Some(best.camera()));
    // Components as large against a pixel of the smaller image as they are at full size.
    let h = input.h * f64::from(1u32 << level);
    let matches = Matches::new(&input.frames, &settings, h, input.step)?;
    // In turn, not jointly: gains are linear in logarithms, the camera is not.
    for _ in 0..ROUNDS {
        let cost = PhotometricCost { matches: &matches, images, gains, level };
        fit(&cost, best, &all);
        *gains = exposure(&cost.patches(best), images.len()).gains;
    }
    Ok(matches)
}

/// Whether the best camera is worth taking, and which of its values.
fn judge(
    cost: &PhotometricCost,
    start: &CameraUnknowns,
    mut best: CameraUnknowns,
    is_known: bool,
) -> FoundCamera {
    let variance = |x| NormalEquations::total(&cost.by_view(x)).variance();
    let fall = 1.0 - variance(&best) / variance(start);
    // In pixels, because values that make up for one another may differ much and show little.
    let shift = cost.distance(start, &best);
    if fall >= MIN_FALL && shift >= MIN_SHIFT {
        let values = settle(cost, start, &mut best);
        return FoundCamera { camera: Some(best.camera()), values, note: None };
    }
    // Poses and depths that are slightly wrong can always be traded for a slightly other camera.
    let small = format!(
        "the best other camera shifts colours by {shift:.1} pixels and lowers their variance by {:.1} %, which errors of poses and depth do too",
        100.0 * fall.max(0.0)
    );
    if !is_known {
        let note = format!("the colour images are registered to depth: {small}");
        return FoundCamera { camera: None, values: Vec::new(), note: Some(note) };
    }
    let all: Vec<usize> = (0..N).collect();
    let errors = errors(&cost.by_view(&best), &all);
    let shifts = cost.shifts(&best);
    let value = |i: usize| {
        let apart = (best.values[i] - start.values[i]).abs() * shifts[i];
        let reason = format!("the best shifts by {apart:.1} pixels, which the others undo");
        staying(named(start, &best, i, errors[i]), apart, reason)
    };
    let values = all.iter().map(|&i| value(i)).collect();
    FoundCamera {
        camera: Some(start.camera()),
        values,
        note: Some(format!("the colour camera stays: {small}")),
    }
}

/// Gives back the start's value to what the data does not determine, and fits the others again.
fn settle(
    cost: &PhotometricCost,
    start: &CameraUnknowns,
    best: &mut CameraUnknowns,
) -> Vec<CalibratedValue> {
    let shifts = cost.shifts(best);
    let mut free: Vec<usize> = (0..N).collect();
    let mut values: Vec<Option<CalibratedValue>> = vec![None; N];
    loop {
        let views = cost.by_view(best);
        for (&i, error) in free.iter().zip(errors(&views, &free)) {
            values[i] = Some(named(start, best, i, error));
        }
        let total = NormalEquations::total(&views);
        let without = free.iter().map(|&i| {
            let kept = without(cost, start, best, &free, i);
            let rise =
                NormalEquations::total(&cost.by_view(&kept)).variance() / total.variance() - 1.0;
            (i, kept, rise)
        });
        let least = without.min_by(|a, b| a.2.total_cmp(&b.2));
        // One at a time, the least missed first: the others take over what it explained.
        let Some((weak, kept, rise)) = least.filter(|(_, _, rise)| *rise < MIN_RISE) else {
            break;
        };
        let reason = format!("with it the variance is {:.1} % higher", 100.0 * rise);
        let apart = (best.values[weak] - start.values[weak]).abs() * shifts[weak];
        values[weak] = values[weak].take().map(|value| staying(value, apart, reason));
        *best = kept;
        free.retain(|&i| i != weak);
    }
    values.into_iter().flatten().collect()
}

/// The best where a value is the start's. The other `free` ones follow as the curvature says, then
/// are fitted: from where they were they would not find back.
fn without(
    cost: &PhotometricCost,
    start: &CameraUnknowns,
    best: &CameraUnknowns,
    free: &[usize],
    kept: usize,
) -> CameraUnknowns {
    let rest: Vec<usize> = free.iter().copied().filter(|&i| i != kept).collect();
    let total = NormalEquations::total(&cost.by_view(best));
    let change = start.values[kept] - best.values[kept];
    let pull: Vec<f64> = rest.iter().map(|&i| -change * total.curvature_at(i, kept)).collect();
    let mut next = *best;
    next.values[kept] = start.values[kept];
    if let Some(factor) = Cholesky::new(rest.len(), &total.curvature_of(&rest)) {
        rest.iter().zip(factor.solve(&pull)).for_each(|(&i, step)| next.values[i] += step);
    }
    fit(cost, &mut next, &rest);
    next
}

/// A value that keeps what it was: determined if the best lies within [`SAME`] of it.
fn staying(mut value: CalibratedValue, apart: f64, reason: String) -> CalibratedValue {
    match apart <= SAME {
        true => {
            value.keep("the best is the same to a pixel".to_owned());
            value.determined = true;
        }
        false => value.keep(reason),
    }
    value
}

/// An unknown as people know it.
fn named(
    start: &CameraUnknowns,
    best: &CameraUnknowns,
    unknown: usize,
    error: f64,
) -> CalibratedValue {
    const NAMES: [&str; N] = [
        "colour camera offset x, world units",
        "colour camera offset y, world units",
        "colour camera roll, radians",
        "colour focal length, pixels",
        "colour principal point x, pixels",
        "colour principal point y, pixels",
    ];
    let natural = |x: &CameraUnknowns| match unknown {
        FOCAL => x.camera().focal[0],
        ROLL => x.camera().rotation[2],
        _ => x.values[unknown],
    };
    // The error is of the logarithm; times the focal length it is in pixels.
    let per_unit = if unknown == FOCAL { natural(best) } else { 1.0 };
    CalibratedValue::determined(NAMES[unknown], natural(start), natural(best), error * per_unit)
}

/// Levenberg and Marquardt's steps over the `free` unknowns.
fn fit(cost: &PhotometricCost, best: &mut CameraUnknowns, free: &[usize]) {
    let mut at = NormalEquations::total(&cost.by_view(best));
    let mut damping = 1e-3;
    for _ in 0..MAX_STEPS {
        let Some(step) = at.step(free, damping) else { break };
        let mut next = *best;
        free.iter().zip(step).for_each(|(&i, step)| next.values[i] += step);
        let then = NormalEquations::total(&cost.by_view(&next));
        // Of the variance, not of the cost: points leave the image as the camera moves.
        let fall = 1.0 - then.variance() / at.variance();
        if fall > 0.0 {
            (*best, at) = (next, then);
            damping *= 0.2;
        } else {
            damping *= 10.0;
        }
        // A step that raises the variance is not the end: the next is shorter.
        if (0.0..MIN_STEP).contains(&fall) {
            break;
        }
    }
}

/// Standard errors of the `free` unknowns: what the views' own gradients would move them by.
fn errors(views: &[NormalEquations<N>], free: &[usize]) -> Vec<f64> {
    let curvature = NormalEquations::total(views).curvature_of(free);
    let Some(factor) = Cholesky::new(free.len(), &curvature) else {
        return vec![f64::INFINITY; free.len()];
    };
    // Curvature alone would count pixels as independent; views differ by more than their noise.
    let mut variance = vec![0.0; free.len()];
    for view in views {
        let gradient: Vec<f64> = free.iter().map(|&i| view.gradient[i]).collect();
        variance.iter_mut().zip(factor.solve(&gradient)).for_each(|(v, step)| *v += step * step);
    }
    variance.into_iter().map(f64::sqrt).collect()
}
