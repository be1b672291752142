//! Records of the projected renderer (`rendering.md`, Projected renderer).

use super::exact::pinhole_tangent;
use super::record::Gradient;
use super::shade::{ColorGradient, ImageSplat};
use super::view::{CameraSplat, CpuView};
use crate::render::options::LOW_PASS_PX2;
use glam::{DVec2, DVec3};

/// Projected covariance in px², including the low-pass.
#[derive(Clone, Copy)]
struct Covariance2 {
    xx: f64,
    xy: f64,
    yy: f64,
    det: f64,
}

/// Projects a splat to the image; `None` if it is invisible.
pub(super) fn draw(view: &CpuView, placed: &CameraSplat) -> Option<ImageSplat> {
    let m = placed.m;
    let tangent = m.truncate() / m.z;
    let k = &view.intrinsics;
    let centre = DVec2::new(k.fx * tangent.x + k.cx, k.fy * tangent.y + k.cy);
    let axes = ImageAxes::new(view, placed);
    let covariance = Covariance2::new(&axes);
    let extent_squared = placed.extent_squared();
    // Bounding box of the ellipse at the alpha cut: nothing visible is lost.
    let half = (extent_squared * DVec2::new(covariance.xx, covariance.yy)).map(f64::sqrt);
    let rect = view.pixels(centre - half, centre + half)?;
    let conic = covariance.conic();
    let opacity = placed.opacity;
    let linear = covariance.solve(axes.depth_covariance(placed));
    Some(ImageSplat { centre, conic, linear, reach: m.z, key: m.z, opacity, extent_squared, rect })
}

/// Returns the colour gradient in the image, linearised at the splat's centre. The largest response on
/// a ray `x` is at `τ·x` with `τ ≈ 1 − ½ l·δ` (symbols as in [`super::record`]). The gradient along the
/// line of sight is therefore added to the gradient across it.
pub(super) fn gradient(shade: &ColorGradient, placed: &CameraSplat, view: &CpuView) -> Gradient {
    let tangent = pinhole_tangent(placed, &view.intrinsics);
    let half_linear = Whitened::new(placed, &tangent).half_linear().as_vec2();
    let mut gradient = shade.gradient(&tangent);
    for (across, along) in gradient.across.iter_mut().zip(gradient.along) {
        across[0] -= half_linear.x * along;
        across[1] -= half_linear.y * along;
    }
    gradient.along = [0.0; 3];
    gradient
}

/// Principal axes of a splat, scaled by their standard deviations and projected to the image, px. They
/// are the rows of `J R Q diag(s)` with the Jacobian `J` of the projection at the splat's centre.
struct ImageAxes([DVec3; 2]);

impl ImageAxes {
    fn new(view: &CpuView, placed: &CameraSplat) -> Self {
        let (k, z) = (&view.intrinsics, placed.m.z);
        let tangent = placed.m.truncate() / z;
        // Only the Jacobian's point is clamped, not the centre. Far outside the image, the linearisation
        // would enlarge splats without bound (`rendering.md`, Projected renderer).
        let clamped = tangent.max(view.tangent_lo).min(view.tangent_hi);
        let across = DVec3::new(k.fx / z, 0.0, -k.fx * clamped.x / z);
        let down = DVec3::new(0.0, k.fy / z, -k.fy * clamped.y / z);
        let scaled = |row: DVec3| placed.axes.transpose_mul_vec3(row) * placed.scale;
        Self([scaled(across), scaled(down)])
    }

    /// Returns the covariance of depth and image position, px times world units.
    fn depth_covariance(&self, placed: &CameraSplat) -> DVec2 {
        let depth = placed.axes.row(2) * placed.scale;
        DVec2::new(depth.dot(self.0[0]), depth.dot(self.0[1]))
    }
}

/// Returns a splat's area in the image without the low-pass, as a fraction of the area with it.
pub(super) fn area_share(view: &CpuView, placed: &CameraSplat) -> f64 {
    let axes = ImageAxes::new(view, placed);
    let [w_x, w_y] = axes.0;
    w_x.cross(w_y).length() / Covariance2::new(&axes).det.sqrt()
}

/// Returns the squared Mahalanobis distance of an image position from the projected splat. The position
/// is in pixels.
pub(in crate::render) fn distance_squared(
    view: &CpuView,
    placed: &CameraSplat,
    position: DVec2,
) -> f64 {
    let k = &view.intrinsics;
    let centre = placed.m.truncate() / placed.m.z * DVec2::new(k.fx, k.fy) + DVec2::new(k.cx, k.cy);
    let apart = position - centre;
    apart.dot(Covariance2::new(&ImageAxes::new(view, placed)).solve(apart))
}

