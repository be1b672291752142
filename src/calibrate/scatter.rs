//! By how much views differ in what they ask for.

use super::normal_equations::NormalEquations;
use super::unknowns::{DEPTH, WITH_POSE};
use crate::math::cholesky::Cholesky;

/// Views whose gradients tell by how much they scatter.
const SCATTERED: usize = 5;

/// Gradients of views about their mean.
pub(super) struct Scatter {
    pub gradients: Vec<Vec<f64>>,
    /// Of a square, since the mean and the minimum take freedom away.
    pub weight: f64,
}

impl Scatter {
    pub fn of<const M: usize>(views: &[NormalEquations<M>], free: &[usize]) -> Self {
        let n = views.len() as f64;
        let of = |view: &NormalEquations<M>| free.iter().map(|&i| view.gradient[i]).collect();
        let mut gradients: Vec<Vec<f64>> = views.iter().map(of).collect();
        for place in 0..free.len() {
            let mean = gradients.iter().map(|g| g[place]).sum::<f64>() / n;
            gradients.iter_mut().for_each(|g| g[place] -= mean);
        }
        let freedom = (n - free.len() as f64).max(1.0);
        Self { gradients, weight: n / freedom }
    }
}

/// By how much the views' gradients by depth scatter more than independent points of variance 1 would make
/// them: the mean over both directions. Of few views all points of a view count as one.
pub(super) fn overdispersion(views: &[NormalEquations<WITH_POSE>]) -> f64 {
    let total = NormalEquations::total(views);
    let Some(factor) = Cholesky::new(DEPTH.len(), &total.curvature_of(&DEPTH)) else { return 1.0 };
    if views.len() < SCATTERED {
        return total.n / views.len() as f64;
    }
    let scatter = Scatter::of(views, &DEPTH);
    let square = |gradient: &Vec<f64>| -> f64 {
        factor.solve(gradient).iter().zip(gradient).map(|(step, g)| step * g).sum()
    };
    let sum: f64 = scatter.gradients.iter().map(square).sum();
    scatter.weight * sum / DEPTH.len() as f64
}
