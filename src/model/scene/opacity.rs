//! Opacity from evidence: how many points a component returned of those it could have.

use serde::{Deserialize, Serialize};

/// Density opacity (`model.md`, Density opacity): with `ρ = N / (h²·X + c₀)`, where `X` is the
/// number of pixels per unit of area in which the component could have been measured, summed over
/// frames, the opacity is `τ·(1 − exp(−ρ/ρ₀))`.
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
    /// Opacity of a surface that returns all it can; more than 1 is a flat top.
    pub tau: f64,
    /// Density at which the opacity reaches `1 − 1/e` of `tau`, returns per expected return.
    pub rho0: f64,
    /// Expected returns that every component starts with: what a few stray points are held against.
    pub doubt: f64,
    /// Components of less opacity are not drawn.
    pub least: f64,
}

impl DensityOpacity {
    /// Opacity of `count` points where `expected` could have been, 0 if that is too little to draw.
    /// Few frames are not doubted as much: nothing else tells of the surfaces they show.
    pub fn opacity(&self, count: f64, expected: f64, frames: u64) -> f64 {
        let rho = count / (expected + self.doubt * early(frames));
        // `exp_m1` keeps the digits of small densities.
        // A power of the density was tried: no better at an equal share of what shines through.
        let opacity = self.tau * -(-rho / self.rho0).exp_m1();
        if opacity > self.least { opacity } else { 0.0 }
    }
}

/// Frames from which on a few stray points are held against a component in full.
const EARLY_FRAMES: f64 = 50.0;

/// How much of what many frames may ask of a component so many may: 0 to 1.
pub fn early(frames: u64) -> f64 {
    // In full at once, new surfaces would stay invisible: nothing could outweigh the doubt yet.
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
