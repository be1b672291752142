//! Conversion of sums to splats with a flat top, a colour gradient and a view-dependent colour (`model.md`,
//! Scene splat rule).

use super::sums::{SceneSums, outer};
use crate::math::sym3::Sym3;
use crate::model::splat::appearance::{Appearance, PLAIN_WIDTH, plain_of_equal_area};
use crate::model::splat::splats::{CovarianceForm, Splat, decompose, rotation_array};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Kind of splats that represent a scene.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum SplatKind {
    /// Splats with flat tops, colour gradients and filled cracks, as this program draws them.
    Native,
    /// Gaussians with opacity up to 1, which every viewer draws alike.
    Plain,
}

impl SplatKind {
    /// Returns the kind of splats that `rule` makes.
    pub fn of(rule: &SplatRule) -> Self {
        if rule.flat_top { Self::Native } else { Self::Plain }
    }
}

/// Parameters of the conversion from sums to a splat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SplatRule {
    /// Opacity as a function of a component's density: the number of points received per point expected.
    pub opacity: DensityOpacity,
    /// Minimum number of points of a component that is drawn.
    pub least_points: f64,
    /// Factor on the standard deviations of a splat.
    pub scale: f64,
    /// Opacity of the composited splats from which a pixel is treated as fully covered, in `(0, 1]`.
    #[serde(default = "open", rename = "closing")]
    pub full_coverage: f64,
    /// True if opacities may exceed 1, which gives splats a flat top.
    // Skipped if true, so that files of native scenes are unchanged.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub flat_top: bool,
    /// Minimum standard deviation of a splat, in units of the structural scale `h`.
    pub least_scale: f64,
    /// Standard deviation of the pseudo-points that represent the prior, in units of the structural
    /// scale `h`.
    pub prior_scale: f64,
    /// Number of pseudo-points that represent the prior.
    pub prior_points: f64,
    /// True if colour varies over a splat.
    pub gradient: bool,
    /// Ridge of the regression of colour on position, in units of `h²` (`h` is the structural scale).
    pub gradient_ridge: f64,
    /// True if colour depends on the view direction.
    pub directional: bool,
    /// Ridge of the regression of colour on view direction: constant part, and part that is divided by
    /// the number of points.
    pub directional_ridge: [f64; 2],
}

/// Data from which a component's splat is derived besides its sums.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatContext {
    /// Seed of the component (the point at which it was created), world units.
    pub seed: DVec3,
    /// Structural scale, world units.
    pub h: f64,
    /// Number of points expected from the component over all frames so far.
    pub expected: f64,
    /// Number of frames trained on.
    pub frames: u64,
}

/// Location and extent of a component's points, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointExtent {
    /// Mean of the points, world units.
    pub mean: DVec3,
    /// Covariance of the splat that is derived from the points, world units².
    pub covariance: Sym3,
}

impl SplatRule {
    /// Returns this rule changed to make plain splats (see [`SplatKind::Plain`]), which files and other
    /// viewers represent exactly.
    pub fn plain(self) -> Self {
        let scale = self.scale * PLAIN_WIDTH;
        Self { flat_top: false, gradient: false, full_coverage: 1.0, scale, ..self }
    }

    /// Returns the splat and the appearance of a component. The splat is an empty slot if the component
    /// must not be drawn.
    pub fn splat(&self, sums: &SceneSums, context: &SplatContext) -> (Splat, Appearance) {
        let opacity = self.opacity.opacity(sums.count, context.expected, context.frames);
        // In the first frames every component has few points, but something must be visible.
        let least_points = (self.least_points * early_factor(context.frames)).max(1.0);
        if sums.count < least_points || opacity == 0.0 {
            return Default::default();
        }
        let mean = sums.mean_offset();
        let covariance = sums.covariance();
        let (scale, rotation) =
            decompose(self.regular(covariance, sums.count, context.h), CovarianceForm::Eigen);
        let (opacity, widened) =
            if self.flat_top { (opacity, 1.0) } else { plain_of_equal_area(opacity) };
        let scale =
            (scale * (self.scale * widened)).max(DVec3::splat(self.least_scale * context.h));
        // Not clamped: the constant term of a directional colour may lie outside [0, 1].
        let mut color = sums.color / sums.count;
        let mut appearance = Appearance::default();
        if self.gradient {
            // Uses the points' own covariance, without the prior and the scale factor of the splat.
            appearance.gradient =
                rows(sums.gradient(covariance, self.gradient_ridge * context.h * context.h));
        }
        if self.directional {
            let weights = self.directional(sums);
            // Constant term of the regression; renderers add the part linear in the direction.
            color -= weights * (sums.view / sums.count);
            appearance.directional = rows(weights);
        }
        let splat = Splat {
            mean: (context.seed + mean).as_vec3().to_array(),
            opacity: opacity as f32,
            color: color.as_vec3().to_array(),
            scale: scale.as_vec3().to_array(),
            rotation: rotation_array(rotation),
        };
        // Renderers cannot handle it; occurs for worlds in nanometres or malformed files.
        if splat.is_valid() { (splat, appearance) } else { Default::default() }
    }

