//! Complete description of one component, in world units.

use super::attributes::ComponentAttributes;
use super::conjugate::posterior::ComponentPosterior;
use super::scene::photometric::PhotometricDeviations;
use super::splat::appearance::Appearance;
use super::splat::splats::{CovarianceForm, Splat, decompose};
use crate::math::measured_pixel::Normalization;
use crate::math::sym3::Sym3;
use glam::{DQuat, DVec3};

/// Complete description of one component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inspection {
    /// Index of the component.
    pub id: u32,
    /// Posterior in normalised coordinates.
    pub posterior: ComponentPosterior,
    /// Posterior mean, world units.
    pub mean: DVec3,
    /// Expected covariance `E[Σ]`, world units².
    pub covariance: Sym3,
    /// Standard deviations along the principal axes, world units, largest first.
    pub scales: DVec3,
    /// Rotation from the component's principal axes, to which `scales` refers, to the world axes.
    pub rotation: DQuat,
    /// Posterior mean of the colour, sRGB-encoded, not clamped.
    pub color: DVec3,
    /// Expected weight in the mixture, `α_k / Σ_j α_j`.
    pub weight: f64,
    /// Evidence, uncertainty, ELBO and birth.
    pub attributes: ComponentAttributes,
    /// Splat as drawn; opacity 0 if it is not drawn.
    pub splat: Splat,
    /// Variation of the splat's colour with position and direction.
    pub appearance: Appearance,
    /// Standard deviations of the splat's parameters as estimated from photographs; `None` if
    /// photographs were not trained on.
    pub photometric_deviations: Option<PhotometricDeviations>,
}

impl Inspection {
    /// Describes component `id` of a mixture in which the Dirichlet concentrations `α` of all components
    /// sum to `total`.
    pub fn new(
        id: u32,
        posterior: ComponentPosterior,
        total: f64,
        attributes: ComponentAttributes,
        (splat, appearance): (Splat, Appearance),
        normalization: &Normalization,
    ) -> Self {
        let covariance = posterior.world_covariance(normalization);
        let (scales, rotation) = decompose(covariance, CovarianceForm::Eigen);
        Self {
            id,
            mean: normalization.denormalize(posterior.mean_space),
            covariance,
            scales,
            rotation,
            color: Normalization::denormalize_color(posterior.mean_color),
            weight: posterior.alpha / total,
            attributes,
            splat,
            appearance,
            photometric_deviations: None,
            posterior,
        }
    }
}

/// Error of a compute device, after which the work continues on the CPU.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device} failed: {reason}")]
pub struct DeviceError {
    /// Name of the device.
    pub device: String,
    /// Reason as reported by the device.
    pub reason: String,
}
