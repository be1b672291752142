//! Colour of a splat in a pixel: its own with gradient and view dependence (`rendering.md`, Native
//! appearance), or a colour mode's paint.

use super::SplatF64;
use glam::{DMat3, DVec3};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::splat::appearance::GRADIENT_LIMIT;
use vbgs_studio::render::{Paint, finish};

/// Colour of one splat in one view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shade {
    /// Colour at the mean.
    base: DVec3,
    /// Maps an offset from the mean, in camera axes, to a change of colour.
    gradient: DMat3,
}

impl Shade {
    pub(super) fn new(splat: &SplatF64, camera: &Camera, paint: Paint) -> Self {
        let to_mean = splat.mean - camera.pose.centre();
        let flat = |base| Self { base, gradient: DMat3::ZERO };
        match (paint, &splat.appearance) {
            (Paint::Stored, None) => flat(splat.color.max(DVec3::ZERO)),
            (Paint::Stored, Some(appearance)) => {
                let color = splat.color + appearance.change(to_mean.normalize());
                Self {
                    base: color.clamp(DVec3::ZERO, DVec3::ONE),
                    gradient: appearance.gradient * camera.pose.rotation(),
                }
            }
            _ if splat.color == DVec3::from_array(finish::MARKER_COLOR.map(f64::from)) => {
                flat(splat.color)
            }
            (Paint::Depth(ends), _) => {
                let [near, far] = ends.map(f64::from);
                let share = (to_mean.length() - near) / (far - near);
                flat(DVec3::from_array(finish::ramp(share as f32).map(f64::from)))
            }
            (Paint::Normal, _) => flat(0.5 + 0.5 * normal(splat, to_mean)),
        }
    }

    /// Colour at an offset from the mean, in camera axes.
    pub(super) fn at(&self, offset: DVec3) -> DVec3 {
        let limit = DVec3::splat(GRADIENT_LIMIT);
        let change = (self.gradient * offset).clamp(-limit, limit);
        (self.base + change).max(DVec3::ZERO)
    }
}

/// World direction of the shortest axis (the first of equal ones), oriented towards the camera.
fn normal(splat: &SplatF64, to_mean: DVec3) -> DVec3 {
    let scale = splat.scale.to_array();
    let shortest = (1..3).fold(0, |best, i| if scale[i] < scale[best] { i } else { best });
    let axis = DMat3::from_quat(splat.rotation.normalize()).col(shortest);
    if axis.dot(to_mean) > 0.0 { -axis } else { axis }
}
