//! Typed interface of presets: ties settings, frame preparation and learner together by type, so that no
//! learner receives the other preset's observations. Only `pipeline/start.rs` distinguishes the presets of a
//! run; code that does not need the types uses [`AnyPreset`].

use super::any_preset::{AnyPreset, RestoredLearner};
use super::error::SessionError;
use super::mismatch::Mismatch;
use super::prepare::Prepare;
use super::run::RunConfig;
use crate::dataset::Dataset;
use crate::dataset::range::PositionRange;
use crate::math::normalization::Normalization;
use crate::model::stored::StoredModel;
use crate::train::learner::Learns;

/// Observation type of a preset's learner.
pub type ObservationOf<P> = <<P as TypedPreset>::Preparation as Prepare>::Observation;

/// Settings of a preset, with its types.
pub trait TypedPreset: AnyPreset {
    /// Preparation of frames for the learner.
    type Preparation: Prepare;

    /// Returns the preparation for a run whose model uses the coordinates of `normalization`.
    fn preparation(&self, run: &RunConfig, normalization: Normalization) -> Self::Preparation;

    /// Creates an untrained learner for a dataset whose positions lie in `range` and whose frames have at
    /// most `pixels` pixels.
    ///
    /// # Errors
    /// [`SessionError`] if memory does not suffice or the data give no initialisation.
    fn begin(
        &self,
        dataset: &Dataset,
        run: &RunConfig,
        range: &PositionRange,
        pixels: usize,
    ) -> Result<InitialLearner<ObservationOf<Self>>, SessionError>;

    /// Restores a learner after `frames` frames from a stored model.
    ///
    /// # Errors
    /// [`Mismatch`] if the stored model does not match these settings.
    fn restore(
        &self,
        model: &StoredModel,
        frames: u64,
    ) -> Result<InitialLearner<ObservationOf<Self>>, Mismatch>;
}

/// Learner at the start of a session.
pub struct InitialLearner<O> {
    /// The learner.
    pub learner: Box<dyn Learns<O>>,
    /// World to model coordinates.
    pub normalization: Normalization,
}

/// Calls [`TypedPreset::restore`] and erases the observation type.
///
/// # Errors
/// As [`TypedPreset::restore`].
pub(super) fn revive<P: TypedPreset>(
    preset: &P,
    model: &StoredModel,
    frames: u64,
) -> Result<RestoredLearner, Mismatch>
where
    ObservationOf<P>: 'static,
{
    let InitialLearner { learner, normalization } = preset.restore(model, frames)?;
    Ok(RestoredLearner { learner, normalization })
}
