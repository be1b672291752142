//! Settings of a view other than splats and camera.
//!
//! [`RenderMethod`] selects the formulas, [`DisplayStyle`] changes the display of all splats, and
//! [`RenderOptions`] adds near plane, background and exposure. There is no `Default`: callers choose
//! [`RenderOptions::evaluation`] or [`RenderOptions::viewport`], so that a measured image never takes
//! a display setting by accident.

use crate::math::camera::Intrinsics;
use crate::model::splat::splats::Splat;
use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::PI;
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

/// Part of a pixel's line of sight on which the exact renderer searches for the largest response.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Response {
    /// The part in front of the camera.
    Ray,
    /// The whole line, as in the published renderer. A long splat that reaches behind the camera also
    /// appears as a mirrored ghost in front of the camera.
    Line,
}

/// Antialiasing of the exact renderer for splats thinner than a pixel (`rendering.md`, Antialiasing).
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Antialias {
    /// Adds the variance 0.3 px², converted to world units at the splat's distance, along every axis.
    /// Corresponds to the projected renderer's low-pass in the image.
    Footprint,
    /// Adds no variance; thin splats flicker.
    None,
    /// Adds the variance 1e-7 world units² and divides the opacity by the gain in volume, as in the
    /// published renderer.
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
    /// Equidistant fisheye: the distance from the principal point is proportional to the angle to the
    /// optical axis. `fx` and `fy` are in pixels per radian. Requires the exact renderer.
    Fisheye,
}

/// Settings of the exact renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ExactOptions {
    /// Part of a pixel's line of sight that can contain a splat's largest response.
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
    Projected,
    /// Evaluates the response along each pixel's true ray (`rendering.md`, Exact renderer).
    Exact(ExactOptions),
}

impl RenderMethod {
    /// Projected renderer.
    pub const PROJECTED: Self = Self::Projected;

    /// Exact renderer with a pinhole lens and footprint antialiasing.
    pub const EXACT: Self = Self::Exact(ExactOptions {
        response: Response::Ray,
        antialias: Antialias::Footprint,
        lens: Lens::Pinhole,
    });

    /// Returns the renderer without its settings.
    pub fn renderer(self) -> Renderer {
        match self {
            Self::Projected => Renderer::Projected,
            Self::Exact(_) => Renderer::Exact,
        }
    }

    /// Camera projection model; always a pinhole for the projected renderer.
    pub fn lens(self) -> Lens {
        match self {
            Self::Projected => Lens::Pinhole,
            Self::Exact(exact) => exact.lens,
        }
    }
}

impl From<Renderer> for RenderMethod {
    /// Returns the renderer with the settings used for measured images.
    fn from(renderer: Renderer) -> Self {
        match renderer {
            Renderer::Projected => Self::PROJECTED,
            Renderer::Exact => Self::EXACT,
        }
    }
}

/// Exposure used to display a scene that was recorded with automatic exposure.
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
    /// Distance of the splat's centre from the camera, mapped from `[near, far]` (world units) to the
    /// colours of [`super::finish::ramp`].
    Depth([f32; 2]),
    /// World direction `n` of the splat's shortest axis, turned towards the camera, shown as the colour
    /// `½ + ½·n`.
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
    /// Shows splats as stored.
    pub const PLAIN: Self = Self { scale: 1.0, opacity_cut: 0.0, paint: Paint::Stored };

    /// Returns a splat's standard deviations as drawn, in world units: multiplied by [`Self::scale`] and
    /// raised to at least [`scale_floor`] (`rendering.md`, Conventions).
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
    /// Near plane in world units. Splats with a view depth `z ≤ near` (fisheye: distance `≤ near`) of
    /// the centre are dropped. Negative values count as 0.
    pub near: f64,
    /// Renderer and its settings.
    pub method: RenderMethod,
    /// Display settings of all splats.
    pub style: DisplayStyle,
    /// Exposure of the splats.
    pub exposure_mode: Exposing,
}

impl RenderOptions {
    /// Returns the settings of measured images: near plane 0.2 (world units), unmodified splats, and
    /// the exposure recorded by the cameras.
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

