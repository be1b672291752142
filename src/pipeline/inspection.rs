//! Inspection of single components.

use super::session::Session;
use crate::model::attributes::ComponentAttributes;
use crate::model::inspection::Inspection;

impl Session {
    /// Returns attributes of the listed components for false-colour views.
    pub fn attributes_of(&self, ids: &[u32]) -> Vec<ComponentAttributes> {
        ids.iter().map(|&id| self.attributes(id as usize)).collect()
    }

    fn attributes(&self, component: usize) -> ComponentAttributes {
        let engine = self.learner();
        let elbo = engine.component_elbo().mean_elbo_of(component).map(|(mean, _)| mean);
        let posterior = engine.posterior(component);
        let birth = self.birth_of(component);
        ComponentAttributes::new(&posterior, self.normalization(), elbo, birth)
            .with_photometric_uncertainty(engine.photometric_deviations(component))
    }

    /// Returns all data of a component; `None` if `id` is out of range.
    pub fn inspect(&self, id: u32) -> Option<Inspection> {
        let component = id as usize;
        if component >= self.learner().components() {
            return None;
        }
        let posterior = self.learner().posterior(component);
        // The responsibilities of a point sum to 1, so the counts sum to the number of points.
        let alpha0 = posterior.alpha - posterior.count;
        let total = alpha0 * self.learner().components() as f64 + self.points() as f64;
        let (attributes, splat) = (self.attributes(component), self.learner().splat(component));
        let inspection =
            Inspection::new(id, posterior, total, attributes, splat, self.normalization());
        Some(Inspection {
            photometric_deviations: self.learner().photometric_deviations(component),
            ..inspection
        })
    }
}
