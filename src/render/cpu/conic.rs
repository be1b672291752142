//! Response of a splat as a rational conic in its tangent plane (`rendering.md`, Rational
//! conic). Computed in f64 once per splat, so that the f32 inner loop starts from correctly rounded
//! values.

use super::view::CameraSplat;
use glam::{DVec2, DVec3};

/// Parametrised tangent plane of a splat, in camera axes.
pub(super) struct Tangent {
    /// Base point: the centre divided by its depth (pinhole) or distance (fisheye).
    pub x0: DVec3,
    /// Displacement per unit of each component of `δ`.
    pub steps: [DVec3; 2],
    /// Depth (pinhole) or distance (fisheye) of the centre, so that the centre is `reach·x0`.
    pub reach: f64,
}

/// Coefficients of `D²` in the tangent plane, see [`super::record`].
#[derive(Clone, Copy)]
pub(super) struct Conic {
    pub p_x: f64,
    pub p_y: f64,
    pub q_y: f64,
    pub half_l: DVec2,
    pub w: f64,
}

impl Conic {
    /// Computes `N = δᵀQδ` with `Q = reach²·BᵀB/|g₀|²` and `B = [A₁×g₀, A₂×g₀]`.
    pub(super) fn new(placed: &CameraSplat, tangent: &Tangent) -> Self {
        let white = Whitened::new(placed, tangent);
        let Whitened { g0, a, sharpness } = white;
        let b = [a[0].cross(g0), a[1].cross(g0)];
        let (gg, bb) = (g0.length_squared(), b[0].length_squared());
        let (per_g, per_b) = (gg.sqrt().recip(), bb.sqrt().recip());
        // |B₁×B₂|² = |g₀|²·(g₀·(A₁×A₂))². That triple product is det M times the one of x₀ and the steps.
        let steps = tangent.x0.dot(tangent.steps[0].cross(tangent.steps[1]));
        let volume = steps * sharpness.element_product();
        let z = tangent.reach;
        Self {
            p_x: z * bb * per_b * per_g,
            p_y: z * b[0].dot(b[1]) * per_b * per_g,
            q_y: z * volume * per_b,
            half_l: white.half_linear(),
            w: (z * z * gg).recip(),
        }
    }
}

/// Tangent plane in whitened coordinates `M = diag(1/s)·(RQ)ᵀ`, in standard deviations.
pub(super) struct Whitened {
    /// `M·x₀`
    g0: DVec3,
    /// `M·steps`
    a: [DVec3; 2],
    /// `1/s`
    sharpness: DVec3,
}

impl Whitened {
    pub(super) fn new(placed: &CameraSplat, tangent: &Tangent) -> Self {
        // The floor of the scales keeps this finite (`rendering.md`, Conventions).
        let sharpness = placed.scale.recip();
        let white = |v: DVec3| placed.axes.transpose_mul_vec3(v) * sharpness;
        Self { g0: white(tangent.x0), a: tangent.steps.map(white), sharpness }
    }

    /// `½ l` with `l = 2Aᵀg₀/|g₀|²`.
    pub(super) fn half_linear(&self) -> DVec2 {
        let Self { g0, a, .. } = self;
        DVec2::new(a[0].dot(*g0), a[1].dot(*g0)) / g0.length_squared()
    }
}
