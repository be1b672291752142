//! Records of the exact renderer: rational conics through a pinhole or a fisheye
//! (`rendering.md`, Exact renderer).

use super::bounds;
use super::projected::{Conic, Tangent};
use super::record::TangentFrame;
use super::shade::ImageSplat;
use super::view::{CameraSplat, CpuView};
use crate::math::camera::Intrinsics;
use crate::render::options::ExactOptions;
use glam::{DVec2, DVec3};

/// Projects a splat through a pinhole; `None` if it is invisible.
pub(super) fn pinhole(
    view: &CpuView,
    placed: CameraSplat,
    exact: ExactOptions,
) -> Option<ImageSplat> {
    let k = &view.intrinsics;
    let placed = placed.apply_antialiasing(exact, k)?;
    let extent_squared = placed.extent_squared();
    let rect = bounds::pinhole(view, &placed, extent_squared, exact.response)?;
    let tangent = pinhole_tangent(&placed, k);
    let conic = Conic::new(&placed, &tangent);
    Some(ImageSplat {
        centre: DVec2::new(k.fx * tangent.x0.x + k.cx, k.fy * tangent.x0.y + k.cy),
        conic,
        linear: conic.half_l,
        reach: tangent.reach,
        key: placed.m.length(),
        opacity: placed.opacity,
        extent_squared,
        rect,
    })
}

/// Projects a splat through a fisheye, with its tangent frame; `None` if it is invisible.
pub(super) fn fisheye(
    view: &CpuView,
    placed: CameraSplat,
    exact: ExactOptions,
) -> Option<(ImageSplat, TangentFrame)> {
    let placed = placed.apply_antialiasing(exact, &view.intrinsics)?;
    let extent_squared = placed.extent_squared();
    let rect = bounds::fisheye(view, &placed, extent_squared, exact.response)?;
    let tangent = fisheye_tangent(&placed);
    let conic = Conic::new(&placed, &tangent);
    let drawn = ImageSplat {
        // Fisheye offsets are direction cosines in the tangent frame; a centre in pixels does not
        // exist.
        centre: DVec2::ZERO,
        conic,
        linear: conic.half_l,
        reach: tangent.reach,
        key: tangent.reach,
        opacity: placed.opacity,
        extent_squared,
        rect,
    };
    let rows = [tangent.steps[0], tangent.steps[1], tangent.x0];
    Some((drawn, TangentFrame { rows: rows.map(|row| row.as_vec3().to_array()) }))
}

/// Tangent plane `z = 1`, with `δ` in pixels.
pub(super) fn pinhole_tangent(placed: &CameraSplat, k: &Intrinsics) -> Tangent {
    Tangent {
        x0: placed.m / placed.m.z,
        steps: [DVec3::X / k.fx, DVec3::Y / k.fy],
        reach: placed.m.z,
    }
}

/// Plane that touches the unit sphere in the direction of the centre; `δ` in direction cosines.
pub(super) fn fisheye_tangent(placed: &CameraSplat) -> Tangent {
    let reach = placed.m.length();
    let x0 = placed.m / reach;
    let (e1, e2) = x0.any_orthonormal_pair();
    Tangent { x0, steps: [e1, e2], reach }
}
