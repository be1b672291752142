//! Dirichlet distribution of the mixture weights (`model.md`, Dirichlet).

use crate::math::special::{digamma, ln_gamma};

/// `E[ln π_k] = ψ(α_k) − ψ(Σ_j α_j)` for every component.
pub fn expected_ln_weights(alpha: &[f64]) -> Vec<f64> {
    let total = digamma(alpha.iter().sum());
    alpha.iter().map(|&a| digamma(a) - total).collect()
}

/// Returns `KL(Dir(a) ‖ Dir(b))`; the slices must have equal length.
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

    #[test]
    fn weights_and_divergence() {
        let ln_weights = expected_ln_weights(&[2.0, 2.0]);
        assert_eq!(ln_weights[0], ln_weights[1]);
        // ψ(2) − ψ(4) = −(1/2 + 1/3)
        assert!((ln_weights[0] + 5.0 / 6.0).abs() < 1e-14);
        assert!(kl(&[0.3, 1.7], &[0.3, 1.7]).abs() < 1e-14);
        assert!(kl(&[0.3, 1.7], &[1.0, 1.0]) > 0.0);
    }
}
