//! Everything known of one component, in world units.

use super::session::Session;
use crate::math::normalization::Normalization;
use crate::math::sym3::Sym3;
use crate::model::attributes::ComponentAttributes;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::{CovarianceForm, Splat, decompose};
use glam::{DQuat, DVec3};

/// A component of a session's model.
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
}

impl Session {
    /// What colours components by something other than their colour, for the listed ones.
    pub fn attributes_of(&self, ids: &[u32]) -> Vec<ComponentAttributes> {
        ids.iter().map(|&id| self.attributes(id as usize)).collect()
    }

    fn attributes(&self, component: usize) -> ComponentAttributes {
        let engine = self.learner();
        let elbo = engine.component_elbo().of(component).map(|(mean, _)| mean);
        let posterior = engine.posterior(component);
        ComponentAttributes::new(&posterior, self.normalization(), elbo, self.birth_of(component))
    }

    /// Everything known of a component; `None` if there is none of that number.
    pub fn inspect(&self, id: u32) -> Option<Inspection> {
        let component = id as usize;
        if component >= self.learner().components() {
            return None;
        }
        let posterior = self.learner().posterior(component);
        let normalization = self.normalization();
        let covariance = posterior.world_covariance(normalization);
        let (scales, rotation) = decompose(covariance, CovarianceForm::Eigen);
        // Responsibilities of a point add up to 1, so the counts add up to the points learnt.
        let alpha0 = posterior.alpha - posterior.count;
        let (splat, appearance) = self.learner().splat(component);
        let total = alpha0 * self.learner().components() as f64 + self.points() as f64;
        Some(Inspection {
            id,
            mean: normalization.denormalize(posterior.mean_space),
            covariance,
            scales,
            rotation,
            color: Normalization::denormalize_color(posterior.mean_color),
            weight: posterior.alpha / total,
            attributes: self.attributes(component),
            splat,
            appearance,
            posterior,
        })
    }
}
