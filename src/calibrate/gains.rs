//! Gains of the views: factors that equalise the colours of components across views.
//!
//! Ratios of gains are differences of logarithms, so the gains solve a linear least-squares problem
//! over all views that share components. A zero mean of the logarithms fixes the undetermined common
//! factor. Patches (mean colours of a component in a view) are weighted by the inverse variance of the
//! logarithm; very dark or clipped patches are left out.
//!
//! A gain with an additional offset was tried for training on the Kinect and was worse than a gain alone
//! (`lab/scene.md`).

use crate::math::cholesky::Cholesky;

/// Minimum mean colour of a channel in a patch; noise dominates darker patches.
const DARKEST: f64 = 0.04;
/// Maximum mean colour of a channel in a patch; brighter patches are partly clipped.
const BRIGHTEST: f64 = 0.92;
/// Strength of the ridge penalty that pulls gains towards 1, relative to the mean information of a view.
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

    /// Returns the patch's view, weight and logarithm of a channel's mean; `None` if the patch is too
    /// dark or clipped. The weight is the inverse variance of the logarithm.
    fn log(&self, channel: usize) -> Option<(usize, f64, f64)> {
        // Logarithm of the mean, since noise in dark points would bias a mean of logarithms downwards.
        let mean = self.sum[channel] / self.points;
        let is_usable = (DARKEST..BRIGHTEST).contains(&mean);
        is_usable.then(|| (self.view as usize, self.points * mean * mean, mean.ln()))
    }
}

/// Fits the gain of each view and channel to all pairs of views that share components. The product of the
/// gains over the views is 1. `patches` are sorted by component.
pub(super) fn fit_gains(patches: &[Patch], views: usize) -> Vec<[f64; 3]> {
    let mut gains = vec![[1.0; 3]; views];
    for channel in 0..3 {
        let logs = log_gains(patches, channel, views);
        // A common factor of all views is the brightness of the scene.
        let mean = logs.iter().sum::<f64>() / views as f64;
        gains.iter_mut().zip(logs).for_each(|(gain, log)| gain[channel] = (log - mean).exp());
    }
    gains
}

fn log_gains(patches: &[Patch], channel: usize, views: usize) -> Vec<f64> {
    let (mut matrix, mut right) = (vec![0.0; views * views], vec![0.0; views]);
    for run in patches.chunk_by(|a, b| a.component == b.component) {
        let logs: Vec<_> = run.iter().filter_map(|patch| patch.log(channel)).collect();
        // A single view gives no ratio.
        if logs.len() < 2 {
            continue;
        }
        let total: f64 = logs.iter().map(|log| log.1).sum();
        let mean = logs.iter().map(|log| log.1 * log.2).sum::<f64>() / total;
        for &(view, weight, log) in &logs {
            right[view] -= weight * (log - mean);
            matrix[view * views + view] += weight;
            for &(other, others_weight, _) in &logs {
                matrix[view * views + other] -= weight * others_weight / total;
            }
        }
    }
    let scale = (0..views).map(|i| matrix[i * views + i]).sum::<f64>() / views as f64;
    // Fixes the undetermined common factor by a zero mean. A view without matches stays at 0.
    for i in 0..views {
        matrix[i * views + i] += RIDGE * scale + f64::MIN_POSITIVE;
        for j in 0..views {
            matrix[i * views + j] += scale / (views * views) as f64;
        }
    }
    match Cholesky::new(views, &matrix) {
        Some(factor) => factor.solve(&right),
        None => vec![0.0; views],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(component: u32, view: u32, color: [f64; 3]) -> Patch {
        let mut patch = Patch::new(component, view);
        (0..=view).for_each(|_| patch.add(color));
        patch
    }

    /// Views 0 to 2 share components in a chain; view 3 shares none.
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
        let gains = fit_gains(&patches, 4);
        for channel in 0..2 {
            let product: f64 = gains.iter().map(|g| g[channel]).product();
            assert!((product - 1.0).abs() < 1e-9);
            for view in 0..3 {
                let seen = gains[view][channel] * exposures[view];
                let first = gains[0][channel] * exposures[0];
                assert!((seen / first - 1.0).abs() < 1e-4, "{gains:?}");
            }
        }
        assert!(gains.iter().all(|g| (g[2] - 1.0).abs() < 1e-9), "{gains:?}");
    }

    #[test]
    fn dark_and_clipped_patches_say_nothing() {
        let patches = [patch(0, 0, [0.01, 0.99, 0.5]), patch(0, 1, [0.03, 0.5, 0.25])];
        let gains = fit_gains(&patches, 2);
        assert_eq!([gains[0][0], gains[0][1]], [1.0, 1.0]);
        assert!((gains[1][2] / gains[0][2] - 2.0).abs() < 1e-5);
    }
}