impl Covariance2 {
    /// Computes the covariance `J S Jᵀ + 0.3·I` from the projected axes.
    fn new(axes: &ImageAxes) -> Self {
        let [w_x, w_y] = axes.0;
        let (xx, yy) = (w_x.length_squared(), w_y.length_squared());
        // Lagrange's identity: as a sum of positive terms, the determinant does not cancel.
        let det = w_x.cross(w_y).length_squared() + LOW_PASS_PX2 * (xx + yy + LOW_PASS_PX2);
        Self { xx: xx + LOW_PASS_PX2, yy: yy + LOW_PASS_PX2, xy: w_x.dot(w_y), det }
    }

    /// Returns the coefficients of the squared Mahalanobis distance:
    /// `D² = (√(yy/det)·δx − xy/√(yy·det)·δy)² + δy²/yy`.
    fn conic(self) -> Conic {
        let per_root = (self.yy * self.det).sqrt().recip();
        Conic {
            p_x: self.yy * per_root,
            p_y: -self.xy * per_root,
            q_y: self.yy.sqrt().recip(),
            w: 0.0,
        }
    }

    /// Returns the inverse covariance times `v`.
    fn solve(&self, v: DVec2) -> DVec2 {
        DVec2::new(self.yy * v.x - self.xy * v.y, self.xx * v.y - self.xy * v.x) / self.det
    }
}

/// Parametrised tangent plane of a splat, in camera axes.
pub(super) struct Tangent {
    /// Base point: the centre divided by its depth (pinhole) or distance (fisheye).
    pub x0: DVec3,
    /// Displacement in the plane per unit of each component of the offset `δ`.
    pub steps: [DVec3; 2],
    /// Depth (pinhole) or distance (fisheye) of the centre, so that the centre is `reach·x0`.
    pub reach: f64,
}

/// Coefficients of the squared Mahalanobis distance `D²` of a ray, given by its offset in the tangent
/// plane (see [`super::record`]).
#[derive(Clone, Copy)]
pub(super) struct Conic {
    pub p_x: f64,
    pub p_y: f64,
    pub q_y: f64,
    pub w: f64,
}

impl Conic {
    /// Computes the conic of a splat: its numerator is `N = δᵀQδ` with `Q = reach²·BᵀB/|g₀|²` and
    /// `B = [A₁×g₀, A₂×g₀]`. Also returns `½ l`, half the linear term of the denominator.
    pub(super) fn new(placed: &CameraSplat, tangent: &Tangent) -> (Self, DVec2) {
        let white = Whitened::new(placed, tangent);
        let Whitened { g0, a, sharpness } = white;
        let b = [a[0].cross(g0), a[1].cross(g0)];
        let (gg, bb) = (g0.length_squared(), b[0].length_squared());
        let (per_g, per_b) = (gg.sqrt().recip(), bb.sqrt().recip());
        // |B₁×B₂|² = |g₀|²·(g₀·(A₁×A₂))². That triple product is det M times the one of x₀ and the steps.
        let steps = tangent.x0.dot(tangent.steps[0].cross(tangent.steps[1]));
        let volume = steps * sharpness.element_product();
        let z = tangent.reach;
        let conic = Self {
            p_x: z * bb * per_b * per_g,
            p_y: z * b[0].dot(b[1]) * per_b * per_g,
            q_y: z * volume * per_b,
            w: (z * z * gg).recip(),
        };
        (conic, white.half_linear())
    }
}

/// Tangent plane in whitened coordinates: multiplied by `M = diag(1/s)·(RQ)ᵀ`, so that lengths are in
/// standard deviations.
struct Whitened {
    /// Base point `M·x₀`.
    g0: DVec3,
    /// Displacements `M·steps`.
    a: [DVec3; 2],
    /// Reciprocal standard deviations `1/s`.
    sharpness: DVec3,
}

impl Whitened {
    fn new(placed: &CameraSplat, tangent: &Tangent) -> Self {
        // The floor of the scales keeps this finite (`rendering.md`, Conventions).
        let sharpness = placed.scale.recip();
        let white = |v: DVec3| placed.axes.transpose_mul_vec3(v) * sharpness;
        Self { g0: white(tangent.x0), a: tangent.steps.map(white), sharpness }
    }

    /// Returns `½ l`, half the linear term of the conic's denominator, with `l = 2Aᵀg₀/|g₀|²`.
    fn half_linear(&self) -> DVec2 {
        let Self { g0, a, .. } = self;
        DVec2::new(a[0].dot(*g0), a[1].dot(*g0)) / g0.length_squared()
    }
}
