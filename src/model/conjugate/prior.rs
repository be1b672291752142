//! Hyper-parameters (`model.md`, Hyper-parameters), and the constants of the E-step that follow from
//! them.

use crate::math::special::{digamma, ln_gamma, mv_digamma3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{LN_2, TAU};

/// Degrees of freedom of the prior, equal for position and colour: `D + 1 + 1` in D = 3 dimensions.
const NU0: f64 = 5.0;
const D: f64 = 3.0;

/// Constants of the prior and the initial model, fixed before the first point.
///
/// ```
/// use vbgs_studio::model::conjugate::prior::Hyper;
///
/// let hyper = Hyper::paper(2000, 2000.0);
/// assert_eq!(hyper.expected_precision_space(), 4.5e11);
/// assert_eq!(hyper.expected_precision_color(), 5e8);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hyper {
    /// Number of components `K` (the paper's N).
    pub components: usize,
    /// Dirichlet concentration of the prior, per component.
    pub alpha0: f64,
    /// Spatial κ of the prior.
    pub kappa0_space: f64,
    /// Spatial κ of the initial model; it affects the reported ELBO only.
    pub kappa_init_space: f64,
    /// Factor `u` of the spatial Wishart scale `U = u I` of prior and initial model.
    pub u0_space: f64,
    /// Degrees of freedom of the prior, equal for position and colour.
    pub nu0: f64,
    /// Colour κ of the prior.
    pub kappa0_color: f64,
    /// Colour κ of the initial model.
    pub kappa_init_color: f64,
    /// Factor `u` of the colour Wishart scale `U = u I`, which is never updated.
    pub u0_color: f64,
}

impl Hyper {
    /// Returns the paper's values for a number of components. `position_scale` sets the prior precision
    /// of positions; the reference uses the number of components as its value.
    pub fn paper(components: usize, position_scale: f64) -> Self {
        Self {
            components,
            alpha0: 1.0 / components as f64,
            kappa0_space: 1e-3,
            // As in the reference: shifts the reported ELBO by −1.5·10⁶ but changes no assignment.
            kappa_init_space: 1e-6,
            u0_space: 22_500.0 * position_scale * position_scale,
            nu0: NU0,
            kappa0_color: 1e-2,
            kappa_init_color: 1e-2,
            // The reference states 10¹³ for its initial model, but computes with the prior's value.
            u0_color: 1e8,
        }
    }

    /// Returns the values for a scene of structural scale `h` (world units). Its sums are in world
    /// units, relative to the seeds (the points at which components were created).
    ///
    /// The prior of the covariance has the weight of two points of standard deviation 0.3 h (`model.md`,
    /// Scene splat rule). The number of components is not known in advance, so each has a concentration
    /// of 1 before it receives points.
    pub fn scene(h: f64) -> Self {
        let prior_scatter = 2.0 * (0.3 * h).powi(2);
        Self {
            components: 1,
            alpha0: 1.0,
            kappa_init_space: 1.0,
            u0_space: 1.0 / prior_scatter,
            ..Self::paper(1, 1.0)
        }
    }

    /// Returns `E[Λ^s] = ν U`, the (isotropic) expected spatial precision of the E-step.
    pub fn expected_precision_space(&self) -> f64 {
        self.nu0 * self.u0_space
    }

    /// Returns `E[Λ^c] = ν U`, the expected colour precision.
    pub fn expected_precision_color(&self) -> f64 {
        self.nu0 * self.u0_color
    }

    /// Returns the point-independent part of `E[ln p(s|k)]` under the initial model.
    pub fn ln_constant_space(&self) -> f64 {
        self.ln_constant(self.u0_space, self.kappa_init_space)
    }

    /// Returns the point-independent part of `E[ln p(c|k)]` under the initial model.
    pub fn ln_constant_color(&self) -> f64 {
        self.ln_constant(self.u0_color, self.kappa_init_color)
    }

    fn ln_constant(&self, u: f64, kappa: f64) -> f64 {
        0.5 * (D * LN_2 + D * u.ln() + mv_digamma3(0.5 * self.nu0))
            - 0.5 * D * TAU.ln()
            - 0.5 * D / kappa
    }
}

/// Returns the expected log weight of every component, `E[ln π_k] = ψ(α_k) − ψ(Σ_j α_j)`.
pub fn expected_ln_weights(alpha: &[f64]) -> Vec<f64> {
    let total = digamma(alpha.iter().sum());
    alpha.iter().map(|&a| digamma(a) - total).collect()
}

/// Returns the Kullback-Leibler divergence `KL(Dir(a) ‖ Dir(b))`; the slices must have equal length.
pub fn kl(a: &[f64], b: &[f64]) -> f64 {
    let (sum_a, sum_b): (f64, f64) = (a.iter().sum(), b.iter().sum());
    let psi_sum = digamma(sum_a);
    let per_component: f64 = a
        .iter()
        .zip(b)
        .map(|(&a, &b)| ln_gamma(b) - ln_gamma(a) + (a - b) * (digamma(a) - psi_sum))
        .sum();
    ln_gamma(sum_a) - ln_gamma(sum_b) + per_component
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Compares with the check values of `model.md`, Expectations and divergences.
    #[test]
    fn constants_match_the_specification() {
        for (components, expected) in
            [(100_000, 48.434_802_923_286_5), (2000, 36.698_733_907_002_1)]
        {
            let hyper = Hyper::paper(components, components as f64);
            assert!((hyper.ln_constant_space() + 1.5e6 - expected).abs() < 1e-9);
            assert!((hyper.ln_constant_color() + 150.0 - 26.495_141_762_015_6).abs() < 1e-11);
        }
        let hyper = Hyper::paper(100_000, 1e5);
        assert_eq!(hyper.expected_precision_space(), 1.125e15);
        assert_eq!(hyper.expected_precision_color(), 5e8);
    }
}