    /// Returns mean and extent of a component's points, which limit its splat; `None` if there are no
    /// points.
    pub fn extent(&self, sums: &SceneSums, context: &SplatContext) -> Option<PointExtent> {
        let SplatContext { seed, h, .. } = *context;
        if sums.count < 1.0 {
            return None;
        }
        let covariance = self.regular(sums.covariance(), sums.count, h).scaled(self.scale.powi(2));
        let least = (self.least_scale * h).powi(2);
        // A sum instead of a maximum per axis: it bounds the same width without a decomposition.
        let covariance = covariance.add_scaled(1.0, Sym3::diagonal(least));
        Some(PointExtent { mean: seed + sums.mean_offset(), covariance })
    }

    /// Returns the covariance of a component, regularised by the prior's pseudo-points.
    fn regular(&self, covariance: Sym3, count: f64, h: f64) -> Sym3 {
        let prior = Sym3::diagonal((self.prior_scale * h).powi(2));
        covariance
            // The prior acts as points of an isotropic Gaussian: few points of a plane have a covariance of
            // rank two or less.
            .scaled(count)
            .add_scaled(self.prior_points, prior)
            .scaled(1.0 / (count + self.prior_points))
    }

    /// Regresses colour on view direction with a ridge; returns the slopes, one row per channel.
    fn directional(&self, sums: &SceneSums) -> DMat3 {
        let n = sums.count;
        let (view, spread) = sums.view_moments();
        let joint = sums.color_view * (1.0 / n) - outer(sums.color / n, view);
        // Directions of a surface seen from one side only hardly vary: the ridge regularises them.
        let [constant, falling] = self.directional_ridge;
        match spread.add_scaled(1.0, Sym3::diagonal(constant + falling / n)).inverse() {
            Some(inverse) => joint * inverse.to_mat3(),
            None => DMat3::ZERO,
        }
    }
}

/// Returns the default of `full_coverage`, for scenes written before crack filling existed.
fn open() -> f64 {
    1.0
}

/// Returns the default of `flat_top`, for native scenes and for scenes written before
/// [`SplatKind::Plain`] existed.
fn yes() -> bool {
    true
}

fn rows(m: DMat3) -> [[f32; 3]; 3] {
    let rows = m.transpose();
    [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array())
}

/// Opacity from the density `ρ = N / (h²·X + c₀)`: `τ·(1 − exp(−ρ/ρ₀))` (`model.md`, Density opacity).
/// `N` is the component's number of points and `h` the structural scale. `X` is the number of pixels per
/// unit of area in which the component could be measured, summed over frames.
///
/// ```
/// use vbgs_studio::model::scene::splat_rule::DensityOpacity;
///
/// let rule = DensityOpacity { tau: 3.2, rho0: 0.7, doubt: 20.0, least: 0.3 };
/// assert!(rule.opacity(200.0, 200.0, 100) > 1.0, "a flat top");
/// assert_eq!(rule.opacity(3.0, 200.0, 100), 0.0, "stray points");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DensityOpacity {
    /// Limit `τ` of the opacity at high density; above 1 the splat has a flat top.
    pub tau: f64,
    /// Density `ρ₀` at which the opacity reaches `1 − 1/e` of `tau`: points received per point expected.
    pub rho0: f64,
    /// Constant `c₀` added to the expected number of points, so that components of a few stray points
    /// stay transparent.
    pub doubt: f64,
    /// Minimum opacity of a component that is drawn.
    pub least: f64,
}

impl DensityOpacity {
    /// Returns the opacity for `count` points out of `expected`, 0 if it does not exceed `least`. The
    /// constant `doubt` is reduced over the first frames, when all surfaces have few points.
    pub fn opacity(&self, count: f64, expected: f64, frames: u64) -> f64 {
        let rho = count / (expected + self.doubt * early_factor(frames));
        // `exp_m1` preserves the digits of small densities. A power of the density was tried: no better at an
        // equal share of pixels that shine through.
        let opacity = self.tau * -(-rho / self.rho0).exp_m1();
        if opacity > self.least { opacity } else { 0.0 }
    }
}

/// Number of frames after which `doubt` and the minimum number of points have their full values.
const EARLY_FRAMES: f64 = 50.0;

/// Returns a factor, 0 to 1, for thresholds that are reached only after many frames. It grows over the
/// first `EARLY_FRAMES` frames.
pub fn early_factor(frames: u64) -> f64 {
    // With the full threshold from the start, new surfaces would stay invisible for many frames.
    (frames as f64 / EARLY_FRAMES).min(1.0)
}

#[cfg(test)]
mod opacity_tests {
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
