//! Settings of a view other than splats and camera.
//!
//! [`RenderMethod`] selects the formulas, [`SplatStyle`] changes the display of all splats, and
//! [`RenderOptions`] adds near plane, background and exposure. There is no `Default`: callers choose
//! [`RenderOptions::evaluation`] or [`RenderOptions::viewport`], so that a measured image never takes
//! a display setting by accident.

use super::constants::{EVALUATION_NEAR, VIEWPORT_NEAR_SHARE, scale_floor};
use crate::model::splat::splats::Splat;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Renderer name in command lines and reports.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Renderer {
    /// Projects the covariance to the image (EWA), as common splat viewers do.
    Projected,
    /// Evaluates the response along each pixel's true ray.
    Exact,
}

/// Pixels that a projected splat may cover.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// Every pixel where alpha reaches [`super::ALPHA_CUT`]; nothing visible is lost.
    Alpha,
    /// The 16×16 tiles of a square of three standard deviations, as in the reference renderer. Opaque
    /// splats lose their rim. Intended only for bitwise comparisons.
    Tile3Sigma,
}

/// Part of a pixel's line on which the exact renderer searches for the largest response.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Response {
    /// The ray in front of the camera.
    Ray,
    /// The whole line, as in the published renderer. A long splat that reaches behind the camera
    /// paints a mirrored ghost in front of it.
    Line,
}

/// Antialiasing of the exact renderer for splats thinner than a pixel (`rendering.md`, Antialiasing).
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Antialias {
    /// Adds 0.3 px² at the splat's distance to every variance, like the projected renderer's low-pass
    /// in the image.
    Footprint,
    /// Adds nothing; thin splats flicker.
    None,
    /// Adds 1e-7 world units² and fades the splat by its gain in volume, as in the published
    /// renderer.
    Reference,
}

/// Camera projection model.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Lens {
    /// Perspective projection: straight lines stay straight.
    Pinhole,
    /// Equidistant fisheye: distance from the principal point is the angle to the optical axis, so `fx` and
    /// `fy` are pixels per radian. Requires the exact renderer.
    Fisheye,
}

/// Settings of the exact renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExactOptions {
    /// Part of the line that responds.
    pub response: Response,
    /// Treatment of splats thinner than a pixel.
    pub antialias: Antialias,
    /// Camera projection model.
    pub lens: Lens,
}

/// Renderer with its settings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RenderMethod {
    /// Projects the covariance to the image (`rendering.md`, Projected renderer).
    Projected(Support),
    /// Evaluates the response along each true ray (`rendering.md`, Exact renderer).
    Exact(ExactOptions),
}

impl RenderMethod {
    /// Projected renderer with full support.
    pub const PROJECTED: Self = Self::Projected(Support::Alpha);

    /// Exact renderer with a pinhole lens and footprint antialiasing.
    pub const EXACT: Self = Self::Exact(ExactOptions {
        response: Response::Ray,
        antialias: Antialias::Footprint,
        lens: Lens::Pinhole,
    });

    /// Renderer without its settings.
    pub fn renderer(self) -> Renderer {
        match self {
            Self::Projected(_) => Renderer::Projected,
            Self::Exact(_) => Renderer::Exact,
        }
    }

    /// Camera projection model; always a pinhole for the projected renderer.
    pub fn lens(self) -> Lens {
        match self {
            Self::Projected(_) => Lens::Pinhole,
            Self::Exact(exact) => exact.lens,
        }
    }
}

impl From<Renderer> for RenderMethod {
    /// Applies the settings used for measured images.
    fn from(renderer: Renderer) -> Self {
        match renderer {
            Renderer::Projected => Self::PROJECTED,
            Renderer::Exact => Self::EXACT,
        }
    }
}

/// Exposure of a scene that was recorded with automatic exposure.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Exposing {
    /// The exposure of the first frames, from every viewpoint.
    Neutral,
    /// The exposure recorded near the viewpoint.
    Recorded,
}

/// Source of a splat's colour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Paint {
    /// The stored colour, with gradient and view dependence if the scene has them.
    Stored,
    /// Distance of the centre from the camera, mapped from `[near, far]` (world units) to
    /// [`super::paint::ramp`].
    Depth([f32; 2]),
    /// World direction `n` of the shortest axis, turned towards the camera, as `½ + ½·n`.
    Normal,
}

/// Display settings that apply to every splat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayStyle {
    /// Factor on the standard deviations, greater than 0.
    pub scale: f32,
    /// Splats with a smaller peak opacity are not drawn.
    pub opacity_cut: f32,
    /// Source of the colour.
    pub paint: Paint,
}

impl DisplayStyle {
    /// Splats as stored.
    pub const PLAIN: Self = Self { scale: 1.0, opacity_cut: 0.0, paint: Paint::Stored };

    /// Standard deviations as drawn, in world units, after the factor and the floor of
    /// `rendering.md`, Conventions.
    pub fn display_scales(&self, splat: &Splat) -> DVec3 {
        let scales = DVec3::from_array(splat.scale.map(f64::from)) * f64::from(self.scale);
        // Whitening divides by the scales; a scale of 0 would give 0/0 in the f32 inner loop.
        scales.max(DVec3::splat(scale_floor(scales.max_element())))
    }
}

/// Settings of a view other than splats and camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// Colour behind the splats, sRGB-encoded.
    pub background: [f32; 3],
    /// Near plane in world units. Splats with a view depth `z ≤ near` (fisheye: distance `≤ near`) of the
    /// centre are dropped. Negative values count as 0.
    pub near: f64,
    /// Renderer and its settings.
    pub method: RenderMethod,
    /// Display settings of all splats.
    pub style: DisplayStyle,
    /// Exposure of the splats.
    pub exposure_mode: Exposing,
}

impl RenderOptions {
    /// Settings of measured images: near plane 0.2, unmodified splats, and the exposure recorded by the
    /// cameras.
    pub fn evaluation(method: RenderMethod, background: [f32; 3]) -> Self {
        let exposing = Exposing::Recorded;
        Self {
            background,
            near: EVALUATION_NEAR,
            method,
            style: DisplayStyle::PLAIN,
            exposure_mode: exposing,
        }
    }

    /// Settings of an interactive view: neutral exposure, and a near plane that shrinks with
    /// `scene_radius` (world units).
    pub fn viewport(method: RenderMethod, background: [f32; 3], scene_radius: f64) -> Self {
        let near = EVALUATION_NEAR.min(VIEWPORT_NEAR_SHARE * scene_radius);
        // No exposure is known away from the photographs, and brightness must not change with motion.
        let exposing = Exposing::Neutral;
        Self { near, exposure_mode: exposing, ..Self::evaluation(method, background) }
    }
}
