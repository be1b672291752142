//! The search for the colour camera, from coarse images to fine ones.

use super::exposure::exposure;
use super::matches::Matches;
use super::photometric::{Normal, Scene};
use super::pinhole::{FOCAL, N, ROLL, Unknowns, registered};
use super::pyramid::Pyramid;
use super::value::Value;
use super::{Ground, LEAST_RISE};
use crate::dataset::calibration::ColorCamera;
use crate::dataset::error::FrameError;
use crate::math::cholesky::Cholesky;

/// Sizes of the images; at the smallest a pixel is eight.
pub(super) const LEVELS: usize = 4;
/// Fits at every size, with gains estimated in between.
const ROUNDS: usize = 2;
/// Steps of a fit.
const MOST_STEPS: usize = 12;
/// Fall of the variance, relative, at which a fit ends.
const LEAST_STEP: f64 = 1e-6;
/// Fall of the variance, relative, that another camera must bring. On the 7-Scenes Kinect, whose
/// camera is known, wrong poses and depths bring 3 %, and views held out are worse for it; on Lego,
/// whose colours are registered, 1.4 %.
const LEAST_FALL: f64 = 0.05;
/// Mean shift, pixels, that another camera must bring; on Lego they bring 0.4.
const LEAST_SHIFT: f64 = 1.0;
/// Shift, pixels, within which a value is the same.
const SAME: f64 = 1.0;

/// What is known of the colour camera.
pub(super) struct Found {
    /// `None` where the colours are registered.
    pub camera: Option<ColorCamera>,
    pub values: Vec<Value>,
    /// What there is to say of the camera as a whole.
    pub note: Option<String>,
}

/// The camera under which components are of one colour, with the calibration's depth.
pub(super) fn search(
    ground: &Ground,
    images: &[Pyramid],
    mut tick: impl FnMut(),
) -> Result<Found, FrameError> {
    let known = ground.calibration.color_camera;
    let start = known.unwrap_or_else(|| registered(&ground.frames[0].camera.intrinsics));
    let start = Unknowns::of(start);
    let mut best = start;
    let mut gains = vec![[1.0; 3]; images.len()];
    for level in (1..LEVELS).rev() {
        refine(ground, images, level, &mut best, &mut gains)?;
        tick();
    }
    let matches = refine(ground, images, 0, &mut best, &mut gains)?;
    let scene = Scene { matches: &matches, images, gains: &gains, level: 0 };
    let found = judge(&scene, &start, best, known.is_some());
    tick();
    Ok(found)
}

/// Fits camera and gains at a size of the images; what was matched for it.
fn refine(
    ground: &Ground,
    images: &[Pyramid],
    level: usize,
    best: &mut Unknowns,
    gains: &mut Vec<[f64; 3]>,
) -> Result<Matches, FrameError> {
    let all: Vec<usize> = (0..N).collect();
    let settings = ground.settings(Some(best.camera()));
    let h = ground.h * f64::from(1u32 << level);
    let matches = Matches::new(&ground.frames, &settings, h, ground.step)?;
    for _ in 0..ROUNDS {
        let scene = Scene { matches: &matches, images, gains, level };
        fit(&scene, best, &all);
        *gains = exposure(&scene.patches(best), images.len()).gains;
    }
    Ok(matches)
}

/// Whether the best camera is worth taking, and which of its values.
fn judge(scene: &Scene, start: &Unknowns, mut best: Unknowns, is_known: bool) -> Found {
    let variance = |x| Normal::total(&scene.normals(x)).variance();
    let fall = 1.0 - variance(&best) / variance(start);
    let shift = scene.distance(start, &best);
    if fall >= LEAST_FALL && shift >= LEAST_SHIFT {
        let values = settle(scene, start, &mut best);
        return Found { camera: Some(best.camera()), values, note: None };
    }
    let small = format!(
        "the best other camera shifts colours by {shift:.1} pixels and lowers their variance by {:.1} %, which errors of poses and depth do too",
        100.0 * fall.max(0.0)
    );
    if !is_known {
        let note = format!("the colour images are registered to depth: {small}");
        return Found { camera: None, values: Vec::new(), note: Some(note) };
    }
    let all: Vec<usize> = (0..N).collect();
    let errors = errors(&scene.normals(&best), &all);
    let shifts = scene.shifts(&best);
    let value = |i: usize| {
        let apart = (best.values[i] - start.values[i]).abs() * shifts[i];
        let reason = format!("the best shifts by {apart:.1} pixels, which the others undo");
        staying(named(start, &best, i, errors[i]), apart, reason)
    };
    let values = all.iter().map(|&i| value(i)).collect();
    Found {
        camera: Some(start.camera()),
        values,
        note: Some(format!("the colour camera stays: {small}")),
    }
}

