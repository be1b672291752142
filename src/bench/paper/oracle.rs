//! Error of an engine's posterior relative to that of the oracle, the dense f64 engine. Both start from
//! equal means and train on equal points.
//!
//! Reassignment is off in both. It samples points by their ELBO, so a single rounding error could move
//! another component and hide the arithmetic errors. Quantiles weight each component by its evidence,
//! because the covariance of a component with one point is almost all prior. Errors of means are
//! relative to the larger of the mean's length and the component's standard deviation.

use super::sample::push_tile;
use crate::bench::findings::BenchError;
use crate::math::measured_pixel::Normalization;
use crate::math::sym3::Sym3;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use serde::Serialize;
use std::collections::BTreeMap;

/// Non-zero responsibilities of all components for one point, by component.
pub(super) type Shares = BTreeMap<u32, f64>;

/// Reference results of the dense f64 engine on some frames.
pub struct DenseOracle<'a> {
    draw: InitialDraw,
    frames: &'a [Points<f32>],
    seen: Seen,
}

struct Seen {
    /// ELBO of each point of the last frame, nats.
    elbo: Vec<f64>,
    /// Non-zero responsibilities of each point of the last frame.
    responsibilities: Vec<Shares>,
    posteriors: Vec<ComponentPosterior>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Errors {
    pub elbo_max: f64,
    pub elbo_mean: f64,
    pub variation_mean: f64,
    pub variation_max: f64,
    pub posterior: PosteriorErrors,
}

/// Relative errors of posteriors. Quantiles weight each component by its evidence `N_k`, the number of
/// points assigned to it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct PosteriorErrors {
    /// 99 % quantile over components of `|m − m*| / max(|m*|, sd)`, with the mean `m`, the oracle's mean
    /// `m*` and the component's standard deviation `sd`.
    pub mean_p99: f64,
    pub mean_max: f64,
    /// 99 % quantile over components of `‖Σ − Σ*‖ / ‖Σ*‖` in the Frobenius norm, with the covariance
    /// `Σ` and the oracle's covariance `Σ*`.
    pub covariance_p99: f64,
    pub covariance_max: f64,
}

impl PosteriorErrors {
    /// Returns the larger of the 99 % error quantiles of means and covariances, the value that error
    /// bounds limit.
    pub fn p99(&self) -> f64 {
        self.mean_p99.max(self.covariance_p99)
    }
}

