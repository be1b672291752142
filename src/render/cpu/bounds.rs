//! Image bounds of an ellipsoid seen through a pinhole or a fisheye (`rendering.md`, Tight bounds).

use super::record::Rect;
use super::view::{CameraSplat, CpuView};
use crate::render::options::Response;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Returns the tight bounding box, in pixels, of a splat's ellipsoid seen through a pinhole.
/// `extent_squared` is the squared Mahalanobis radius of the ellipsoid, at which alpha equals the alpha
/// cut. `None` if the box contains no pixel centre of the image.
pub(super) fn pinhole(
    view: &CpuView,
    placed: &CameraSplat,
    extent_squared: f64,
    response: Response,
) -> Option<Rect> {
    let scaled = placed.axes * DMat3::from_diagonal(placed.scale * extent_squared.sqrt());
    // k²·S consists of the dot products of these rows.
    let [x, y, z] = [scaled.row(0), scaled.row(1), scaled.row(2)];
    let (xx, yy, zz) = (x.length_squared(), y.length_squared(), z.length_squared());
    let (m, k) = (placed.m, &view.intrinsics);
    // The whole line through a pixel also meets parts of the ellipsoid behind the camera.
    if response == Response::Line && zz >= m.z * m.z {
        return view.clip(DVec2::ZERO, DVec2::INFINITY);
    }
    let (x_lo, x_hi) = tangent_range(m.x, m.z, xx, x.dot(z), zz);
    let (y_lo, y_hi) = tangent_range(m.y, m.z, yy, y.dot(z), zz);
    let lo = DVec2::new(k.fx * x_lo + k.cx, k.fy * y_lo + k.cy);
    let hi = DVec2::new(k.fx * x_hi + k.cx, k.fy * y_hi + k.cy);
    view.pixels(lo, hi)
}

/// Returns the range of `x/z` over the part of an ellipse in front of the camera. The ellipse is the
/// projection of an ellipsoid to the x-z plane. Its centre is `m = (x, z)` and its matrix
/// `k²S = (xx, xz, zz)`. The ends of the range are the roots of `T₂₂u² − 2T₀₂u + T₀₀` with
/// `T = k²S − m mᵀ`.
fn tangent_range(x: f64, z: f64, xx: f64, xz: f64, zz: f64) -> (f64, f64) {
    let (t00, t02, t22) = (xx - x * x, xz - x * z, zz - z * z);
    // Expanded form of T₀₂² − T₂₂T₀₀, without the terms that cancel.
    let disc = zz * x * x - 2.0 * xz * x * z + xx * z * z - (xx * zz - xz * xz);
    // Unbounded: the splat covers some part of every direction, and the exact test per pixel decides.
    if disc <= 0.0 || t22 == 0.0 {
        return (f64::NEG_INFINITY, f64::INFINITY); // the camera is in the shadow on this plane
    }
    let q = t02 + disc.sqrt().copysign(t02);
    // Both roots by division: a difference would cancel for one of them.
    let (a, b) = (q / t22, t00 / q);
    let (r0, r1) = (a.min(b), a.max(b));
    // Entirely in front of the camera's plane: both tangents bound it.
    if t22 < 0.0 {
        (r0, r1)
    // It crosses that plane, so the range is open on one side.
    } else if x - xz / zz * z > 0.0 {
        (r1, f64::INFINITY)
    } else {
        (f64::NEG_INFINITY, r0)
    }
}

