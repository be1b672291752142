//! Creates learners of the `paper` preset in the configured precision.

use super::config::{PaperConfig, Precision};
use super::init::InitialDraw;
use super::learner::{NormalizedTrainer, PaperLearner};
use super::scalar::PaperScalar;
use super::trainer::PaperTrainer;
use crate::math::normalization::Normalization;
use crate::model::paper::state::ModelState;
use crate::observation::points::Points;
use crate::train::candidates::IndexError;

/// Creates an untrained mixture in the precision of `config`. Points are normalised by
/// `normalization`.
///
/// # Errors
/// [`IndexError`] if the initial means cannot be indexed.
///
/// ```
/// use vbgs_studio::math::normalization::Normalization;
/// use vbgs_studio::observation::points::Points;
/// use vbgs_studio::train::paper::{config::{PaperOverrides, PaperConfig}, engine, init::InitialDraw};
///
/// let config = PaperConfig::paper().with(&PaperOverrides { components: Some(50), ..Default::default() })?;
/// let mut mixture = engine::begin(&config, &InitialDraw::random(50, 0), Normalization::IDENTITY)?;
/// let outcome = mixture.learn(&Points::from_rows(&[[0.1; 6], [0.2; 6]]))?;
/// assert_eq!(outcome.points, 2);
/// assert!(mixture.used() >= 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn begin(
    config: &PaperConfig,
    draw: &InitialDraw,
    normalization: Normalization,
) -> Result<Box<dyn PaperLearner>, IndexError> {
    Ok(match config.precision {
        Precision::F64 => in_world(PaperTrainer::<f64>::new(config, draw)?, normalization),
        // Mixed and f32 runs use the same points and means; only their totals differ.
        _ => in_world(PaperTrainer::<f32>::new(config, draw)?, normalization),
    })
}

/// Restores a mixture of the same configuration after `frames` frames.
///
/// # Errors
/// [`IndexError`] if the initial means cannot be indexed.
pub fn restore(
    config: &PaperConfig,
    state: ModelState,
    frames: u64,
    normalization: Normalization,
) -> Result<Box<dyn PaperLearner>, IndexError> {
    Ok(match config.precision {
        Precision::F64 => {
            in_world(PaperTrainer::<f64>::restore(config, state, frames)?, normalization)
        }
        _ => in_world(PaperTrainer::<f32>::restore(config, state, frames)?, normalization),
    })
}

fn in_world<R: PaperScalar>(
    trainer: PaperTrainer<R>,
    normalization: Normalization,
) -> Box<dyn PaperLearner> {
    Box::new(NormalizedTrainer { trainer, normalization, widened: Points::new() })
}
