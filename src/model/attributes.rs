//! Attributes of a component besides its splat: evidence, uncertainty, ELBO, birth.

use super::conjugate::posterior::ComponentPosterior;
use super::conjugate::prior::Hyper;
use super::paper::state::ModelState;
use super::scene::photometric::PhotometricDeviations;
use super::scene::state::SceneState;
use crate::math::measured_pixel::Normalization;

/// Attributes of a component besides its splat.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ComponentAttributes {
    /// Number of points that the component received, `N_k`; `None` for splats that this program did not
    /// train.
    pub evidence: Option<f32>,
    /// Standard deviation of the splat's position, world units. If photographs have changed the splat,
    /// it is estimated from photographs. Otherwise it is that of the mean of the points
    /// ([`ComponentPosterior::mean_deviation`]).
    pub uncertainty: Option<f32>,
    /// Mean ELBO, nats, of those points of the last frame for which this component has the largest
    /// responsibility. `None` if there are no such points or the ELBO was not requested.
    pub elbo: Option<f32>,
    /// Index, within the run, of the frame in which the component first received points; `None` if
    /// unknown or if the component has not received any points.
    pub birth: Option<u32>,
}

impl ComponentAttributes {
    /// Derives the attributes from a posterior. All of them are `None` for a component without points.
    pub fn new(
        posterior: &ComponentPosterior,
        normalization: &Normalization,
        elbo: Option<f64>,
        birth: Option<u32>,
    ) -> Self {
        if posterior.count <= 0.0 {
            return Self::default();
        }
        Self {
            evidence: Some(posterior.count as f32),
            uncertainty: Some(posterior.mean_deviation(normalization) as f32),
            elbo: elbo.map(|e| e as f32),
            birth,
        }
    }

    /// Replaces the uncertainty with the standard deviation of the position from `found`. Keeps it if
    /// `found` is `None`, that is, if no photograph has changed the splat.
    pub fn with_photometric_uncertainty(self, found: Option<PhotometricDeviations>) -> Self {
        let uncertainty = found.map(|found| found.position_deviation() as f32).or(self.uncertainty);
        Self { uncertainty, ..self }
    }
}

/// Trained model of one of the two presets, as stored in a checkpoint.
#[derive(Clone, Debug, PartialEq)]
#[expect(clippy::large_enum_variant, reason = "a checkpoint has one model")]
pub enum StoredModel {
    /// Model of the `paper` preset.
    Mixture {
        /// Transform from world to model coordinates.
        normalization: Normalization,
        /// Hyper-parameters of the prior and of the initial model.
        hyper: Hyper,
        /// Weights, means and statistics.
        state: ModelState,
    },
    /// Model of the `scene` preset.
    Scene(SceneState),
}
