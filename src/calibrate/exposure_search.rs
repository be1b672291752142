//! Search for the exposure of every frame.

use super::exposure::{FittedExposure, Patch, exposure};
use super::matches::prepare_subsampled;
use super::value::CalibratedValue;
use crate::dataset::Dataset;
use crate::dataset::calibration::FrameGain;
use crate::dataset::surface::{Preparer, SurfaceSettings};
use crate::observation::surface::SurfacePoint;
use crate::pipeline::plan::Plan;
use crate::train::scene::partition::Partition;
use rayon::prelude::*;

/// Structural scale relative to the scene's: exposure needs many shared points, not detail.
const GROWTH: f64 = 2.0;
const BATCH: usize = 8;
/// Maximum number of frames; time grows with its cube.
pub(super) const MAX_FRAMES: usize = 1000;
/// Maximum relative standard error of gains that are written.
const MAX_ERROR: f64 = 0.02;
/// Minimum relative reduction of the colour differences between views.
const MIN_FALL: f64 = 0.1;

/// Estimates the gains of a plan's frames (at most [`MAX_FRAMES`]) under the calibration in `settings`.
/// Returns no gains if they are not significant.
pub(super) fn search(
    dataset: &Dataset,
    plan: &Plan,
    settings: &SurfaceSettings,
    (h, step): (f64, usize),
    mut tick: impl FnMut(),
) -> (Vec<FrameGain>, CalibratedValue) {
    let found = plan.frames.len();
    let mut settings = settings.clone();
    // The search needs uncorrected colours; known gains are only compared with.
    let before = settings.calibration.iter_mut().flat_map(|c| std::mem::take(&mut c.exposure));
    let before: Vec<[f64; 3]> = before.map(|e| e.gain).collect();
    let mut partition = Partition::new(GROWTH * h);
    let mut patches: Vec<Patch> = Vec::new();
    // Decoded in parallel but assigned in order: births depend on the order.
    for (batch, indices) in plan.frames.chunks(BATCH).enumerate() {
        let prepare = |preparer: &mut Preparer, &index: &usize| {
            // An unreadable frame gets no gain and does not stop the search.
            let frame = dataset.load(plan.split, index).ok()?;
            prepare_subsampled(preparer, &frame, &settings, step).ok()
        };
        let frames: Vec<Option<Vec<SurfacePoint>>> =
            indices.par_iter().map_init(Preparer::new, prepare).collect();
        for (i, points) in frames.iter().enumerate() {
            let view = (batch * BATCH + i) as u32;
            patches.extend(points.iter().flat_map(|p| patches_of(&mut partition, p, view)));
            tick();
        }
    }
    // Frames arrive in order; the equations need a component's views side by side.
    patches.sort_by_key(Patch::key);
    let exposure = exposure(&patches, found);
    let names = plan.frames.iter().map(|&i| dataset.splits[plan.split].frames[i].name.clone());
    select_gains(&exposure, names.collect(), &before)
}

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

/// Decides which gains are written; returns them with a summary value.
fn select_gains(
    exposure: &FittedExposure,
    names: Vec<String>,
    before: &[[f64; 3]],
) -> (Vec<FrameGain>, CalibratedValue) {
    let sure = |i: &usize| exposure.errors[*i] <= MAX_ERROR;
    let sure: Vec<usize> = (0..names.len()).filter(sure).collect();
    let gains: Vec<[f64; 3]> = sure.iter().map(|&i| exposure.gains[i]).collect();
    let error = sure.iter().map(|&i| exposure.errors[i]).sum::<f64>() / sure.len().max(1) as f64;
    let name = "spread of exposures, relative";
    // One number for all frames: a table of thousands of gains is not readable.
    let mut value = CalibratedValue::determined(name, spread(before), spread(&gains), error);
    if sure.len() < 2 {
        value.revert("the frames share too few surfaces".to_owned());
    } else if exposure.relative_reduction < MIN_FALL {
        let fall = 100.0 * exposure.relative_reduction;
        value.revert(format!("gains lower colour differences between frames by only {fall:.1} %"));
    }
    let gains = if value.determined { gains } else { Vec::new() };
    let named =
        sure.iter().zip(gains).map(|(&i, gain)| FrameGain { frame: names[i].clone(), gain });
    (named.collect(), value)
}

/// Root mean square of the log gains.
fn spread(gains: &[[f64; 3]]) -> f64 {
    let squares: f64 = gains.as_flattened().iter().map(|g| g.ln().powi(2)).sum();
    (squares / (3 * gains.len()).max(1) as f64).sqrt()
}
