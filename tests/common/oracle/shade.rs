//! Colour of a splat in a pixel: its own with gradient and view dependence (`rendering.md`, Native
//! appearance), or a colour mode's paint.

use super::{AppearanceF64, SplatF64};
use glam::{DMat3, DVec3};
use std::sync::Arc;
use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::splat::appearance::GRADIENT_LIMIT;
use vbgs_studio::model::splat::texture::Texture;
use vbgs_studio::render::{Paint, RenderOptions, finish};

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

/// Surface of a splat with a texture, in one view.
#[derive(Clone, Debug)]
pub(super) struct Surface {
    /// Mean of the splat, camera axes.
    mean: DVec3,
    /// Normal of the plane towards the camera, camera axes.
    normal: DVec3,
    camera: Camera,
    /// Colour in this view minus the colour seen along the mean of the observed directions.
    shift: DVec3,
    texture: Arc<Texture>,
}

/// Least cosine between ray and normal (`textures.md`, Drawing).
const MIN_COSINE: f64 = 0.1;

impl Surface {
    /// `None` under other paints and for a marked splat.
    pub(super) fn new(
        splat: &SplatF64,
        texture: &Arc<Texture>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Option<Self> {
        let is_marked = splat.color == DVec3::from_array(finish::MARKER_COLOR.map(f64::from));
        if options.style.paint != Paint::Stored || is_marked {
            return None;
        }
        let to_mean = splat.mean - camera.pose.centre();
        let color = |change: DVec3| (splat.color + change).clamp(DVec3::ZERO, DVec3::ONE);
        let shift = |a: &AppearanceF64| {
            color(a.change(to_mean.normalize())) - color(a.directional * a.observed)
        };
        let from_world = camera.pose.rotation().transpose();
        Some(Self {
            mean: from_world * to_mean,
            normal: from_world * normal(splat, to_mean),
            camera: *camera,
            shift: splat.appearance.as_ref().map_or(DVec3::ZERO, shift),
            texture: texture.clone(),
        })
    }

    /// Change of the colour `drawn` along a ray in camera axes.
    pub(super) fn correction(&self, ray: DVec3, drawn: DVec3, beyond: f64) -> DVec3 {
        let facing = -self.normal.dot(ray);
        if facing < MIN_COSINE * (1.0 - beyond) * ray.length() {
            return DVec3::ZERO;
        }
        let point = ray * (-self.normal.dot(self.mean) / facing);
        let point = self.camera.pose.rotation() * point + self.camera.pose.centre();
        let place = self.texture.lattice.place_of(point);
        let side = self.texture.lattice.side();
        if place.iter().any(|v| *v < -beyond || *v > side as f64 + beyond) {
            return DVec3::ZERO;
        }
        // Texels at the border reach to it.
        let place = place.map(|v| v.clamp(0.5, side as f64 - 0.5));
        let part = |i: usize, v: f64| (1.0 - (v - i as f64 - 0.5).abs()).max(0.0);
        let mut change = DVec3::ZERO;
        for (x, y) in (0..side).flat_map(|y| (0..side).map(move |x| (x, y))) {
            let part = part(x, place[0]) * part(y, place[1]);
            let (color, share) = texel(&self.texture, x, y);
            change += part * share * (color - (drawn - self.shift));
        }
        change
    }
}

/// Colour and share of a texel: nine bits per channel in steps of 1/256, and five bits for the share.
fn texel(texture: &Texture, x: usize, y: usize) -> (DVec3, f64) {
    let patch = texture.index[y / 4 * (texture.lattice.side() / 4) + x / 4];
    let Some(patch) = texture.patches.get(usize::from(patch)) else { return (DVec3::ZERO, 0.0) };
    let bits = patch[y % 4 * 4 + x % 4].0;
    let channel = |shift: u32| f64::from(bits >> shift & 0x1ff) / 256.0;
    (DVec3::new(channel(0), channel(9), channel(18)), f64::from(bits >> 27) / 31.0)
}

/// World direction of the shortest axis (the first of equal ones), oriented towards the camera.
fn normal(splat: &SplatF64, to_mean: DVec3) -> DVec3 {
    let scale = splat.scale.to_array();
    let shortest = (1..3).fold(0, |best, i| if scale[i] < scale[best] { i } else { best });
    let axis = DMat3::from_quat(splat.rotation.normalize()).col(shortest);
    if axis.dot(to_mean) > 0.0 { -axis } else { axis }
}
