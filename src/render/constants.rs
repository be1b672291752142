//! Numbers that every renderer shares (`rendering.md`, Conventions): the CPU and GPU renderers must agree on each
//! of them, or their images differ by more than rounding.

/// Near plane of the evaluation in world units: a splat whose centre has `z ≤ 0.2` is dropped, as
/// in the reference renderer (`rendering.md`, Conventions).
pub const EVALUATION_NEAR: f64 = 0.2;

/// Near plane of the viewport as a share of the scene's radius, where that is nearer than
/// [`EVALUATION_NEAR`] (`rendering.md`, Conventions).
pub const VIEWPORT_NEAR_SHARE: f64 = 0.005;

/// Variance in px² added to both axes of the projected covariance (`rendering.md`, Projected
/// renderer).
pub const LOW_PASS_PX2: f64 = 0.3;

/// The Jacobian is frozen at this many half image widths (heights) beyond the edge of the image,
/// in tangent space (`rendering.md`, Projected renderer).
pub const FRUSTUM_MARGIN: f64 = 0.3;

/// Largest alpha of one splat in one pixel (`rendering.md`, Projected renderer).
pub const ALPHA_CAP: f64 = 0.99;

/// Smaller alphas are skipped (`rendering.md`, Projected renderer).
pub const ALPHA_CUT: f64 = 1.0 / 255.0;

/// A pixel is finished before the splat that would take its transmittance below this
/// (`rendering.md`, Blending).
pub const TRANSMITTANCE_STOP: f64 = 1e-4;

/// Side of a tile in pixels (`rendering.md`, CPU renderer).
pub const TILE: usize = 16;

/// Scales are raised to this share of `max(1, largest scale)`, but by no more than [`FLATTEST`] says
/// (`rendering.md`, Conventions).
pub const SCALE_FLOOR: f64 = 1e-6;

/// Scales of this share of the largest stay as they are, however small the world's unit makes both.
pub const FLATTEST: f64 = 1e-4;

/// Scale of a point, world units: splats of no size at all are raised to it.
pub const POINT_SCALE: f64 = 1e-12;

/// Floor of a splat's scales whose largest is `largest`, world units.
pub fn scale_floor(largest: f64) -> f64 {
    (SCALE_FLOOR * largest.max(1.0)).min(FLATTEST * largest).max(POINT_SCALE)
}

/// Near plane of a view whose nearest splats, but for a few, are `nearest` away, world units: that of the
/// evaluation times the power of ten that leaves it at or below half of that distance. So measured pictures
/// do not depend on the world's unit, and those of rooms and objects in metres are what they are with
/// [`EVALUATION_NEAR`].
pub fn following_near(nearest: f64) -> f64 {
    let decades = (0.5 * nearest / EVALUATION_NEAR).log10().floor();
    let is_usable = nearest > 0.0 && decades.abs() < 30.0;
    EVALUATION_NEAR * if is_usable { 10f64.powi(decades as i32) } else { 1.0 }
}

/// Variance in px² that the exact renderer's footprint stands for (`rendering.md`, Antialiasing).
pub const FOOTPRINT_PX2: f64 = 0.3;

/// Variance in world units² that the published exact renderer adds (`rendering.md`, Antialiasing).
pub const REFERENCE_VARIANCE: f64 = 1e-7;