    /// Returns the settings of the published renderers: as [`Self::evaluation`], with neutral exposure, and
    /// for [`Renderer::Exact`] with [`Response::Line`] and [`Antialias::Reference`].
    pub fn published(renderer: Renderer, background: [f32; 3]) -> Self {
        let method = match renderer {
            Renderer::Projected => RenderMethod::PROJECTED,
            Renderer::Exact => RenderMethod::Exact(ExactOptions {
                response: Response::Line,
                antialias: Antialias::Reference,
                lens: Lens::Pinhole,
            }),
        };
        // Published models record no exposure.
        let exposing = Exposing::Neutral;
        Self { exposure_mode: exposing, ..Self::evaluation(method, background) }
    }

    /// Returns the settings of an interactive view: neutral exposure, and a near plane that shrinks
    /// with `scene_radius` (world units).
    pub fn viewport(method: RenderMethod, background: [f32; 3], scene_radius: f64) -> Self {
        // A small scene would lie before the fixed near plane and be black.
        let near = EVALUATION_NEAR.min(VIEWPORT_NEAR_SHARE * scene_radius);
        // No exposure is known away from the photographs, and brightness must not change with motion.
        let exposing = Exposing::Neutral;
        Self { near, exposure_mode: exposing, ..Self::evaluation(method, background) }
    }
}

/// Near plane for evaluation, in world units. A splat whose centre has `z ≤ 0.2` is dropped, as in
/// the reference renderer (`rendering.md`, Conventions).
pub const EVALUATION_NEAR: f64 = 0.2;

/// Near plane of the viewport as a fraction of the scene radius (`rendering.md`, Conventions). The
/// viewport uses [`EVALUATION_NEAR`] if that is smaller.
pub const VIEWPORT_NEAR_SHARE: f64 = 0.005;

/// Low-pass variance in px², added to both diagonal entries of the projected covariance
/// (`rendering.md`, Projected renderer).
pub const LOW_PASS_PX2: f64 = 0.3;

/// Margin around the image as a fraction of half its width or height. Beyond the margin, the Jacobian
/// is evaluated at clamped tangents `x/z`, `y/z` (`rendering.md`, Projected renderer).
pub const FRUSTUM_MARGIN: f64 = 0.3;

/// Returns the lower and upper limit of `x/z` and `y/z` between which the Jacobian is evaluated at the
/// splat's centre.
pub(super) fn tangent_range(k: &Intrinsics) -> [DVec2; 2] {
    let (focal, principal) = (DVec2::new(k.fx, k.fy), DVec2::new(k.cx, k.cy));
    let size = DVec2::new(k.width.into(), k.height.into());
    let margin = FRUSTUM_MARGIN * 0.5 * size / focal;
    [-principal / focal - margin, (size - principal) / focal + margin]
}

/// Maximum alpha of one splat in one pixel (`rendering.md`, Projected renderer).
pub const ALPHA_CAP: f64 = 0.99;

/// Minimum alpha: smaller values are skipped (`rendering.md`, Projected renderer).
pub const ALPHA_CUT: f64 = 1.0 / 255.0;

/// Minimum transmittance. Blending of a pixel stops before the splat that would take its transmittance
/// below this value (`rendering.md`, Blending).
pub const TRANSMITTANCE_STOP: f64 = 1e-4;

/// Side length of a tile in pixels (`rendering.md`, CPU renderer).
pub const TILE: usize = 16;

/// Floor (lower limit) of a splat's scales, as a fraction of `max(1, largest scale)`. The floor is also
/// limited by [`MAX_SCALE_FLOOR_RATIO`] (`rendering.md`, Conventions).
pub const SCALE_FLOOR: f64 = 1e-6;

/// Upper limit of the floor of a splat's scales, as a fraction of the splat's largest scale. Keeps flat
/// splats flat in scenes with small world units.
pub const MAX_SCALE_FLOOR_RATIO: f64 = 1e-4;

/// Minimum scale in world units; smaller scales are raised to this value.
pub const POINT_SCALE: f64 = 1e-12;

/// Returns the floor (lower limit) of a splat's scales, in world units; `largest` is the splat's largest
/// scale.
pub fn scale_floor(largest: f64) -> f64 {
    (SCALE_FLOOR * largest.max(1.0)).min(MAX_SCALE_FLOOR_RATIO * largest).max(POINT_SCALE)
}

