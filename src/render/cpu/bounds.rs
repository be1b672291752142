//! Which pixels an ellipsoid can reach through a pinhole or a fisheye (`rendering.md` (c)).

use super::record::Rect;
use super::view::{Placed, View};
use crate::render::Response;
use glam::{DMat3, DVec2};
use std::f64::consts::{FRAC_PI_2, PI};

/// Pixels that the ellipsoid of the alpha cut covers; tight through a pinhole.
pub(super) fn pinhole(
    view: &View,
    placed: &Placed,
    extent_squared: f64,
    response: Response,
) -> Option<Rect> {
    let scaled = placed.axes * DMat3::from_diagonal(placed.scale * extent_squared.sqrt());
    // k²·S: dot products of the rows.
    let [x, y, z] = [scaled.row(0), scaled.row(1), scaled.row(2)];
    let (xx, yy, zz) = (x.length_squared(), y.length_squared(), z.length_squared());
    let (m, k) = (placed.m, &view.intrinsics);
    // The line through a pixel also meets what lies behind the camera.
    if response == Response::Line && zz >= m.z * m.z {
        return view.clip(DVec2::ZERO, DVec2::INFINITY);
    }
    let (x_lo, x_hi) = tangent_range(m.x, m.z, xx, x.dot(z), zz);
    let (y_lo, y_hi) = tangent_range(m.y, m.z, yy, y.dot(z), zz);
    let lo = DVec2::new(k.fx * x_lo + k.cx, k.fy * y_lo + k.cy);
    let hi = DVec2::new(k.fx * x_hi + k.cx, k.fy * y_hi + k.cy);
    view.pixels(lo, hi)
}

/// Range of `x/z` over the part in front of the camera of an ellipsoid with centre `(x, z)` and
/// `k²S = (xx, xz, zz)` in that plane: the roots of `T₂₂u² − 2T₀₂u + T₀₀` of `T = k²S − m mᵀ`.
fn tangent_range(x: f64, z: f64, xx: f64, xz: f64, zz: f64) -> (f64, f64) {
    let (t00, t02, t22) = (xx - x * x, xz - x * z, zz - z * z);
    // T₀₂² − T₂₂T₀₀ without the terms that cancel.
    let disc = zz * x * x - 2.0 * xz * x * z + xx * z * z - (xx * zz - xz * xz);
    if disc <= 0.0 || t22 == 0.0 {
        return (f64::NEG_INFINITY, f64::INFINITY); // the camera is in the shadow on this plane
    }
    let q = t02 + disc.sqrt().copysign(t02);
    let (a, b) = (q / t22, t00 / q);
    let (r0, r1) = (a.min(b), a.max(b));
    if t22 < 0.0 {
        (r0, r1)
    } else if x - xz / zz * z > 0.0 {
        (r1, f64::INFINITY)
    } else {
        (f64::NEG_INFINITY, r0)
    }
}

/// Pixels of the box around the cone that holds the ellipsoid of the alpha cut.
pub(super) fn fisheye(
    view: &View,
    placed: &Placed,
    extent_squared: f64,
    response: Response,
) -> Option<Rect> {
    let (m, k) = (placed.m, &view.intrinsics);
    let sine = extent_squared.sqrt() * placed.scale.max_element() / m.length();
    // The line through a pixel also sees what lies opposite.
    if sine >= 1.0 || response == Response::Line {
        return view.clip(DVec2::ZERO, DVec2::INFINITY);
    }
    let half = sine.asin();
    let theta = m.truncate().length().atan2(m.z);
    let (inner, outer) = (theta - half, theta + half);
    // Around the axis or its opposite the cone reaches every azimuth.
    let (lo, hi) = if inner <= 0.0 || outer >= PI {
        (DVec2::splat(-outer.min(PI)), DVec2::splat(outer.min(PI)))
    } else {
        let spread = (sine / theta.sin()).min(1.0).asin();
        sector_box(m.y.atan2(m.x), spread, inner, outer)
    };
    let focal = DVec2::new(k.fx, k.fy);
    let principal = DVec2::new(k.cx, k.cy);
    view.pixels(lo * focal + principal, hi * focal + principal)
}

/// Box of the points at an azimuth within `spread` of `middle` and a radius from `inner` to `outer`.
fn sector_box(middle: f64, spread: f64, inner: f64, outer: f64) -> (DVec2, DVec2) {
    let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let mut hold = |azimuth: f64, radius: f64| {
        let point = radius * DVec2::from_angle(azimuth);
        lo = lo.min(point);
        hi = hi.max(point);
    };
    for azimuth in [middle - spread, middle + spread] {
        hold(azimuth, inner);
        hold(azimuth, outer);
    }
    // Where the outer arc crosses an axis it reaches farther than at its ends.
    let first = ((middle - spread) / FRAC_PI_2).ceil() as i32;
    let last = ((middle + spread) / FRAC_PI_2).floor() as i32;
    for quarter in first..=last {
        hold(quarter as f64 * FRAC_PI_2, outer);
    }
    (lo, hi)
}
