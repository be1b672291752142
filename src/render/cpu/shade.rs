//! Colour of a splat in a view, computed once per splat (`rendering.md`, Native appearance).

use super::projected::{Conic, Tangent};
use super::record::{ConicRecord, Gradient, Rect};
use super::tile::EXP2_MIN;
use super::view::{CameraSplat, CpuView};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::render::finish::{MARKER_COLOR, ramp};
use crate::render::options::Paint;
use glam::{DMat3, DVec2, DVec3};
use std::f64::consts::LOG2_E;

/// Colour gradient of one splat in camera axes, per world unit.
pub(super) struct ColorGradient(DMat3);

impl ColorGradient {
    pub(super) fn new(appearance: &Appearance, view: &CpuView) -> Self {
        let rows = appearance.gradient.map(|row| row.map(f64::from));
        Self(DMat3::from_cols_array_2d(&rows).transpose() * view.world_from_camera)
    }

    /// Returns the coefficients of the colour gradient in the splat's tangent plane (`rendering.md`,
    /// Native appearance).
    pub(super) fn gradient(&self, tangent: &Tangent) -> Gradient {
        let image = |v: DVec3| (self.0 * v * tangent.reach).as_vec3().to_array();
        let [x, y] = tangent.steps.map(image);
        Gradient {
            along: image(tangent.x0),
            across: std::array::from_fn(|channel| [x[channel], y[channel]]),
        }
    }
}

/// Returns the colour of a splat at its centre. `appearance` only matters for [`Paint::Stored`].
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
        // A marked splat must be recognisable under every paint.
        Paint::Depth(_) | Paint::Normal if splat.color == MARKER_COLOR => MARKER_COLOR,
        Paint::Depth([near, far]) => ramp((placed.m.length() as f32 - near) / (far - near)),
        Paint::Normal => normal_color(view, splat, placed),
    }
}

/// Returns the view-dependent colour `clamp(c₀ + W·d, 0, 1)`. `d` is the unit direction from the
/// camera, limited to the cone of observed directions.
fn directional_color(
    view: &CpuView,
    splat: &Splat,
    placed: &CameraSplat,
    appearance: &Appearance,
) -> [f32; 3] {
    let d = appearance.observed.clamp_direction(view.world_from_camera * placed.m.normalize());
    color_from(splat, appearance, d)
}

/// Returns the colour of a splat seen along the unit direction `d`, world axes.
fn color_from(splat: &Splat, appearance: &Appearance, d: DVec3) -> [f32; 3] {
    std::array::from_fn(|channel| {
        let w = DVec3::from_array(appearance.directional[channel].map(f64::from));
        // Clamped here rather than in the fit, because the direction may differ from all training views.
        (f64::from(splat.color[channel]) + w.dot(d)).clamp(0.0, 1.0) as f32
    })
}

/// Returns the colour of a splat in this view minus its colour seen along the mean of the observed
/// directions.
pub(super) fn directional_shift(
    view: &CpuView,
    splat: &Splat,
    placed: &CameraSplat,
    appearance: Option<&Appearance>,
) -> [f32; 3] {
    let Some(appearance) = appearance else { return [0.0; 3] };
    let here = directional_color(view, splat, placed, appearance);
    let mean = color_from(splat, appearance, appearance.observed.mean());
    std::array::from_fn(|channel| here[channel] - mean[channel])
}

/// Returns the colour `½ + ½·n`. `n` is the world direction of the splat's shortest axis, turned
/// towards the camera.
fn normal_color(view: &CpuView, splat: &Splat, placed: &CameraSplat) -> [f32; 3] {
    let axis = placed.axes.col(splat.thinnest_axis());
    // The sign of an axis is arbitrary; the visible side faces the camera.
    let towards = if axis.dot(placed.m) > 0.0 { -axis } else { axis };
    let n = view.world_from_camera * towards;
    (0.5 + 0.5 * n).as_vec3().to_array()
}

/// Splat projected to the image, in f64.
pub(super) struct ImageSplat {
    pub centre: DVec2,
    pub conic: Conic,
    /// See [`ConicRecord::linear`].
    pub linear: DVec2,
    /// Depth `z` (pinhole) or distance (fisheye) of the centre, world units.
    pub reach: f64,
    /// Sort key, world units: view depth (projected) or distance (exact).
    pub key: f64,
    pub opacity: f64,
    /// Squared Mahalanobis distance `k²` at which alpha equals the alpha cut.
    pub extent_squared: f64,
    pub rect: Rect,
}

impl ImageSplat {
    /// Converts the splat to a record and its sort key; `None` if a value overflows f32.
    pub(super) fn record(&self, color: [f32; 3]) -> Option<(ConicRecord, f32)> {
        // exp(−½ D²) = 2^−(½ log₂e · D²).
        let unit = (0.5 * LOG2_E).sqrt();
        let Conic { p_x, p_y, q_y, w, .. } = self.conic;
        let record = ConicRecord {
            u: self.centre.x as f32,
            v: self.centre.y as f32,
            p_x: (unit * p_x) as f32,
            p_y: (unit * p_y) as f32,
            q_y: (unit * q_y) as f32,
            linear: self.linear.as_vec2().to_array(),
            w: (w / (unit * unit)) as f32,
            // Limited to the range of `exp2`: below it, the bits of its result are not a valid number.
            min_exponent: ((-0.5 * LOG2_E * self.extent_squared) as f32).max(EXP2_MIN),
            opacity: self.opacity as f32,
            color,
            reach: self.reach as f32,
            rect: self.rect,
        };
        // f32 overflows long before f64, so finiteness is checked on the values that the loop reads.
        let ConicRecord { u, v, p_x, p_y, q_y, linear: [l_x, l_y], w, reach, .. } = record;
        let key = self.key as f32;
        [u, v, p_x, p_y, q_y, l_x, l_y, w, reach, key]
            .iter()
            .all(|value| value.is_finite())
            .then_some((record, key))
    }
}