/// Returns a near plane, in world units, that scales with the world unit of the scene.
///
/// `nearest` is the distance of the nearest splats, excluding outliers, in world units. The result is
/// [`EVALUATION_NEAR`] times the largest power of ten that keeps it at or below half of `nearest`.
/// Measured images thus do not depend on the world unit. For rooms and objects in metres the result is
/// [`EVALUATION_NEAR`] itself.
pub fn near_plane_for(nearest: f64) -> f64 {
    let decades = (0.5 * nearest / EVALUATION_NEAR).log10().floor();
    // `log10` is not finite for 0 and NaN for negative distances.
    let is_usable = nearest > 0.0 && decades.abs() < 30.0;
    EVALUATION_NEAR * if is_usable { 10f64.powi(decades as i32) } else { 1.0 }
}

/// Variance in px² added by [`super::Antialias::Footprint`] (`rendering.md`, Antialiasing).
pub const FOOTPRINT_PX2: f64 = 0.3;

/// Variance in world units² added by the published exact renderer (`rendering.md`, Antialiasing).
pub const REFERENCE_VARIANCE: f64 = 1e-7;

impl Lens {
    /// Returns the ray in camera axes through a continuous image position in pixels. The ray has
    /// `z = 1` for a pinhole and unit length for a fisheye. `None` beyond the fisheye's field of view
    /// (`rendering.md`, Wide views and fisheye).
    pub fn ray(self, k: &Intrinsics, position: DVec2) -> Option<DVec3> {
        let offset = (position - DVec2::new(k.cx, k.cy)) / DVec2::new(k.fx, k.fy);
        match self {
            Self::Pinhole => Some(offset.extend(1.0)),
            Self::Fisheye => {
                let angle = offset.length();
                // sin(θ)/θ tends to 1 on the axis, where the division would give NaN.
                let sinc = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
                (angle <= PI).then(|| (offset * sinc).extend(angle.cos()))
            }
        }
    }

    /// Projects a point in camera axes to a continuous image position in pixels. `None` outside the
    /// field of view or if the position is not finite.
    pub fn project(self, k: &Intrinsics, point: DVec3) -> Option<DVec2> {
        let offset = match self {
            Self::Pinhole if point.z > 0.0 => point.truncate() / point.z,
            Self::Pinhole => return None,
            Self::Fisheye => {
                let across = point.truncate();
                let angle = across.length().atan2(point.z);
                across.try_normalize().map_or(DVec2::ZERO, |direction| direction * angle)
            }
        };
        let position = offset * DVec2::new(k.fx, k.fy) + DVec2::new(k.cx, k.cy);
        // Non-finite positions would be drawn as lines across the image.
        position.is_finite().then_some(position)
    }
}

#[cfg(test)]
mod lens_tests {
    use super::*;

    #[test]
    fn a_fisheye_pixel_is_an_angle() {
        let k = Intrinsics { width: 400, height: 300, fx: 100.0, fy: 100.0, cx: 0.5, cy: 100.5 };
        let ray = |column: f64| Lens::Fisheye.ray(&k, DVec2::new(column + 0.5, 100.5));
        assert_eq!(ray(0.0), Some(DVec3::Z));
        assert!((ray(157.0).unwrap() - DVec3::X).length() < 1e-3);
        assert!(ray(314.0).is_some() && ray(315.0).is_none());
    }

    #[test]
    fn points_along_a_ray_are_seen_where_it_starts() {
        let k = Intrinsics { width: 90, height: 60, fx: 25.0, fy: 27.0, cx: 44.0, cy: 31.0 };
        for lens in [Lens::Pinhole, Lens::Fisheye] {
            for position in [DVec2::new(44.0, 31.0), DVec2::new(3.5, 50.5), DVec2::new(80.0, 1.0)] {
                let ray = lens.ray(&k, position).unwrap();
                let seen = lens.project(&k, ray * 3.7).unwrap();
                assert!((seen - position).length() < 1e-9, "{lens} {position} {seen}");
            }
        }
        assert_eq!(Lens::Pinhole.project(&k, DVec3::new(1.0, 0.0, -1.0)), None);
        let behind = Lens::Fisheye.project(&k, DVec3::new(1e-3, 0.0, -1.0)).unwrap();
        assert!((behind.x - 44.0 - 25.0 * PI).abs() < 0.1);
        assert_eq!(Lens::Fisheye.ray(&k, DVec2::new(44.0 + 25.0 * 3.2, 31.0)), None);
    }
}
