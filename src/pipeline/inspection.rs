//! What is known of single components of a session's model.

use super::session::Session;
use crate::model::attributes::ComponentAttributes;
use crate::model::inspection::Inspection;

impl Session {
    /// What colours components by something other than their colour, for the listed ones.
    pub fn attributes_of(&self, ids: &[u32]) -> Vec<ComponentAttributes> {
        ids.iter().map(|&id| self.attributes(id as usize)).collect()
    }

    fn attributes(&self, component: usize) -> ComponentAttributes {
        let engine = self.learner();
        let elbo = engine.component_elbo().of(component).map(|(mean, _)| mean);
        let posterior = engine.posterior(component);
        let birth = self.birth_of(component);
        ComponentAttributes::new(&posterior, self.normalization(), elbo, birth)
            .photographed(engine.photographed(component))
    }

    /// Everything known of a component; `None` if there is none of that number.
    pub fn inspect(&self, id: u32) -> Option<Inspection> {
        let component = id as usize;
        if component >= self.learner().components() {
            return None;
        }
        let posterior = self.learner().posterior(component);
        // Responsibilities of a point add up to 1, so the counts add up to the points learnt.
        let alpha0 = posterior.alpha - posterior.count;
        let total = alpha0 * self.learner().components() as f64 + self.points() as f64;
        let (attributes, splat) = (self.attributes(component), self.learner().splat(component));
        let inspection =
            Inspection::new(id, posterior, total, attributes, splat, self.normalization());
        Some(Inspection { photographed: self.learner().photographed(component), ..inspection })
    }
}
