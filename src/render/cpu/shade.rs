//! Colour of a splat in a view, computed once per splat (`rendering.md`, Native appearance).

use super::conic::Tangent;
use super::record::Gradient;
use super::view::{CameraSplat, CpuView};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::render::options::Paint;
use crate::render::paint::{MARKER_COLOR, ramp};
use glam::{DMat3, DVec3};

/// Colour gradient of one splat in camera axes, per world unit.
pub(super) struct ColorGradient(DMat3);

impl ColorGradient {
    pub(super) fn new(appearance: &Appearance, view: &CpuView) -> Self {
        let rows = appearance.gradient.map(|row| row.map(f64::from));
        Self(DMat3::from_cols_array_2d(&rows).transpose() * view.world_from_camera)
    }

    /// Coefficients of the colour gradient in the splat's tangent plane (`rendering.md`, Native
    /// appearance).
    pub(super) fn gradient(&self, tangent: &Tangent) -> Gradient {
        let image = |v: DVec3| (self.0 * v * tangent.reach).as_vec3().to_array();
        let [x, y] = tangent.steps.map(image);
        Gradient {
            along: image(tangent.x0),
            across: std::array::from_fn(|channel| [x[channel], y[channel]]),
        }
    }
}

/// Colour at the splat's centre. `appearance` only matters for [`Paint::Stored`].
pub(super) fn color(
    view: &CpuView,
    splat: &Splat,
    placed: &CameraSplat,
    appearance: Option<&Appearance>,
) -> [f32; 3] {
    match view.style.paint {
        Paint::Stored => match appearance {
            Some(appearance) => directional_color(view, splat, placed, appearance),
            None => splat.color.map(|channel| channel.max(0.0)),
        },
        Paint::Depth(_) | Paint::Normal if splat.color == MARKER_COLOR => MARKER_COLOR,
        Paint::Depth([near, far]) => ramp((placed.m.length() as f32 - near) / (far - near)),
        Paint::Normal => normal_color(view, placed),
    }
}

/// `clamp(c₀ + W·d, 0, 1)` with `d` the unit direction from the camera, limited to the observed cone.
fn directional_color(
    view: &CpuView,
    splat: &Splat,
    placed: &CameraSplat,
    appearance: &Appearance,
) -> [f32; 3] {
    let d = appearance.observed.clamp_direction(view.world_from_camera * placed.m.normalize());
    std::array::from_fn(|channel| {
        let w = DVec3::from_array(appearance.directional[channel].map(f64::from));
        // Clamped here rather than in the fit, because the direction may differ from all training views.
        (f64::from(splat.color[channel]) + w.dot(d)).clamp(0.0, 1.0) as f32
    })
}

/// `½ + ½·n` with `n` the world direction of the shortest axis, turned towards the camera.
fn normal_color(view: &CpuView, placed: &CameraSplat) -> [f32; 3] {
    let [x, y, z] = placed.scale.to_array();
    let shortest = if x <= y && x <= z {
        0
    } else if y <= z {
        1
    } else {
        2
    };
    let axis = placed.axes.col(shortest);
    // The sign of an axis is arbitrary; the visible side faces the camera.
    let towards = if axis.dot(placed.m) > 0.0 { -axis } else { axis };
    let n = view.world_from_camera * towards;
    (0.5 + 0.5 * n).as_vec3().to_array()
}