/// Returns a bounding box, in pixels, of a splat's ellipsoid seen through a fisheye; the box is not
/// tight. `extent_squared` is the squared Mahalanobis radius of the ellipsoid, at which alpha equals the
/// alpha cut. `None` if the box contains no pixel centre of the image.
///
/// The ellipsoid is projected from the camera onto a plane. This plane touches the unit sphere around
/// the camera in the direction of the splat's centre. A rectangle with one side along increasing angle
/// `θ` from the optical axis contains the projection. Straight lines in the plane are great circles on
/// the sphere. So along a side of the rectangle, `θ` and the azimuth have their extrema at its ends or
/// its midpoint (see [`shadow_bounds`]).
pub(super) fn fisheye(
    view: &CpuView,
    placed: &CameraSplat,
    extent_squared: f64,
    response: Response,
) -> Option<Rect> {
    let (k, reach) = (&view.intrinsics, placed.m.length());
    let ahead = placed.m / reach;
    let azimuth = ahead.y.atan2(ahead.x);
    let outwards = DVec2::from_angle(azimuth);
    let tangential = DVec3::new(-outwards.y, outwards.x, 0.0);
    let radial = tangential.cross(ahead);
    let scaled = placed.axes * DMat3::from_diagonal(placed.scale * extent_squared.sqrt());
    let [r, t, m] = [radial, tangential, ahead].map(|axis| scaled.transpose_mul_vec3(axis));
    let mm = m.length_squared();
    // The whole line through a pixel also meets the opposite direction.
    if mm >= reach * reach || response == Response::Line {
        return view.clip(DVec2::ZERO, DVec2::INFINITY);
    }
    let range = |side: DVec3| tangent_range(0.0, reach, side.length_squared(), side.dot(m), mm);
    let theta = ahead.truncate().length().atan2(ahead.z);
    let (lo, hi) = shadow_bounds([theta, azimuth], range(r), range(t));
    let focal = DVec2::new(k.fx, k.fy);
    let principal = DVec2::new(k.cx, k.cy);
    view.pixels(lo * focal + principal, hi * focal + principal)
}

/// Returns the bounding box, in an equidistant fisheye image, of a rectangle in a plane that touches the
/// unit sphere. The point of contact is at the angle `theta` from the optical axis and at the given
/// `azimuth`. The box is in radians from the principal point.
///
/// The rectangle extends over the range `radial` along increasing `θ` and over the range `tangential`
/// along increasing azimuth.
fn shadow_bounds(
    [theta, azimuth]: [f64; 2],
    radial: (f64, f64),
    tangential: (f64, f64),
) -> (DVec2, DVec2) {
    let (sin, cos) = theta.sin_cos();
    let (mut inner, mut outer) = (f64::INFINITY, 0.0f64);
    // Azimuths are relative to the centre's, so that a box across ±π remains one interval.
    let (mut first, mut last, mut holds_axis) = (0.0f64, 0.0f64, false);
    for a in [radial.0, radial.1] {
        let (out, ahead) = (sin + a * cos, cos - a * sin);
        // The rectangle reaches or crosses the axis: all azimuths are possible.
        holds_axis |= out <= 0.0;
        // Midpoints count too: along a great circle the angle to the axis has its minimum there,
        // not at a corner.
        for b in [tangential.0, 0.0, tangential.1] {
            let theta = out.hypot(b).atan2(ahead);
            inner = inner.min(theta);
            outer = outer.max(theta);
            first = first.min(b.atan2(out));
            last = last.max(b.atan2(out));
        }
    }
    if holds_axis {
        // Beyond the direction opposite to the axis, the corners do not bound the angle.
        let outer = if cos < 0.0 { PI } else { outer };
        return (DVec2::splat(-outer), DVec2::splat(outer));
    }
    sector_box(azimuth + first, azimuth + last, inner, outer)
}

/// Returns the lower and upper corner of the bounding box of an annular sector. The sector has the
/// azimuths `first..=last` and the radii `inner..=outer`.
fn sector_box(first: f64, last: f64, inner: f64, outer: f64) -> (DVec2, DVec2) {
    let (mut lo, mut hi) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let mut hold = |azimuth: f64, radius: f64| {
        let point = radius * DVec2::from_angle(azimuth);
        lo = lo.min(point);
        hi = hi.max(point);
    };
    for azimuth in [first, last] {
        hold(azimuth, inner);
        hold(azimuth, outer);
    }
    // The outer arc reaches farthest where it crosses a coordinate axis.
    let quarters = (first / FRAC_PI_2).ceil() as i32..=(last / FRAC_PI_2).floor() as i32;
    for quarter in quarters {
        hold(quarter as f64 * FRAC_PI_2, outer);
    }
    (lo, hi)
}
