//! The seam between presets on the side of a run: what ties a preset's settings, the preparation of
//! frames and the learner together by type, so that no learner is ever handed the other preset's
//! material. `pipeline/start.rs` is the one place that asks which preset a run follows; whoever
//! needs less than the types asks [`AnyPreset`].

use super::any_preset::{AnyPreset, Revived};
use super::error::SessionError;
use super::mismatch::Mismatch;
use super::prepare::Prepare;
use super::run::RunConfig;
use crate::dataset::Dataset;
use crate::dataset::range::PositionRange;
use crate::math::normalization::Normalization;
use crate::model::stored::StoredModel;
use crate::train::learner::Learns;

/// What a preset's learner learns from.
pub type ObservationOf<P> = <<P as TypedPreset>::Preparation as Prepare>::Observation;

/// The settings of a preset, and what they imply of types.
pub trait TypedPreset: AnyPreset {
    /// How frames become what the learner learns from.
    type Preparation: Prepare;

    /// Settings of the preparation for a run whose model works in the coordinates of
    /// `normalization`.
    fn preparation(&self, run: &RunConfig, normalization: Normalization) -> Self::Preparation;

    /// A learner that has seen nothing, for a dataset whose positions lie in `range`.
    ///
    /// # Errors
    /// [`SessionError`] if the machine has no room for it or the data gives no start.
    fn begin(
        &self,
        dataset: &Dataset,
        run: &RunConfig,
        range: &PositionRange,
        pixels: usize,
    ) -> Result<Beginning<ObservationOf<Self>>, SessionError>;

    /// A learner that goes on where one with these settings stopped after `frames` frames.
    ///
    /// # Errors
    /// [`Mismatch`] if the stored model is not one of these settings.
    fn restore(
        &self,
        model: &StoredModel,
        frames: u64,
    ) -> Result<Beginning<ObservationOf<Self>>, Mismatch>;
}

/// A learner at the begin of a session.
pub struct Beginning<O> {
    /// The learner.
    pub learner: Box<dyn Learns<O>>,
    /// World to model coordinates.
    pub normalization: Normalization,
}

/// [`TypedPreset::restore`] for whoever does not ask what the learner learns from.
///
/// # Errors
/// As [`TypedPreset::restore`].
pub(super) fn revive<P: TypedPreset>(
    preset: &P,
    model: &StoredModel,
    frames: u64,
) -> Result<Revived, Mismatch>
where
    ObservationOf<P>: 'static,
{
    let Beginning { learner, normalization } = preset.restore(model, frames)?;
    Ok(Revived { learner, normalization })
}
