//! From sums to what renderers draw: a splat with a flat top, a colour gradient and a colour that
//! depends on the direction it is seen from (`model.md`, Scene splat rule).

use super::opacity::{DensityOpacity, early};
use super::sums::{SceneSums, outer};
use crate::math::sym3::Sym3;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::plain::{PLAIN_WIDTH, of_equal_area};
use crate::model::splat::splats::{CovarianceForm, Splat, decompose};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// What splats are.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum SplatKind {
    /// With flat tops, colour gradients and filled cracks, which this program draws.
    Native,
    /// Gaussians of an opacity up to 1 that every viewer draws alike.
    Plain,
}

impl SplatKind {
    /// Of the splats that a rule makes.
    pub fn of(rule: &SplatRule) -> Self {
        if rule.flat_top { Self::Native } else { Self::Plain }
    }
}

/// How sums become a splat.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SplatRule {
    /// Opacity from returns.
    pub opacity: DensityOpacity,
    /// Fewest points of a component that is drawn.
    pub least_points: f64,
    /// Factor on the standard deviations.
    pub scale: f64,
    /// Coverage from which on a pixel counts as covered in full, in `(0, 1]`.
    #[serde(default = "open", rename = "closing")]
    pub full_coverage: f64,
    /// Whether opacities may exceed 1, which gives splats a flat top.
    // Left out where it is on, so that files of native scenes are what they were.
    #[serde(default = "yes", skip_serializing_if = "Clone::clone")]
    pub flat_top: bool,
    /// Least standard deviation, units of `h`.
    pub least_scale: f64,
    /// Standard deviation of the points that every component starts with, units of `h`.
    pub prior_scale: f64,
    /// How many such points.
    pub prior_points: f64,
    /// Whether colour varies over a splat.
    pub gradient: bool,
    /// Ridge of the regression of colour on position, units of `h²`.
    pub gradient_ridge: f64,
    /// Whether colour depends on the view direction.
    pub directional: bool,
    /// Ridge of the regression of colour on direction, and its part that falls as `1/N`.
    pub directional_ridge: [f64; 2],
}

/// What a component's splat depends on besides its sums.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatContext {
    /// Seed, world units.
    pub seed: DVec3,
    /// Structural scale, world units.
    pub h: f64,
    /// Returns expected of it so far.
    pub expected: f64,
    /// Frames learnt so far.
    pub frames: u64,
}

/// Where the points of a component are, world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointExtent {
    /// Their mean, world units.
    pub mean: DVec3,
    /// Covariance of the splat that they make, world units².
    pub covariance: Sym3,
}

impl SplatRule {
    /// The rule of splats that files and other viewers hold as they are.
    pub fn plain(self) -> Self {
        let scale = self.scale * PLAIN_WIDTH;
        Self { flat_top: false, gradient: false, full_coverage: 1.0, scale, ..self }
    }

    /// The splat of a component and its appearance; an empty slot if it is not to be drawn.
    pub fn splat(&self, sums: &SceneSums, context: &SplatContext) -> (Splat, Appearance) {
        let opacity = self.opacity.opacity(sums.count, context.expected, context.frames);
        // The first frames cannot bring many points to any component, and must show something.
        let least_points = (self.least_points * early(context.frames)).max(1.0);
        if sums.count < least_points || opacity == 0.0 {
            return Default::default();
        }
        let mean = sums.mean_offset();
        let covariance = sums.covariance();
        let (scale, rotation) =
            decompose(self.regular(covariance, sums.count, context.h), CovarianceForm::Eigen);
        let (opacity, widened) =
            if self.flat_top { (opacity, 1.0) } else { of_equal_area(opacity) };
        let scale =
            (scale * (self.scale * widened)).max(DVec3::splat(self.least_scale * context.h));
        let mut color = sums.color / sums.count;
        let mut appearance = Appearance::default();
        if self.gradient {
            // By the points' own covariance: without the prior and the factor that shape the splat.
            appearance.gradient =
                rows(sums.gradient(covariance, self.gradient_ridge * context.h * context.h));
        }
        if self.directional {
            let weights = self.directional(sums);
            // The constant term of the regression; renderers add the part that is linear in the
            // direction.
            color -= weights * (sums.view / sums.count);
            appearance.directional = rows(weights);
        }
        let splat = Splat {
            mean: (context.seed + mean).as_vec3().to_array(),
            opacity: opacity as f32,
            color: color.as_vec3().to_array(),
            scale: scale.as_vec3().to_array(),
            rotation: [rotation.w, rotation.x, rotation.y, rotation.z].map(|q| q as f32),
        };
        // Beyond what renderers can work with, as of worlds in nanometres or files of nobody's making.
        if splat.is_valid() { (splat, appearance) } else { Default::default() }
    }

    /// Where the points of a component are, as a bound of its splat; `None` without points.
    pub fn extent(&self, sums: &SceneSums, context: &SplatContext) -> Option<PointExtent> {
        let SplatContext { seed, h, .. } = *context;
        if sums.count < 1.0 {
            return None;
        }
        let covariance = self.regular(sums.covariance(), sums.count, h).scaled(self.scale.powi(2));
        let least = (self.least_scale * h).powi(2);
        let covariance = covariance.add_scaled(1.0, Sym3::diagonal(least));
        Some(PointExtent { mean: seed + sums.mean_offset(), covariance })
    }

    /// The covariance with the prior's points added to it.
    fn regular(&self, covariance: Sym3, count: f64, h: f64) -> Sym3 {
        let prior = Sym3::diagonal((self.prior_scale * h).powi(2));
        covariance
            // As if so many points of an isotropic Gaussian had been seen: few points of a plane
            // have a covariance of rank two or less.
            .scaled(count)
            .add_scaled(self.prior_points, prior)
            .scaled(1.0 / (count + self.prior_points))
    }

    /// Ridge regression of colour on view direction, row per channel.
    fn directional(&self, sums: &SceneSums) -> DMat3 {
        let n = sums.count;
        let view = sums.view / n;
        let joint = sums.color_view * (1.0 / n) - outer(sums.color / n, view);
        let spread = sums.view_second.scaled(1.0 / n).add_scaled(-1.0, Sym3::outer(view));
        // A surface seen from one side only has hardly a spread of directions: the ridge holds it.
        let [constant, falling] = self.directional_ridge;
        match spread.add_scaled(1.0, Sym3::diagonal(constant + falling / n)).inverse() {
            Some(inverse) => joint * inverse.to_mat3(),
            None => DMat3::ZERO,
        }
    }
}

/// Of scenes written before cracks were filled.
fn open() -> f64 {
    1.0
}

/// Of scenes written before splats could be plain, and of native ones.
fn yes() -> bool {
    true
}

fn rows(m: DMat3) -> [[f32; 3]; 3] {
    let rows = m.transpose();
    [rows.x_axis, rows.y_axis, rows.z_axis].map(|row| row.as_vec3().to_array())
}
