//! Combinations of widths: all there are, how one fared, and which is chosen.

use crate::bench::paper::oracle::{PosteriorErrors, posterior_errors};
use crate::bench::paper::runs::Runs;
use crate::eval::spread::Spread;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::train::paper::config::{Operations, PaperConfig, Precision, UpdateWidth, Width};
use crate::train::paper::learner::PaperLearner;
use serde::Serialize;

/// One combination of widths.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PrecisionCombination {
    /// Name of the precision; `custom` for all but the named ones.
    pub precision: Precision,
    /// Width of every operation of the hot loop.
    pub operations: Operations,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First and third quartile over the runs.
    pub ms_quartiles: [f64; 2],
    /// Distance of the posteriors to those of the f64 oracle.
    pub error: PosteriorErrors,
    /// Whether the distance is within the bound.
    pub within_bound: bool,
}

impl PrecisionCombination {
    /// Times of the runs of a configuration, and its posteriors held against the oracle's.
    pub fn new(
        config: &PaperConfig,
        runs: &Runs,
        truth: &[ComponentPosterior],
        bound: f64,
    ) -> Self {
        let ms = runs.spread(|ms| ms.train);
        let error = posterior_errors(&posteriors(&*runs.engine), truth);
        Self {
            precision: config.precision,
            operations: config.operations,
            ms: ms.median,
            ms_quartiles: ms.quartiles,
            error,
            within_bound: error.p99() <= bound,
        }
    }

    /// Whether three quarters of the runs are faster than three quarters of another's.
    pub fn is_faster_than(&self, other: &Self) -> bool {
        self.ms_quartiles[1] < other.ms_quartiles[0]
    }

    /// Median and quartiles, milliseconds per frame.
    pub fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: self.ms_quartiles }
    }
}

const WIDTHS: [Width; 2] = [Width::F64, Width::F32];
const UPDATES: [UpdateWidth; 3] = [UpdateWidth::Fixed128, UpdateWidth::Fixed64, UpdateWidth::F32];

/// Every combination of widths, the widest first.
pub fn combinations() -> Vec<Operations> {
    let mut all = Vec::new();
    for distance in WIDTHS {
        for log_score in WIDTHS {
            for normaliser in WIDTHS {
                for moments in WIDTHS {
                    let with =
                        |update| Operations { distance, log_score, normaliser, moments, update };
                    all.extend(UPDATES.map(with));
                }
            }
        }
    }
    all
}

/// Posteriors of all components, used or not.
pub fn posteriors(engine: &dyn PaperLearner) -> Vec<ComponentPosterior> {
    (0..engine.components()).map(|k| engine.posterior(k)).collect()
}

/// The combination of least error among those within the bound that cannot be told from the fastest
/// one, the spreads of their runs overlapping; the widest of equals. `None` if none keeps the
/// bound.
pub fn choose(combinations: &[PrecisionCombination]) -> Option<PrecisionCombination> {
    let within = || combinations.iter().filter(|c| c.within_bound);
    let fastest = within().min_by(|a, b| a.ms.total_cmp(&b.ms))?;
    let alike = within().filter(|c| !fastest.is_faster_than(c));
    // Of equals `min_by` keeps the first, and the widest come first.
    alike.min_by(|a, b| a.error.p99().total_cmp(&b.error.p99())).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timed(update: UpdateWidth, ms: f64, error: f64) -> PrecisionCombination {
        PrecisionCombination {
            precision: Precision::Custom,
            operations: Operations { update, ..Operations::F64 },
            ms,
            ms_quartiles: [ms - 1.0, ms + 1.0],
            error: PosteriorErrors { covariance_p99: error, ..PosteriorErrors::default() },
            within_bound: error <= 1e-4,
        }
    }

    #[test]
    fn what_is_no_faster_is_not_bought_with_error() {
        use UpdateWidth::{F32, Fixed64, Fixed128};
        let chosen = |all: &[PrecisionCombination]| choose(all).map(|c| c.operations.update);
        let slow = timed(Fixed128, 20.0, 0.0);
        assert_eq!(chosen(&[slow, timed(Fixed64, 10.0, 1e-6)]), Some(Fixed64));
        let alike = [timed(Fixed64, 10.5, 1e-6), timed(F32, 10.0, 1e-5)];
        assert_eq!(chosen(&alike), Some(Fixed64), "half a millisecond is within the spread");
        let equal = [timed(Fixed128, 10.5, 1e-6), timed(F32, 10.0, 1e-6)];
        assert_eq!(chosen(&equal), Some(Fixed128), "the widest of equals");
        assert_eq!(chosen(&[slow, timed(F32, 10.0, 1e-3)]), Some(Fixed128), "the bound holds");
        assert_eq!(chosen(&[timed(F32, 10.0, 1e-3)]), None);
    }
}
