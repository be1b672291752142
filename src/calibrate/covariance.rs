//! Joint covariance of the estimated unknowns.

use super::unknowns::{DEPTH, WITH_POSE};
use crate::math::cholesky::Cholesky;
use crate::math::least_squares::NormalEquations;

#[derive(Clone, Debug)]
pub(super) struct Covariance {
    n: usize,
    values: Vec<f64>,
    /// Additional variance of each unknown, uncorrelated with the other unknowns.
    own: Vec<f64>,
}

impl Covariance {
    pub fn zero(n: usize) -> Self {
        Self { n, values: vec![0.0; n * n], own: vec![0.0; n] }
    }

    /// Returns the covariance of `n` undetermined values: infinite variances.
    pub fn open(n: usize) -> Self {
        let mut open = Self::zero(n);
        (0..n).for_each(|i| open.values[i * n + i] = f64::INFINITY);
        open
    }

    /// Adds the outer product `weight · step · stepᵀ`.
    pub fn add(&mut self, step: &[f64], weight: f64) {
        // `chunks_exact_mut` panics at size 0.
        for (row, by) in self.values.chunks_exact_mut(self.n.max(1)).zip(step) {
            row.iter_mut().zip(step).for_each(|(value, other)| *value += weight * by * other);
        }
    }

    pub fn raise_variance(&mut self, place: usize, least: f64) {
        // The root, for row and column: the variance grows by the factor, and correlations stay.
        let factor = (least / self.variance(place)).max(1.0).sqrt();
        for other in 0..self.n {
            self.values[place * self.n + other] *= factor;
            self.values[other * self.n + place] *= factor;
        }
    }

    pub fn add_independent_variance(&mut self, place: usize, variance: f64) {
        self.own[place] += variance;
    }

    fn variance(&self, place: usize) -> f64 {
        self.values[place * self.n + place]
    }

    pub fn error(&self, place: usize) -> f64 {
        (self.variance(place) + self.own[place]).sqrt()
    }

    /// Returns the largest shift of any other unknown that a shift of unknown `place` by `apart` implies
    /// (linear regression). The result is in standard errors of the other unknown.
    pub fn largest_induced_shift(&self, place: usize, apart: f64) -> f64 {
        (0..self.n)
            .filter(|&other| other != place)
            .map(|other| {
                let follows = self.values[place * self.n + other] / self.variance(place);
                (follows * apart).abs() / self.error(other)
            })
            .fold(0.0, f64::max)
    }

    /// Returns the Mahalanobis distance of a difference `apart` in the first `apart.len()` unknowns. It
    /// is 0 if their covariance is not positive definite.
    pub fn mahalanobis_distance(&self, apart: &[f64]) -> f64 {
        let m = apart.len();
        let mut block: Vec<f64> =
            self.values.chunks_exact(self.n).take(m).flat_map(|row| row[..m].to_vec()).collect();
        (0..m).for_each(|i| block[i * m + i] += self.own[i]);
        // A difference of undetermined values is not significant.
        Cholesky::new(m, &block).map_or(0.0, |factor| {
            let solved = factor.solve(apart);
            solved.iter().zip(apart).map(|(a, b)| a * b).sum::<f64>().sqrt()
        })
    }
}

/// Minimum number of views for estimating the scatter between views.
const SCATTERED: usize = 5;

pub(super) struct Scatter {
    pub gradients: Vec<Vec<f64>>,
    /// Factor on squared gradients that corrects for the degrees of freedom lost to the fit.
    pub weight: f64,
}

impl Scatter {
    pub fn of<const M: usize>(views: &[NormalEquations<M>], free: &[usize]) -> Self {
        let n = views.len() as f64;
        let of = |view: &NormalEquations<M>| free.iter().map(|&i| view.gradient[i]).collect();
        let mut gradients: Vec<Vec<f64>> = views.iter().map(of).collect();
        for place in 0..free.len() {
            // Scatter is about the mean, which the fit leaves near zero.
            let mean = gradients.iter().map(|g| g[place]).sum::<f64>() / n;
            gradients.iter_mut().for_each(|g| g[place] -= mean);
        }
        // With no more views than unknowns, the correction is undefined.
        let freedom = (n - free.len() as f64).max(1.0);
        Self { gradients, weight: n / freedom }
    }
}

/// Returns the overdispersion of the views' gradients with respect to depth offset and scale. It is
/// their variance relative to that of independent points of variance 1. With few views, it is the mean
/// number of points per view.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_make_up_for_one_another_are_certain_together() {
        let mut covariance = Covariance::zero(2);
        covariance.add(&[1.0, -1.0], 4.0);
        covariance.add(&[1.0, 1.0], 0.01);
        assert!((covariance.error(0) - 4.01_f64.sqrt()).abs() < 1e-12);
        assert!((covariance.largest_induced_shift(0, 1.0) - 0.5).abs() < 0.01);
        // Half a standard error away individually, seven jointly.
        assert!((covariance.mahalanobis_distance(&[0.7, 0.7]) - 7.0).abs() < 1e-9);
        assert!(covariance.mahalanobis_distance(&[0.7, -0.7]) < 0.4);
    }

    #[test]
    fn variances_grow_with_and_without_their_correlations() {
        let mut covariance = Covariance::zero(2);
        covariance.add(&[1.0, 1.0], 1.0);
        covariance.raise_variance(0, 0.5);
        assert_eq!(covariance.error(0), 1.0, "a variance never decreases");
        covariance.raise_variance(0, 4.0);
        assert_eq!((covariance.error(0), covariance.error(1)), (2.0, 1.0));
        assert!((covariance.largest_induced_shift(0, 1.0) - 0.5).abs() < 1e-12);
        covariance.add_independent_variance(0, 12.0);
        assert_eq!(covariance.error(0), 4.0);
        assert!(
            (covariance.largest_induced_shift(0, 1.0) - 0.5).abs() < 1e-12,
            "the regression is unchanged"
        );
        assert_eq!(Covariance::open(2).mahalanobis_distance(&[1.0, 1.0]), 0.0);
    }
}
