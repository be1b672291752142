//! What a view needs besides splats and camera.
//!
//! [`RenderMethod`] says which formulas apply, [`SplatStyle`] what a viewer changes about all
//! splats, [`RenderOptions`] ties both to near plane, background and exposure. Two constructors,
//! [`RenderOptions::evaluation`] and [`RenderOptions::viewport`], and no `Default`: a measured
//! image must not take a setting by accident that people only look through.

use super::constants::{EVALUATION_NEAR, VIEWPORT_NEAR_SHARE, scale_floor};
use crate::model::splat::splats::Splat;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// The two renderers, as the command line and reports spell them.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Renderer {
    /// The covariance projected to the image (EWA), as every viewer of splats does.
    Projected,
    /// The response along each pixel's true ray.
    Exact,
}

/// Which pixels a projected splat may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// Every pixel where its alpha passes [`super::ALPHA_CUT`]; nothing visible is lost.
    Alpha,
    /// The 16×16 tiles of a square of three standard deviations, as the reference renderer does:
    /// opaque splats lose their rim there. For comparisons of bits only.
    Tile3Sigma,
}

/// Where on a pixel's line the exact renderer looks for the largest response.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Response {
    /// From the camera on: what is behind stays behind.
    Ray,
    /// Everywhere, as the published renderer does: a long splat that reaches behind the camera
    /// paints a mirrored ghost in front.
    Line,
}

/// What the exact renderer does about splats thinner than a pixel (`rendering.md`, Antialiasing).
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Antialias {
    /// Adds 0.3 px² at the splat's distance to every variance, as the projected renderer does in
    /// the image.
    Footprint,
    /// Nothing: thin splats flicker.
    None,
    /// Adds 1e-7 world units² and fades the splat by the volume it gained, as the published
    /// renderer does.
    Reference,
}

/// How pixels map to rays.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Lens {
    /// Straight lines stay straight.
    Pinhole,
    /// Equidistant fisheye: distance from the principal point is the angle to the axis, so `fx` and
    /// `fy` are pixels per radian. Only the exact renderer can draw it.
    Fisheye,
}

/// Settings of the exact renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExactOptions {
    /// Ray or line.
    pub response: Response,
    /// What becomes of splats thinner than a pixel.
    pub antialias: Antialias,
    /// How pixels map to rays.
    pub lens: Lens,
}

/// A renderer with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderMethod {
    /// The covariance projected to the image (`rendering.md`, Projected renderer).
    Projected(Support),
    /// The response along each true ray (`rendering.md`, Exact renderer).
    Exact(ExactOptions),
}

impl RenderMethod {
    /// The projected renderer, nothing visible lost.
    pub const PROJECTED: Self = Self::Projected(Support::Alpha);

    /// The exact renderer through a pinhole, antialiased.
    pub const EXACT: Self = Self::Exact(ExactOptions {
        response: Response::Ray,
        antialias: Antialias::Footprint,
        lens: Lens::Pinhole,
    });

    /// The renderer without its settings.
    pub fn renderer(self) -> Renderer {
        match self {
            Self::Projected(_) => Renderer::Projected,
            Self::Exact(_) => Renderer::Exact,
        }
    }

    /// How pixels map to rays.
    pub fn lens(self) -> Lens {
        match self {
            Self::Projected(_) => Lens::Pinhole,
            Self::Exact(exact) => exact.lens,
        }
    }
}

impl From<Renderer> for RenderMethod {
    /// With the settings that measured images have.
    fn from(renderer: Renderer) -> Self {
        match renderer {
            Renderer::Projected => Self::PROJECTED,
            Renderer::Exact => Self::EXACT,
        }
    }
}

/// How bright a scene is drawn whose cameras exposed by themselves.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Exposing {
    /// As the first frames were exposed, from everywhere.
    Neutral,
    /// As frames that were recorded thereabouts.
    Recorded,
}

/// What colour a splat gets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// The splat's stored colour, with gradient and view dependence where the scene has them.
    Stored,
    /// Its distance from the camera between two ends (world units) on the ramp of
    /// [`super::paint::ramp`].
    Depth([f32; 2]),
    /// The direction of its shortest axis in the world, turned towards the camera: `½ + ½·n`.
    Normal,
}

/// What a viewer may change about every splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatStyle {
    /// Factor on the standard deviations, more than 0.
    pub scale: f32,
    /// Splats with a smaller peak opacity are not drawn.
    pub opacity_cut: f32,
    /// What colour a splat gets.
    pub paint: Paint,
}

impl SplatStyle {
    /// Splats as they are.
    pub const PLAIN: Self = Self { scale: 1.0, opacity_cut: 0.0, paint: Paint::Stored };

    /// A splat's standard deviations as they are drawn, world units: the factor and the floor of
    /// `rendering.md`, Conventions, applied.
    pub fn scales(&self, splat: &Splat) -> DVec3 {
        let scales = DVec3::from_array(splat.scale.map(f64::from)) * f64::from(self.scale);
        // Whitening divides by the scales: a flat splat would give 0/0 in the f32 of the inner
        // loop.
        scales.max(DVec3::splat(scale_floor(scales.max_element())))
    }
}

/// What a view needs besides splats and camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// sRGB-encoded colour behind the splats.
    pub background: [f32; 3],
    /// Splats whose centre has a view depth `z ≤ near` are dropped (fisheye: a distance `≤ near`);
    /// world units. Negative values count as 0.
    pub near: f64,
    /// Which renderer, and how.
    pub method: RenderMethod,
    /// What to change about every splat.
    pub look: SplatStyle,
    /// How bright the splats are drawn.
    pub exposing: Exposing,
}

impl RenderOptions {
    /// The settings of measured images: near plane 0.2, splats as they are, as bright as the cameras
    /// that measured.
    pub fn evaluation(method: RenderMethod, background: [f32; 3]) -> Self {
        let exposing = Exposing::Recorded;
        Self { background, near: EVALUATION_NEAR, method, look: SplatStyle::PLAIN, exposing }
    }

    /// The settings of a view people move in: one exposure, and the near plane shrinks with small
    /// scenes, whose radius is in world units.
    pub fn viewport(method: RenderMethod, background: [f32; 3], scene_radius: f64) -> Self {
        let near = EVALUATION_NEAR.min(VIEWPORT_NEAR_SHARE * scene_radius);
        // Where nobody took a photograph nothing says how bright: and it must not change on the way.
        let exposing = Exposing::Neutral;
        Self { near, exposing, ..Self::evaluation(method, background) }
    }
}
