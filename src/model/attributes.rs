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
    /// Number of points received, `N_k`; `None` for splats that were not trained here.
    pub evidence: Option<f32>,
    /// Standard deviation of the drawn position, world units: that of the points' mean
    /// ([`ComponentPosterior::mean_deviation`]), or of the splat's position as estimated from photographs.
    pub uncertainty: Option<f32>,
    /// Mean ELBO, nats, of the points of the last frame for which this component has the largest
    /// responsibility; `None` if there are none or the sum was not requested.
    pub elbo: Option<f32>,
    /// Index, within the run, of the frame in which the component first received points; `None` if unknown or
    /// not yet born.
    pub birth: Option<u32>,
}

impl ComponentAttributes {
    /// Derives the attributes from a posterior; a component without points has none.
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

    /// Replaces the uncertainty by the photometric one, if photographs have changed the splat.
    pub fn with_photometric_uncertainty(self, found: Option<PhotometricDeviations>) -> Self {
        let uncertainty = found.map(|found| found.position_deviation() as f32).or(self.uncertainty);
        Self { uncertainty, ..self }
    }
}

/// Model of either preset.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredModel {
    /// Model of the `paper` preset.
    Mixture {
        /// Transform from world to model coordinates.
        normalization: Normalization,
        /// Prior and initial hyper-parameters.
        hyper: Hyper,
        /// Weights, means and statistics.
        state: ModelState,
    },
    /// Model of the `scene` preset.
    Scene(SceneState),
}
