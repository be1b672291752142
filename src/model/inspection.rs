//! Everything known of one component, in world units.

use super::attributes::ComponentAttributes;
use super::conjugate::posterior::ComponentPosterior;
use super::scene::photometric::PhotometricDeviations;
use super::splat::appearance::Appearance;
use super::splat::splats::{CovarianceForm, Splat, decompose};
use crate::math::normalization::Normalization;
use crate::math::sym3::Sym3;
use glam::{DQuat, DVec3};

/// Everything known of one component.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inspection {
    /// Its number.
    pub id: u32,
    /// Its posterior, normalised coordinates.
    pub posterior: ComponentPosterior,
    /// Posterior mean, world units.
    pub mean: DVec3,
    /// `E[Σ]`, world units².
    pub covariance: Sym3,
    /// Standard deviations along the axes of `rotation`, world units, largest first.
    pub scales: DVec3,
    /// Turns the axes of `scales` into the world.
    pub rotation: DQuat,
    /// Posterior mean of the colour, sRGB-encoded, not clamped.
    pub color: DVec3,
    /// Expected weight in the mixture, `α_k / Σ_j α_j`.
    pub weight: f64,
    /// Evidence, uncertainty, ELBO and birth.
    pub attributes: ComponentAttributes,
    /// As renderers draw it; opacity 0 if they do not.
    pub splat: Splat,
    /// How its colour varies.
    pub appearance: Appearance,
    /// What photographs leave uncertain of the splat; `None` where they teach nothing.
    pub photographed: Option<PhotometricDeviations>,
}

impl Inspection {
    /// Of the component `id` by its posterior, of a mixture whose weights `α` add up to `total`.
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
            photographed: None,
            posterior,
        }
    }
}
