//! Opacity from evidence: the share of the expected points that a component received.

use serde::{Deserialize, Serialize};

/// Density opacity (`model.md`, Density opacity): with `ρ = N / (h²·X + c₀)`, where `X` is the number of
/// pixels per unit of area in which the component could have been measured, summed over frames, the opacity
/// is `τ·(1 − exp(−ρ/ρ₀))`.
///
/// ```
/// use vbgs_studio::model::scene::opacity::DensityOpacity;
///
/// let rule = DensityOpacity { tau: 3.2, rho0: 0.7, doubt: 20.0, least: 0.3 };
/// assert!(rule.opacity(200.0, 200.0, 100) > 1.0, "a flat top");
/// assert_eq!(rule.opacity(3.0, 200.0, 100), 0.0, "stray points");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DensityOpacity {
    /// Opacity at full density; above 1 the splat has a flat top.
    pub tau: f64,
    /// Density at which the opacity reaches `1 − 1/e` of `tau`, returns per expected return.
    pub rho0: f64,
    /// Constant `c₀` added to the expected returns, so that a few stray points do not become visible.
    pub doubt: f64,
    /// Components of lower opacity are not drawn.
    pub least: f64,
}

impl DensityOpacity {
    /// Returns the opacity for `count` points out of `expected`, 0 if it is below the threshold. The constant
    /// `doubt` is reduced over the first frames, when all surfaces have few points.
    pub fn opacity(&self, count: f64, expected: f64, frames: u64) -> f64 {
        let rho = count / (expected + self.doubt * early_factor(frames));
        // `exp_m1` preserves the digits of small densities. A power of the density was tried: no better at an
        // equal share of pixels that shine through.
        let opacity = self.tau * -(-rho / self.rho0).exp_m1();
        if opacity > self.least { opacity } else { 0.0 }
    }
}

/// Number of frames from which on `doubt` and the minimum number of points apply in full.
const EARLY_FRAMES: f64 = 50.0;

/// Returns the factor, 0 to 1, on thresholds that need many frames, after `frames` frames.
pub fn early_factor(frames: u64) -> f64 {
    // With the full threshold from the start, new surfaces would stay invisible for many frames.
    (frames as f64 / EARLY_FRAMES).min(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opacity_grows_with_returns_and_falls_with_looks() {
        let rule = DensityOpacity { tau: 3.0, rho0: 0.4, doubt: 20.0, least: 0.3 };
        assert_eq!(rule.opacity(0.0, 100.0, 100), 0.0);
        assert!(rule.opacity(100.0, 100.0, 100) > rule.opacity(50.0, 100.0, 100));
        assert!(rule.opacity(100.0, 100.0, 100) > rule.opacity(100.0, 200.0, 100));
        assert_eq!(rule.opacity(1.0, 500.0, 100), 0.0, "a stray point is not drawn");
        assert!(rule.opacity(1e6, 1.0, 100) <= 3.0);
        assert!(rule.opacity(5.0, 6.0, 1) > 2.0, "a surface shows in the first frame");
    }
}
