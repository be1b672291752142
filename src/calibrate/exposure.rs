//! Exposure of each view: gains that equalise the colours of components across views.
//!
//! Exposure ratios are differences of logarithms, so the gains solve a linear least-squares problem over
//! all views that share components. The undetermined common factor is fixed by a zero mean of the
//! logarithms. Patches are weighted by their noise after the logarithm; very dark or clipped ones are left
//! out.
//!
//! Gain with an additional offset was tried for training on the Kinect and was worse than gain alone
//! (`pipeline.md`, Exposure search).

use super::matches::prepare_subsampled;
use super::unknowns::CalibratedValue;
use crate::dataset::Dataset;
use crate::dataset::calibration::FrameGain;
use crate::dataset::surface::{Preparer, SurfaceSettings};
use crate::math::cholesky::Cholesky;
use crate::observation::surface::SurfacePoint;
use crate::pipeline::plan::Plan;
use crate::train::scene::merge::Partition;
use rayon::prelude::*;

/// Minimum mean of a channel: darker patches are dominated by noise.
const DARKEST: f64 = 0.04;
/// Maximum mean of a channel: brighter patches are partly clipped.
const BRIGHTEST: f64 = 0.92;
/// Ridge that pulls gains towards 1, relative to the mean information of a view.
const RIDGE: f64 = 1e-6;

#[derive(Clone, Copy, Debug)]
pub(super) struct Patch {
    component: u32,
    view: u32,
    points: f64,
    sum: [f64; 3],
}

impl Patch {
    pub fn new(component: u32, view: u32) -> Self {
        Self { component, view, points: 0.0, sum: [0.0; 3] }
    }

    pub fn add(&mut self, color: [f64; 3]) {
        self.points += 1.0;
        self.sum.iter_mut().zip(color).for_each(|(sum, c)| *sum += c);
    }

    /// View, weight and logarithm of a channel's mean; `None` if too dark or clipped. The weight is the
    /// inverse variance of the logarithm.
    fn log(&self, channel: usize) -> Option<(usize, f64, f64)> {
        // Logarithm of the mean, since noise in dark points would bias a mean of logarithms downwards.
        let mean = self.sum[channel] / self.points;
        let is_usable = (DARKEST..BRIGHTEST).contains(&mean);
        is_usable.then(|| (self.view as usize, self.points * mean * mean, mean.ln()))
    }
}

#[derive(Clone, Debug)]
pub(super) struct FittedExposure {
    /// Per view and channel; the product over the views is 1.
    pub gains: Vec<[f64; 3]>,
    /// Relative standard error of a view's gains, maximum over the channels; infinite if the view shares no
    /// component.
    pub errors: Vec<f64>,
    pub relative_reduction: f64,
}

/// Fits gains by least squares of log colours over all pairs of views that share components. `patches` are
/// sorted by component.
pub(super) fn exposure(patches: &[Patch], views: usize) -> FittedExposure {
    let mut found = FittedExposure {
        gains: vec![[1.0; 3]; views],
        errors: vec![0.0; views],
        relative_reduction: 0.0,
    };
    let (mut before, mut explained) = (0.0, 0.0);
    for channel in 0..3 {
        let equations = GainEquations::of(patches, channel, views);
        let (logs, errors) = equations.solve();
        before += equations.square;
        explained += equations.explained(&logs);
        // A common factor of all views is scene brightness, not exposure.
        let mean = logs.iter().sum::<f64>() / views as f64;
        for view in 0..views {
            found.gains[view][channel] = (logs[view] - mean).exp();
            found.errors[view] = errors[view].max(found.errors[view]);
        }
    }
    found.relative_reduction = if before > 0.0 { explained / before } else { 0.0 };
    found
}

struct GainEquations {
    views: usize,
    matrix: Vec<f64>,
    right: Vec<f64>,
    /// `Σ w (ln c − mean)²`.
    square: f64,
    /// Degrees of freedom: patches beyond one per component.
    freedom: f64,
}

impl GainEquations {
    fn of(patches: &[Patch], channel: usize, views: usize) -> Self {
        let mut equations = Self {
            views,
            matrix: vec![0.0; views * views],
            right: vec![0.0; views],
            square: 0.0,
            freedom: 0.0,
        };
        for run in patches.chunk_by(|a, b| a.component == b.component) {
            let logs: Vec<_> = run.iter().filter_map(|patch| patch.log(channel)).collect();
            if logs.len() > 1 {
                equations.add(&logs);
            }
        }
        equations
    }

