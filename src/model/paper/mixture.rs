//! The initial model as a structure of arrays, read by every E-step.

use crate::math::real::Real;
use crate::model::conjugate::dirichlet;
use crate::model::conjugate::prior::Hyper;

/// Means and weights of the initial model, normalised coordinates.
#[derive(Clone, Debug)]
pub struct InitialModel<R> {
    /// Spatial means, one row per component, normalised.
    pub space: Vec<[R; 3]>,
    /// Colour means, one row per component, normalised.
    pub color: Vec<[R; 3]>,
    /// `w_k = 2 E[ln π_k] / E_s`: the log weight in units of squared distance.
    pub weight: Vec<R>,
    /// Largest of the weights.
    pub max_weight: R,
    /// Prior and initial hyper-parameters.
    pub hyper: Hyper,
}

impl<R: Real> InitialModel<R> {
    /// Builds the model from rows `[s, c]` and the initial Dirichlet parameters, both of length
    /// `hyper.components`.
    pub fn new(hyper: Hyper, means: &[[f64; 6]], alpha: &[f64]) -> Self {
        assert_eq!(means.len(), hyper.components, "one mean per component");
        assert_eq!(alpha.len(), hyper.components, "one concentration per component");
        // Scores are squared distances: at 10⁹ nats f32 would resolve hundreds only.
        let to_weight = 2.0 / hyper.expected_precision_space();
        let ln_weights = dirichlet::expected_ln_weights(alpha);
        let weight: Vec<R> = ln_weights.into_iter().map(|w| R::of(w * to_weight)).collect();
        Self {
            max_weight: weight.iter().fold(-R::INFINITY, |m, &w| if w > m { w } else { m }),
            weight,
            space: means.iter().map(|m| [m[0], m[1], m[2]].map(R::of)).collect(),
            color: means.iter().map(|m| [m[3], m[4], m[5]].map(R::of)).collect(),
            hyper,
        }
    }

    /// Replaces a component's mean (position, colour) and returns the old one.
    pub fn replace_mean(
        &mut self,
        component: usize,
        (space, color): ([R; 3], [R; 3]),
    ) -> ([R; 3], [R; 3]) {
        let old_space = std::mem::replace(&mut self.space[component], space);
        (old_space, std::mem::replace(&mut self.color[component], color))
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.space.len()
    }

    /// True if there are no components.
    pub fn is_empty(&self) -> bool {
        self.space.is_empty()
    }
}
