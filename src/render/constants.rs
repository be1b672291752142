//! Constants shared by all renderers (`rendering.md`, Conventions). If the CPU and GPU renderers disagreed on
//! one, their images would differ by more than rounding.

/// Near plane for evaluation, in world units. A splat whose centre has `z ≤ 0.2` is dropped, as in
/// the reference renderer (`rendering.md`, Conventions).
pub const EVALUATION_NEAR: f64 = 0.2;

/// Near plane of the viewport as a fraction of the scene radius. Applies where that is nearer than
/// [`EVALUATION_NEAR`] (`rendering.md`, Conventions).
pub const VIEWPORT_NEAR_SHARE: f64 = 0.005;

/// Low-pass variance in px², added to both diagonal entries of the projected covariance
/// (`rendering.md`, Projected renderer).
pub const LOW_PASS_PX2: f64 = 0.3;

/// Margin around the image in half image widths (heights). Beyond it the Jacobian is evaluated at the
/// clamped tangent `x/z`, `y/z` (`rendering.md`, Projected renderer).
pub const FRUSTUM_MARGIN: f64 = 0.3;

/// Maximum alpha of one splat in one pixel (`rendering.md`, Projected renderer).
pub const ALPHA_CAP: f64 = 0.99;

/// Minimum alpha: smaller values are skipped (`rendering.md`, Projected renderer).
pub const ALPHA_CUT: f64 = 1.0 / 255.0;

/// Minimum transmittance. Blending of a pixel stops before the splat that would take its transmittance
/// below this value (`rendering.md`, Blending).
pub const TRANSMITTANCE_STOP: f64 = 1e-4;

/// Side length of a tile in pixels (`rendering.md`, CPU renderer).
pub const TILE: usize = 16;

/// Floor of the scales as a fraction of `max(1, largest scale)`, limited by [`FLATTEST`]
/// (`rendering.md`, Conventions).
pub const SCALE_FLOOR: f64 = 1e-6;

/// Upper limit of the floor as a fraction of the largest scale. Keeps flat splats flat in scenes with
/// small world units.
pub const MAX_SCALE_FLOOR_RATIO: f64 = 1e-4;

/// Minimum scale in world units. Splats of zero size are raised to it.
pub const POINT_SCALE: f64 = 1e-12;

/// Floor of a splat's scales, in world units; `largest` is the splat's largest scale.
pub fn scale_floor(largest: f64) -> f64 {
    (SCALE_FLOOR * largest.max(1.0)).min(MAX_SCALE_FLOOR_RATIO * largest).max(POINT_SCALE)
}

/// Near plane that follows the unit of a scene, in world units.
///
/// `nearest` is the distance of the nearest splats without outliers, in world units. The result is
/// [`EVALUATION_NEAR`] times the largest power of ten that keeps it at or below half of `nearest`.
/// Measured images thus do not depend on the world unit. For rooms and objects in metres the result
/// is [`EVALUATION_NEAR`] itself.
pub fn near_plane_for(nearest: f64) -> f64 {
    let decades = (0.5 * nearest / EVALUATION_NEAR).log10().floor();
    let is_usable = nearest > 0.0 && decades.abs() < 30.0;
    EVALUATION_NEAR * if is_usable { 10f64.powi(decades as i32) } else { 1.0 }
}

/// Variance in px² added by [`super::Antialias::Footprint`] (`rendering.md`, Antialiasing).
pub const FOOTPRINT_PX2: f64 = 0.3;

/// Variance in world units² added by the published exact renderer (`rendering.md`, Antialiasing).
pub const REFERENCE_VARIANCE: f64 = 1e-7;