    fn add(&mut self, logs: &[(usize, f64, f64)]) {
        let total: f64 = logs.iter().map(|log| log.1).sum();
        let mean = logs.iter().map(|log| log.1 * log.2).sum::<f64>() / total;
        self.freedom += logs.len() as f64 - 1.0;
        for &(view, weight, log) in logs {
            self.square += weight * (log - mean).powi(2);
            self.right[view] -= weight * (log - mean);
            self.matrix[view * self.views + view] += weight;
            for &(other, others_weight, _) in logs {
                self.matrix[view * self.views + other] -= weight * others_weight / total;
            }
        }
    }

    /// Returns the log gains with zero mean, and their conditional standard errors.
    fn solve(&self) -> (Vec<f64>, Vec<f64>) {
        let n = self.views;
        let own: Vec<f64> = (0..n).map(|i| self.matrix[i * n + i]).collect();
        let scale = own.iter().sum::<f64>() / n as f64;
        let mut matrix = self.matrix.clone();
        // Fixes the undetermined common factor by a zero mean. A view without matches stays at 0.
        for i in 0..n {
            matrix[i * n + i] += RIDGE * scale + f64::MIN_POSITIVE;
            for j in 0..n {
                matrix[i * n + j] += scale / (n * n) as f64;
            }
        }
        let logs = match Cholesky::new(n, &matrix) {
            Some(factor) => factor.solve(&self.right),
            None => vec![0.0; n],
        };
        // The residual after the fit is the noise behind the standard errors.
        let rest = (self.square - self.explained(&logs)).max(0.0);
        let noise = rest / (self.freedom - n as f64).max(1.0);
        let error = |own: &f64| if *own > 0.0 { (noise / own).sqrt() } else { f64::INFINITY };
        (logs, own.iter().map(error).collect())
    }

    fn explained(&self, logs: &[f64]) -> f64 {
        logs.iter().zip(&self.right).map(|(x, r)| x * r).sum()
    }
}

/// Structural scale relative to the scene's: exposure needs many shared points, not detail.
const GROWTH: f64 = 2.0;
const BATCH: usize = 8;
/// Maximum number of frames; time grows with its cube.
pub(super) const MAX_FRAMES: usize = 1000;
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
    patches.sort_by_key(|patch| (patch.component, patch.view));
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

fn spread(gains: &[[f64; 3]]) -> f64 {
    let squares: f64 = gains.as_flattened().iter().map(|g| g.ln().powi(2)).sum();
    (squares / (3 * gains.len()).max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(component: u32, view: u32, color: [f64; 3]) -> Patch {
        let mut patch = Patch::new(component, view);
        (0..=view).for_each(|_| patch.add(color));
        patch
    }

    /// Views 0 to 2 share components in a chain, view 3 shares none.
    #[test]
    fn known_exposures_are_undone() {
        let exposures: [f64; 4] = [0.8, 1.0, 1.25, 1.1];
        let mut patches = Vec::new();
        for component in 0..20 {
            let shade = 0.2 + 0.02 * f64::from(component);
            let views = [component % 2, component % 2 + 1];
            let seen = views.map(|view| {
                let bright = shade * exposures[view as usize];
                patch(component, view, [bright, 0.5 * bright, 0.3])
            });
            patches.extend(seen);
        }
        patches.push(patch(20, 3, [0.5; 3]));
        let found = exposure(&patches, 4);
        for channel in 0..2 {
            let product: f64 = found.gains.iter().map(|g| g[channel]).product();
            assert!((product - 1.0).abs() < 1e-9);
            for view in 0..3 {
                let seen = found.gains[view][channel] * exposures[view];
                let first = found.gains[0][channel] * exposures[0];
                assert!((seen / first - 1.0).abs() < 1e-4, "{found:?}");
            }
        }
        assert!(found.gains.iter().all(|g| (g[2] - 1.0).abs() < 1e-9), "{found:?}");
        assert!(found.errors[..3].iter().all(|e| *e < 1e-3) && found.errors[3].is_infinite());
    }

    #[test]
    fn dark_and_clipped_patches_say_nothing() {
        let patches = [patch(0, 0, [0.01, 0.99, 0.5]), patch(0, 1, [0.03, 0.5, 0.25])];
        let gains = exposure(&patches, 2).gains;
        assert_eq!([gains[0][0], gains[0][1]], [1.0, 1.0]);
        assert!((gains[1][2] / gains[0][2] - 2.0).abs() < 1e-5);
    }
}
