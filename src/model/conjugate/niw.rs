//! Normal-Wishart distribution of one Gaussian block, position or colour (`model.md`, Priors), in D = 3
//! dimensions.

use crate::math::special::{mv_digamma3, mv_ln_gamma3};
use crate::math::sym3::Sym3;
use glam::DVec3;
use std::f64::consts::{LN_2, TAU};

const D: f64 = 3.0;

/// Reasons why parameters do not define a Normal-Wishart distribution.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum NiwError {
    /// κ must be positive.
    #[error("expected kappa > 0, found {0}")]
    Kappa(f64),
    /// ν must exceed D − 1.
    #[error("expected nu > 2, found {0}")]
    Nu(f64),
    /// U must be positive definite.
    #[error("expected a positive definite scale matrix U, found {0:?}")]
    Scale(Sym3),
}

/// Density `N(μ | m, (κΛ)⁻¹) · W(Λ | U, ν)` of the mean `μ` and precision `Λ` of a Gaussian. Invariant:
/// κ > 0, ν > 2, U positive definite.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::sym3::Sym3;
/// use vbgs_studio::model::conjugate::niw::Niw;
///
/// let law = Niw::new(DVec3::ZERO, 1.0, Sym3::diagonal(0.2), 5.0)?;
/// // The expected precision is νU = I, so a point at the mean is most likely.
/// assert!(law.expected_ln_likelihood(DVec3::ZERO) > law.expected_ln_likelihood(DVec3::X));
/// # Ok::<(), vbgs_studio::model::conjugate::niw::NiwError>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Niw {
    mean: DVec3,
    kappa: f64,
    scale: Sym3,
    nu: f64,
    ln_det_scale: f64,
}

impl Niw {
    /// Creates the distribution after validating its parameters. `scale` is the Wishart scale `U`, so
    /// that `E[Λ] = νU`.
    pub fn new(mean: DVec3, kappa: f64, scale: Sym3, nu: f64) -> Result<Self, NiwError> {
        // NaN fails every comparison, so it is tested by itself.
        if kappa.is_nan() || kappa <= 0.0 {
            return Err(NiwError::Kappa(kappa));
        }
        if nu.is_nan() || nu <= D - 1.0 {
            return Err(NiwError::Nu(nu));
        }
        let ln_det_scale = scale.ln_det().ok_or(NiwError::Scale(scale))?;
        Ok(Self { mean, kappa, scale, nu, ln_det_scale })
    }

    /// Returns `ln |U|` of the Wishart scale `U`, computed once in `new`.
    pub fn ln_det_scale(&self) -> f64 {
        self.ln_det_scale
    }

    /// Returns the expected log determinant of the precision, `E[ln |Λ|] = D ln 2 + ln |U| + ψ_D(ν/2)`.
    pub fn expected_ln_det_precision(&self) -> f64 {
        D * LN_2 + self.ln_det_scale + mv_digamma3(0.5 * self.nu)
    }

    /// Returns `E[μᵀΛμ] = ν mᵀUm + D/κ`, the expected squared norm of the mean under the precision.
    pub fn expected_mean_precision_mean(&self) -> f64 {
        self.nu * self.scale.quadratic_form(self.mean) + D / self.kappa
    }

    /// Returns `E[ln N(x | μ, Λ⁻¹)]`. It is computed from `x − m` without expanding the square, which
    /// avoids cancellation.
    pub fn expected_ln_likelihood(&self, x: DVec3) -> f64 {
        let distance = self.nu * self.scale.quadratic_form(x - self.mean);
        0.5 * (self.expected_ln_det_precision() - D * TAU.ln() - D / self.kappa - distance)
    }

    /// Returns the log-normaliser `ln Z` of the density.
    pub fn ln_normaliser(&self) -> f64 {
        -0.5 * D * self.kappa.ln()
            + 0.5 * self.nu * self.ln_det_scale
            + 0.5 * D * (TAU.ln() + self.nu * LN_2)
            + mv_ln_gamma3(0.5 * self.nu)
    }

    /// Returns the Kullback-Leibler divergence `KL(self ‖ other)` (`model.md`, Expectations and
    /// divergences).
    pub fn kl(&self, other: &Self) -> f64 {
        let (q, p) = (self, other);
        let ratio = p.kappa / q.kappa;
        // `new` found a Cholesky factor of U_p, so the inverse exists.
        let trace = p.scale.inverse().map_or(f64::NAN, |inverse| {
            (inverse.to_mat3() * q.scale.to_mat3())
                .to_cols_array_2d()
                .iter()
                .enumerate()
                .map(|(i, c)| c[i])
                .sum()
        });
        0.5 * D * (ratio - 1.0 - ratio.ln())
            + 0.5 * p.kappa * q.nu * q.scale.quadratic_form(q.mean - p.mean)
            + 0.5 * p.nu * (p.ln_det_scale - q.ln_det_scale)
            + 0.5 * q.nu * (trace - D)
            + mv_ln_gamma3(0.5 * p.nu)
            - mv_ln_gamma3(0.5 * q.nu)
            + 0.5 * (q.nu - p.nu) * mv_digamma3(0.5 * q.nu)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_no_law() {
        let u = Sym3::diagonal(1.0);
        assert_eq!(Niw::new(DVec3::ZERO, 0.0, u, 5.0).unwrap_err(), NiwError::Kappa(0.0));
        assert_eq!(Niw::new(DVec3::ZERO, 1.0, u, 2.0).unwrap_err(), NiwError::Nu(2.0));
        assert!(matches!(
            Niw::new(DVec3::ZERO, 1.0, Sym3::default(), 5.0),
            Err(NiwError::Scale(_))
        ));
        assert!(Niw::new(DVec3::ZERO, f64::NAN, u, 5.0).is_err());
    }
}