/// Gives back the start's value to what the data does not determine, and fits the others again.
fn settle(scene: &Scene, start: &Unknowns, best: &mut Unknowns) -> Vec<Value> {
    let shifts = scene.shifts(best);
    let mut free: Vec<usize> = (0..N).collect();
    let mut values: Vec<Option<Value>> = vec![None; N];
    loop {
        let views = scene.normals(best);
        for (&i, error) in free.iter().zip(errors(&views, &free)) {
            values[i] = Some(named(start, best, i, error));
        }
        let total = Normal::total(&views);
        let without = free.iter().map(|&i| {
            let kept = without(scene, start, best, &free, i);
            let rise = Normal::total(&scene.normals(&kept)).variance() / total.variance() - 1.0;
            (i, kept, rise)
        });
        let least = without.min_by(|a, b| a.2.total_cmp(&b.2));
        let Some((weak, kept, rise)) = least.filter(|(_, _, rise)| *rise < LEAST_RISE) else {
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
    scene: &Scene,
    start: &Unknowns,
    best: &Unknowns,
    free: &[usize],
    kept: usize,
) -> Unknowns {
    let rest: Vec<usize> = free.iter().copied().filter(|&i| i != kept).collect();
    let total = Normal::total(&scene.normals(best));
    let change = start.values[kept] - best.values[kept];
    let pull: Vec<f64> = rest.iter().map(|&i| -change * total.curvature_at(i, kept)).collect();
    let mut next = *best;
    next.values[kept] = start.values[kept];
    if let Some(factor) = Cholesky::new(rest.len(), &total.curvature_of(&rest)) {
        rest.iter().zip(factor.solve(&pull)).for_each(|(&i, step)| next.values[i] += step);
    }
    fit(scene, &mut next, &rest);
    next
}

/// A value that keeps what it was: determined if the best is the same within [`SAME`].
fn staying(mut value: Value, apart: f64, reason: String) -> Value {
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
fn named(start: &Unknowns, best: &Unknowns, unknown: usize, error: f64) -> Value {
    const NAMES: [&str; N] = [
        "colour camera offset x, world units",
        "colour camera offset y, world units",
        "colour camera roll, radians",
        "colour focal length, pixels",
        "colour principal point x, pixels",
        "colour principal point y, pixels",
    ];
    let natural = |x: &Unknowns| match unknown {
        FOCAL => x.camera().focal[0],
        ROLL => x.camera().rotation[2],
        _ => x.values[unknown],
    };
    let per_unit = if unknown == FOCAL { natural(best) } else { 1.0 };
    Value::determined(NAMES[unknown], natural(start), natural(best), error * per_unit)
}

/// Levenberg and Marquardt's steps over the `free` unknowns.
fn fit(scene: &Scene, best: &mut Unknowns, free: &[usize]) {
    let n = free.len();
    let mut at = Normal::total(&scene.normals(best));
    let mut damping = 1e-3;
    for _ in 0..MOST_STEPS {
        let mut matrix = at.curvature_of(free);
        (0..n).for_each(|i| matrix[i * n + i] *= 1.0 + damping);
        let Some(factor) = Cholesky::new(n, &matrix) else { break };
        let down: Vec<f64> = free.iter().map(|&i| -at.gradient[i]).collect();
        let mut next = *best;
        free.iter().zip(factor.solve(&down)).for_each(|(&i, step)| next.values[i] += step);
        let then = Normal::total(&scene.normals(&next));
        let fall = 1.0 - then.variance() / at.variance();
        if fall > 0.0 {
            (*best, at) = (next, then);
            damping *= 0.2;
        } else {
            damping *= 10.0;
        }
        if (0.0..LEAST_STEP).contains(&fall) {
            break;
        }
    }
}

/// Standard errors of the `free` unknowns: what the views' own gradients would move them by.
fn errors(views: &[Normal], free: &[usize]) -> Vec<f64> {
    let curvature = Normal::total(views).curvature_of(free);
    let Some(factor) = Cholesky::new(free.len(), &curvature) else {
        return vec![f64::INFINITY; free.len()];
    };
    let mut variance = vec![0.0; free.len()];
    for view in views {
        let gradient: Vec<f64> = free.iter().map(|&i| view.gradient[i]).collect();
        variance.iter_mut().zip(factor.solve(&gradient)).for_each(|(v, step)| *v += step * step);
    }
    variance.into_iter().map(f64::sqrt).collect()
}
