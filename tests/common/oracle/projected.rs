//! The projected renderer (`rendering.md`, Projected renderer): splats with the covariance projected to the
//! image.

use super::Contribution;
use super::shade::Shade;
use super::splat::Placed;
use glam::{DMat2, DMat3, DVec2, DVec3};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::render::{ALPHA_CAP, FRUSTUM_MARGIN, LOW_PASS_PX2};

/// A splat projected to the image.
#[derive(Clone, Copy, Debug)]
pub(super) struct Projected {
    number: usize,
    /// View depth `z` of the mean.
    pub depth: f64,
    centre: DVec2,
    conic: DMat2,
    opacity: f64,
    shade: Shade,
    /// Shift of the point of maximum response, in camera axes, per pixel to the right and down.
    slide: [DVec3; 2],
}

impl Projected {
    /// `None` if the projected covariance is not an ellipse.
    pub(super) fn new(splat: &Placed, k: &Intrinsics) -> Option<Self> {
        let m = splat.mean;
        let (a, b) = (m.x / m.z, m.y / m.z);
        let clamp = |ratio: f64, principal: f64, size: u32, focal: f64| {
            let size = f64::from(size);
            let beyond = FRUSTUM_MARGIN * size / (2.0 * focal);
            ratio.max(-(principal / focal + beyond)).min((size - principal) / focal + beyond)
        };
        let a_clamped = clamp(a, k.cx, k.width, k.fx);
        let b_clamped = clamp(b, k.cy, k.height, k.fy);
        let j_x = DVec3::new(k.fx / m.z, 0.0, -k.fx * a_clamped / m.z);
        let j_y = DVec3::new(0.0, k.fy / m.z, -k.fy * b_clamped / m.z);
        let variances = DMat3::from_diagonal(splat.scale * splat.scale);
        let s = splat.axes * variances * splat.axes.transpose();
        let xx = j_x.dot(s * j_x) + LOW_PASS_PX2;
        let xy = j_x.dot(s * j_y);
        let yy = j_y.dot(s * j_y) + LOW_PASS_PX2;
        let det = xx * yy - xy * xy;
        if det <= 0.0 || !det.is_finite() {
            return None;
        }
        let centre = DVec2::new(k.fx * a + k.cx, k.fy * b + k.cy);
        Some(Self {
            number: splat.number,
            depth: m.z,
            centre,
            conic: DMat2::from_cols(DVec2::new(yy, -xy), DVec2::new(-xy, xx)) * det.recip(),
            opacity: splat.opacity,
            shade: splat.shade,
            slide: slide(splat, k),
        })
    }

    /// Contribution at a point of the image; `None` if rounding makes the distance imaginary.
    pub(super) fn at(&self, point: DVec2) -> Option<Contribution> {
        let offset = point - self.centre;
        let exponent = -0.5 * offset.dot(self.conic * offset);
        (exponent <= 0.0).then(|| Contribution {
            number: self.number,
            alpha: ALPHA_CAP.min(self.opacity * exponent.exp()),
            depth: self.depth,
            color: self.shade.at(self.slide[0] * offset.x + self.slide[1] * offset.y),
        })
    }
}

/// Derivatives with respect to the pixel of the point of maximum response `s* = t*·d`, `t* = (g·p)/(g·g)`, at
/// the ray `d = m/z` through the mean (`rendering.md`, Native appearance). The low-pass filter is left out,
/// since it widens the footprint in the image, not the splat.
fn slide(splat: &Placed, k: &Intrinsics) -> [DVec3; 2] {
    let whiten = |v: DVec3| (splat.axes.transpose() * v) / splat.scale;
    let ray = splat.mean / splat.mean.z;
    let (g, p) = (whiten(ray), whiten(splat.mean));
    [DVec3::X / k.fx, DVec3::Y / k.fy].map(|turn| {
        let dg = whiten(turn);
        let (dot, square) = (g.dot(p), g.dot(g));
        let t_change = (dg.dot(p) * square - dot * 2.0 * g.dot(dg)) / (square * square);
        ray * t_change + turn * (dot / square)
    })
}
