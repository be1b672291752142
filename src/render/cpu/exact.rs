//! Records of the exact renderer: rational conics through a pinhole or a fisheye
//! (`rendering.md`, Exact renderer).

use super::bounds;
use super::projected::{Conic, Tangent};
use super::shade::ImageSplat;
use super::view::{CameraSplat, CpuView};
use crate::math::camera::Intrinsics;
use crate::render::options::{ExactOptions, Lens};
use glam::{DVec2, DVec3};

/// Projects a splat through a pinhole or a fisheye. Returns the projected splat and its tangent plane;
/// `None` if the splat is invisible.
pub(super) fn draw(
    view: &CpuView,
    placed: &CameraSplat,
    exact: ExactOptions,
) -> Option<(ImageSplat, Tangent)> {
    let k = &view.intrinsics;
    let placed = placed.apply_antialiasing(exact, k)?;
    let extent_squared = placed.extent_squared();
    let (rect, tangent, centre) = match exact.lens {
        Lens::Pinhole => {
            let tangent = pinhole_tangent(&placed, k);
            let centre = DVec2::new(k.fx * tangent.x0.x + k.cx, k.fy * tangent.x0.y + k.cy);
            (bounds::pinhole(view, &placed, extent_squared, exact.response)?, tangent, centre)
        }
        // Fisheye offsets are direction cosines in the tangent frame; a centre in pixels does not exist.
        Lens::Fisheye => {
            let rect = bounds::fisheye(view, &placed, extent_squared, exact.response)?;
            (rect, fisheye_tangent(&placed), DVec2::ZERO)
        }
    };
    let (conic, half_linear) = Conic::new(&placed, &tangent);
    let drawn = ImageSplat {
        centre,
        conic,
        linear: half_linear,
        reach: tangent.reach,
        key: placed.m.length(),
        opacity: placed.opacity,
        extent_squared,
        rect,
    };
    Some((drawn, tangent))
}

/// Returns the plane `z = 1`, parametrised by the offset `δ` in pixels from the splat's projected
/// centre.
pub(super) fn pinhole_tangent(placed: &CameraSplat, k: &Intrinsics) -> Tangent {
    Tangent {
        x0: placed.m / placed.m.z,
        steps: [DVec3::X / k.fx, DVec3::Y / k.fy],
        reach: placed.m.z,
    }
}

/// Returns the plane that touches the unit sphere in the direction of the splat's centre. It is
/// parametrised by the offset `δ` from the centre in direction cosines.
fn fisheye_tangent(placed: &CameraSplat) -> Tangent {
    let reach = placed.m.length();
    let x0 = placed.m / reach;
    let (e1, e2) = x0.any_orthonormal_pair();
    Tangent { x0, steps: [e1, e2], reach }
}
