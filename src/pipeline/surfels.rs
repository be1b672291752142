//! Surface elements of a model's components.

use super::any_preset::RestoredLearner;
use crate::export::mesh::Surfel;
use crate::math::normalization::Normalization;

/// Returns a surfel for every drawn component with a known normal. Models of the `paper` preset have none.
pub fn surfels(revived: &RestoredLearner) -> Vec<(usize, Surfel)> {
    let (learner, normalization) = (&revived.learner, &revived.normalization);
    let of = |component: usize| {
        let (splat, _) = learner.splat(component);
        let normal = learner.normal(component).filter(|_| splat.is_drawable())?;
        let posterior = learner.posterior(component);
        let surfel = Surfel {
            mean: normalization.denormalize(posterior.mean_space),
            normal,
            covariance: posterior.world_covariance(normalization),
            color: Normalization::denormalize_color(posterior.mean_color),
            evidence: posterior.count,
        };
        Some((component, surfel))
    };
    (0..learner.components()).filter_map(of).collect()
}
