//! The search for every frame's exposure.

use super::exposure::{FittedExposure, Patch, exposure};
use super::matches::thinned;
use super::value::CalibratedValue;
use crate::dataset::Dataset;
use crate::dataset::calibration::FrameGain;
use crate::dataset::surface::{Preparer, SurfaceSettings};
use crate::observation::surface::SurfacePoint;
use crate::pipeline::plan::Plan;
use crate::train::scene::partition::Partition;
use rayon::prelude::*;

/// Structural scale times the scene's: exposure needs many points in common, not detail.
const GROWTH: f64 = 2.0;
/// Frames decoded at once.
const BATCH: usize = 8;
/// Most frames; time grows with the cube of their number.
pub(super) const MAX_FRAMES: usize = 1000;
/// Largest relative standard error of gains that are written.
const MAX_ERROR: f64 = 0.02;
/// Fall, relative, of what separates the views' colours that gains must bring.
const MIN_FALL: f64 = 0.1;

/// The gains of a plan's frames, at most [`MAX_FRAMES`], with the calibration in `settings`; nothing where they do not pay.
pub(super) fn search(
    dataset: &Dataset,
    plan: &Plan,
    settings: &SurfaceSettings,
    (h, step): (f64, usize),
    mut tick: impl FnMut(),
) -> (Vec<FrameGain>, CalibratedValue) {
    let found = plan.frames.len();
    let mut settings = settings.clone();
    // Searched for in colours as they were taken: known gains are only compared with.
    let before = settings.calibration.iter_mut().flat_map(|c| std::mem::take(&mut c.exposure));
    let before: Vec<[f64; 3]> = before.map(|e| e.gain).collect();
    let mut partition = Partition::new(GROWTH * h);
    let mut patches: Vec<Patch> = Vec::new();
    // Frames are decoded side by side, but assigned in order: births depend on it.
    for (batch, indices) in plan.frames.chunks(BATCH).enumerate() {
        let prepare = |preparer: &mut Preparer, &index: &usize| {
            // A frame that cannot be read gets no gain and stops nothing.
            let frame = dataset.load(plan.split, index).ok()?;
            thinned(preparer, &frame, &settings, step).ok()
        };
        let frames: Vec<Option<Vec<SurfacePoint>>> =
            indices.par_iter().map_init(Preparer::new, prepare).collect();
        for (i, points) in frames.iter().enumerate() {
            let view = (batch * BATCH + i) as u32;
            patches.extend(points.iter().flat_map(|p| patches_of(&mut partition, p, view)));
            tick();
        }
    }
    // Frames came in order; equations need the views of a component side by side.
    patches.sort_by_key(Patch::key);
    let exposure = exposure(&patches, found);
    let names = plan.frames.iter().map(|&i| dataset.splits[plan.split].frames[i].name.clone());
    judge(&exposure, names.collect(), &before)
}

/// The mean colours of a view's components.
fn patches_of(partition: &mut Partition, points: &[SurfacePoint], view: u32) -> Vec<Patch> {
    let owners = partition.assign(points);
    let mut owned: Vec<(u32, [f32; 3])> =
        owners.iter().zip(points).filter_map(|(owner, p)| Some(((*owner)?, p.color))).collect();
    owned.sort_by_key(|(owner, _)| *owner);
    let patch = |run: &[(u32, [f32; 3])]| {
        let mut patch = Patch::new(run[0].0, view);
        run.iter().for_each(|(_, color)| patch.add(color.map(f64::from)));
        patch
    };
    owned.chunk_by(|a, b| a.0 == b.0).map(patch).collect()
}

/// What is written, and what is said of it.
fn judge(
    exposure: &FittedExposure,
    names: Vec<String>,
    before: &[[f64; 3]],
) -> (Vec<FrameGain>, CalibratedValue) {
    let sure = |i: &usize| exposure.errors[*i] <= MAX_ERROR;
    let sure: Vec<usize> = (0..names.len()).filter(sure).collect();
    let gains: Vec<[f64; 3]> = sure.iter().map(|&i| exposure.gains[i]).collect();
    let error = sure.iter().map(|&i| exposure.errors[i]).sum::<f64>() / sure.len().max(1) as f64;
    let name = "spread of exposures, relative";
    // One number for all frames: a table of thousands of gains tells people nothing.
    let mut value = CalibratedValue::determined(name, spread(before), spread(&gains), error);
    if sure.len() < 2 {
        value.keep("the frames share too few surfaces".to_owned());
    } else if exposure.fall < MIN_FALL {
        let fall = 100.0 * exposure.fall;
        value.keep(format!("gains lower what separates the frames' colours by {fall:.1} % only"));
    }
    let gains = if value.determined { gains } else { Vec::new() };
    let named =
        sure.iter().zip(gains).map(|(&i, gain)| FrameGain { frame: names[i].clone(), gain });
    (named.collect(), value)
}

/// Standard deviation of the logarithms of gains about 0.
fn spread(gains: &[[f64; 3]]) -> f64 {
    let squares: f64 = gains.as_flattened().iter().map(|g| g.ln().powi(2)).sum();
    (squares / (3 * gains.len()).max(1) as f64).sqrt()
}
