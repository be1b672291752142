//! The initial model in structure-of-arrays form: what every E-step reads.

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
    /// `w_k = 2 E[ln π_k] / E_s`: the weight in units of squared distance.
    pub weight: Vec<R>,
    /// Largest of the weights.
    pub max_weight: R,
    /// Prior and initial hyper-parameters.
    pub hyper: Hyper,
}

impl<R: Real> InitialModel<R> {
    /// From rows `[s, c]` and the Dirichlet parameters of the initial model, both of length
    /// `hyper.components`.
    pub fn new(hyper: Hyper, means: &[[f64; 6]], alpha: &[f64]) -> Self {
        assert_eq!(means.len(), hyper.components, "one mean per component");
        assert_eq!(alpha.len(), hyper.components, "one concentration per component");
        // In squared distances, as scores are kept: at 10⁹ nats f32 is right to hundreds only.
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

    /// Sets a component's mean, position and colour, and returns the one it had.
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

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.space.is_empty()
    }
}
