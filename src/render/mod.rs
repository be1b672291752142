//! Splats to pixels: what every renderer agrees on (`rendering.md` (a) and (b)).
//!
//! Colours are sRGB-encoded and blended as encoded; alpha is premultiplied, so an image is
//! `C + T·background` with transmittance `T` and coverage `A = 1 − T`. Camera axes are OpenCV's and
//! pixel `(i, j)` has its centre at `(i + ½, j + ½)`.

pub mod cpu;
#[cfg(feature = "gui")]
pub mod gpu;

/// Near plane of the evaluation in world units: a splat whose centre has `z ≤ 0.2` is dropped, as
/// in the reference renderer (`rendering.md` (a)).
pub const EVALUATION_NEAR: f64 = 0.2;

/// Near plane of the viewport as a share of the scene's radius, where that is nearer than
/// [`EVALUATION_NEAR`] (`rendering.md` (a)).
pub const VIEWPORT_NEAR_SHARE: f64 = 0.005;

/// Variance in px² added to both axes of the projected covariance (`rendering.md` (b) 3).
pub const LOW_PASS_PX2: f64 = 0.3;

/// The Jacobian is frozen at this many half image widths (heights) beyond the edge of the image,
/// in tangent space (`rendering.md` (b) 2).
pub const FRUSTUM_MARGIN: f64 = 0.3;

/// Largest alpha of one splat in one pixel (`rendering.md` (b) 6).
pub const ALPHA_CAP: f64 = 0.99;

/// Smaller alphas are skipped (`rendering.md` (b) 6).
pub const ALPHA_CUT: f64 = 1.0 / 255.0;

/// A pixel is finished before the splat that would take its transmittance below this
/// (`rendering.md` (b) 8).
pub const TRANSMITTANCE_STOP: f64 = 1e-4;

/// Side of a tile in pixels (`rendering.md` (b)).
pub const TILE: usize = 16;

/// Scales are raised to this share of `max(1, largest scale)` (`rendering.md` (a)).
pub const SCALE_FLOOR: f64 = 1e-6;

/// Which pixels a splat may touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Support {
    /// Every pixel where its alpha passes [`ALPHA_CUT`]; nothing visible is lost.
    Alpha,
    /// The 16×16 tiles of a square of three standard deviations, as the reference renderer does:
    /// opaque splats lose their rim there. For comparisons of bits only.
    Tile3Sigma,
}

/// What a view needs besides splats and camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RenderOptions {
    /// sRGB-encoded colour behind the splats.
    pub background: [f32; 3],
    /// Splats whose centre has a view depth `z ≤ near` are dropped; world units. Negative values
    /// count as 0.
    pub near: f64,
    /// Which pixels a splat may touch.
    pub support: Support,
}

impl RenderOptions {
    /// The settings of measured images: near plane 0.2, full support.
    pub fn evaluation(background: [f32; 3]) -> Self {
        Self { background, near: EVALUATION_NEAR, support: Support::Alpha }
    }

    /// The settings of a view people move in: the near plane shrinks with small scenes, whose
    /// radius is in world units.
    pub fn viewport(background: [f32; 3], scene_radius: f64) -> Self {
        let near = EVALUATION_NEAR.min(VIEWPORT_NEAR_SHARE * scene_radius);
        Self { near, ..Self::evaluation(background) }
    }
}