impl<'a> DenseOracle<'a> {
    /// Trains the oracle on `frames`, starting from `draw`. The initial means are rounded to f32 first,
    /// because every engine reads f32.
    pub fn new(
        config: &PaperConfig,
        draw: &InitialDraw,
        frames: &'a [Points<f32>],
    ) -> Result<Self, BenchError> {
        // Otherwise the rounding of the input would count as an arithmetic error.
        let rounded = |row: &[f64; 6]| row.map(|v| f64::from(v as f32));
        let means = draw.means.iter().map(rounded).collect();
        let draw = InitialDraw { means, alpha: draw.alpha.clone() };
        let dense = PaperOverrides {
            candidates: Some(Candidates::Dense),
            precision: Some(Precision::F64),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        let seen = Seen::by(&config.clone().with(&dense)?, &draw, frames)?;
        Ok(Self { draw, frames, seen })
    }

    pub fn errors_of(&self, config: &PaperConfig) -> Result<Errors, BenchError> {
        // As in the oracle: one component moved differently would exceed all rounding.
        let fixed =
            PaperOverrides { reassign: Some(ReassignPolicy::Off), ..PaperOverrides::default() };
        let found = Seen::by(&config.clone().with(&fixed)?, &self.draw, self.frames)?;
        let truth = &self.seen;
        let elbo: Vec<f64> =
            truth.elbo.iter().zip(&found.elbo).map(|(a, b)| (a - b).abs()).collect();
        let pairs = truth.responsibilities.iter().zip(&found.responsibilities);
        let variation: Vec<f64> = pairs.map(|(a, b)| total_variation(a, b)).collect();
        Ok(Errors {
            elbo_max: largest(&elbo),
            elbo_mean: mean(&elbo),
            variation_mean: mean(&variation),
            variation_max: largest(&variation),
            posterior: posterior_errors(&found.posteriors, &truth.posteriors),
        })
    }
}

impl Seen {
    fn by(
        config: &PaperConfig,
        draw: &InitialDraw,
        frames: &[Points<f32>],
    ) -> Result<Self, BenchError> {
        // Points and means are already in model coordinates, and no result is in world coordinates.
        let mut engine = learner::begin(config, draw, Normalization::IDENTITY)?;
        for frame in frames {
            engine.learn(frame)?;
        }
        let elbo = engine.point_elbo();
        let posteriors = engine.posteriors();
        let mut responsibilities = Vec::new();
        // Tile by tile to limit memory: a dense engine returns every component for every point.
        for tile in frames.last().map_or_else(Vec::new, tiles) {
            let shares = engine.responsibilities(&tile).into_iter();
            responsibilities
                // Nearly all responsibilities underflow to zero. A dense row would need N entries
                // per point.
                .extend(shares.map(|r| r.into_iter().filter(|(_, r)| *r != 0.0).collect()));
        }
        Ok(Self { elbo, responsibilities, posteriors })
    }
}

fn tiles(points: &Points<f32>) -> Vec<Points<f32>> {
    let tile = |t| {
        let mut tile = Points::new();
        push_tile(&mut tile, points, points.tile(t));
        tile
    };
    (0..points.n_tiles()).map(tile).collect()
}

/// Returns the total variation distance of two distributions: half the sum of absolute differences.
pub(super) fn total_variation(a: &Shares, b: &Shares) -> f64 {
    let here = a.iter().map(|(id, r)| (r - b.get(id).unwrap_or(&0.0)).abs());
    let only_there = b.iter().filter(|(id, _)| !a.contains_key(id)).map(|(_, r)| r.abs());
    0.5 * (here.sum::<f64>() + only_there.sum::<f64>())
}

/// Computes the relative errors of posteriors over the components with evidence in `truth`. NaN counts
/// as infinite.
pub fn posterior_errors(
    found: &[ComponentPosterior],
    truth: &[ComponentPosterior],
) -> PosteriorErrors {
    // Without points both posteriors equal the prior, so their error says nothing.
    let used = || found.iter().zip(truth).filter(|(_, t)| t.count > 0.0);
    let means = used().map(|(f, t)| (mean_error(f, t), t.count)).collect();
    let covariances = used().map(|(f, t)| (covariance_error(f, t), t.count)).collect();
    let ([mean_p99, mean_max], [covariance_p99, covariance_max]) =
        (weighted_p99_and_max(means), weighted_p99_and_max(covariances));
    PosteriorErrors { mean_p99, mean_max, covariance_p99, covariance_max }
}

fn mean_error(found: &ComponentPosterior, truth: &ComponentPosterior) -> f64 {
    // A mean near the origin has no meaningful length.
    let size = truth.mean_space.length().max(truth.expected_covariance().trace().sqrt());
    number_or_infinity((found.mean_space - truth.mean_space).length() / size)
}

fn covariance_error(found: &ComponentPosterior, truth: &ComponentPosterior) -> f64 {
    let truth = truth.expected_covariance();
    let difference = found.expected_covariance().add_scaled(-1.0, truth);
    number_or_infinity(frobenius(difference) / frobenius(truth))
}

fn frobenius(m: Sym3) -> f64 {
    let diagonal = m.xx * m.xx + m.yy * m.yy + m.zz * m.zz;
    // Each off-diagonal element occurs twice in a symmetric matrix.
    (diagonal + 2.0 * (m.xy * m.xy + m.xz * m.xz + m.yz * m.yz)).sqrt()
}

fn number_or_infinity(value: f64) -> f64 {
    // `f64::max` ignores NaN, which would hide a broken engine.
    if value.is_nan() { f64::INFINITY } else { value }
}

/// Returns the weighted 99 % quantile and the maximum of (error, weight) pairs.
fn weighted_p99_and_max(mut errors: Vec<(f64, f64)>) -> [f64; 2] {
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    let total: f64 = errors.iter().map(|(_, weight)| weight).sum();
    let mut below = 0.0;
    let p99 = errors.iter().find(|(_, weight)| {
        below += weight;
        below >= 0.99 * total
    });
    [p99.map_or(0.0, |e| e.0), errors.last().map_or(0.0, |e| e.0)]
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().map(number_or_infinity).fold(0.0, f64::max)
}

fn mean(values: &[f64]) -> f64 {
    // Zero rather than NaN for a last frame without points.
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn variation_lies_between_zero_and_one() {
        let a = Shares::from([(1, 0.25), (2, 0.75)]);
        assert_eq!(total_variation(&a, &a), 0.0);
        assert_eq!(total_variation(&a, &Shares::from([(3, 1.0)])), 1.0);
        assert_eq!(total_variation(&a, &Shares::from([(1, 0.75), (2, 0.25)])), 0.5);
    }

    #[test]
    fn quantile_counts_evidence() {
        let errors = vec![(1e-9, 985.0), (0.5, 6.0), (2.0, 9.0)];
        assert_eq!(weighted_p99_and_max(errors), [0.5, 2.0]);
        assert_eq!(weighted_p99_and_max(Vec::new()), [0.0, 0.0]);
    }
}
