//! Scatter of the views' gradients.

use super::normal_equations::NormalEquations;
use super::unknowns::{DEPTH, WITH_POSE};
use crate::math::cholesky::Cholesky;

const SCATTERED: usize = 5;

/// Gradients of the views, centred on their mean.
pub(super) struct Scatter {
    pub gradients: Vec<Vec<f64>>,
    /// Factor on the squares that corrects for the lost degrees of freedom.
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

/// Overdispersion: variance of the views' gradients by depth relative to independent points of variance 1,
/// averaged over offset and scale. With few views, all points of a view count as one.
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
