//! Splats in f64 and their preparation for both renderers (`rendering.md`, Conventions).

use super::shade::Shade;
use glam::{DMat3, DQuat, DVec3};
use vbgs_studio::math::camera::Camera;
use vbgs_studio::model::splat::appearance::Appearance;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::render::{Lens, RenderOptions, scale_floor};

/// A splat in f64; the fields are those of [`Splat`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SplatF64 {
    /// Centre, world units.
    pub mean: DVec3,
    /// Peak opacity.
    pub opacity: f64,
    /// sRGB-encoded colour.
    pub color: DVec3,
    /// Standard deviations along the rotated axes, world units.
    pub scale: DVec3,
    /// Orientation of those axes.
    pub rotation: DQuat,
    /// Gradient and view dependence of the colour, if the scene has them.
    pub appearance: Option<AppearanceF64>,
}

/// [`Appearance`] in f64.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AppearanceF64 {
    /// Maps an offset from the mean (world units) to a change of colour.
    pub gradient: DMat3,
    /// Maps the unit direction from the camera to the mean to a change of colour.
    pub directional: DMat3,
    /// Mean `m` of the observed unit directions from the camera.
    pub observed: DVec3,
    /// Matrix `P` with `(d − m)ᵀ P (d − m) ≤ 1` inside the observed cone.
    pub cone: DMat3,
}

impl AppearanceF64 {
    /// Change of colour for the unit direction `d` from the camera.
    pub fn change(&self, d: DVec3) -> DVec3 {
        let offset = d - self.observed;
        let beyond = offset.dot(self.cone * offset).max(1.0).sqrt();
        self.directional * (self.observed + offset / beyond)
    }
}

impl From<&Appearance> for AppearanceF64 {
    fn from(appearance: &Appearance) -> Self {
        let matrix = |rows: [[f32; 3]; 3]| {
            DMat3::from_cols_array_2d(&rows.map(|row| row.map(f64::from))).transpose()
        };
        let [xx, xy, xz, yy, yz, zz] = appearance.observed.inverse;
        Self {
            gradient: matrix(appearance.gradient),
            directional: matrix(appearance.directional),
            observed: DVec3::from_array(appearance.observed.mean.map(f64::from)),
            cone: matrix([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        }
    }
}

impl From<&Splat> for SplatF64 {
    fn from(splat: &Splat) -> Self {
        let [w, x, y, z] = splat.rotation.map(f64::from);
        Self {
            mean: DVec3::from_array(splat.mean.map(f64::from)),
            opacity: splat.opacity.into(),
            color: DVec3::from_array(splat.color.map(f64::from)),
            scale: DVec3::from_array(splat.scale.map(f64::from)),
            rotation: DQuat::from_xyzw(x, y, z, w),
            appearance: None,
        }
    }
}

impl From<&SplatF64> for Splat {
    /// Rounds to f32 and drops the appearance.
    fn from(splat: &SplatF64) -> Self {
        let narrow = |v: DVec3| v.as_vec3().to_array();
        let q = splat.rotation;
        Self {
            mean: narrow(splat.mean),
            opacity: splat.opacity as f32,
            color: narrow(splat.color),
            scale: narrow(splat.scale),
            rotation: [q.w, q.x, q.y, q.z].map(|v| v as f32),
        }
    }
}

/// A splat in camera space.
pub(super) struct Placed {
    /// Number of the splat in the scene.
    pub number: usize,
    /// Centre.
    pub mean: DVec3,
    /// Columns are the directions of the standard deviations.
    pub axes: DMat3,
    /// Standard deviations, at least the scale floor.
    pub scale: DVec3,
    pub opacity: f64,
    pub shade: Shade,
}

impl Placed {
    /// `None` if the splat is invalid, below the opacity cut or too near.
    pub(super) fn new(
        (number, splat): (usize, &SplatF64),
        camera: &Camera,
        options: &RenderOptions,
    ) -> Option<Self> {
        // Uses the same definition of a drawable splat as every other renderer.
        if !Splat::from(splat).is_drawable() || !has_finite_appearance(splat) {
            return None;
        }
        let (camera_from_world, translation) = camera.pose.inverse();
        let mean = camera_from_world * splat.mean + translation;
        let depth = match options.method.lens() {
            Lens::Pinhole => mean.z,
            Lens::Fisheye => mean.length(),
        };
        let look = &options.style;
        if depth <= options.near.max(0.0) || splat.opacity < f64::from(look.opacity_cut) {
            return None;
        }
        let scale = splat.scale * f64::from(look.scale);
        let axes = camera_from_world * DMat3::from_quat(splat.rotation.normalize());
        Some(Self {
            number,
            mean,
            axes,
            scale: scale.max(DVec3::splat(scale_floor(scale.max_element()))),
            opacity: splat.opacity,
            shade: Shade::new(splat, camera, look.paint),
        })
    }
}

fn has_finite_appearance(splat: &SplatF64) -> bool {
    splat.appearance.is_none_or(|a| a.gradient.is_finite() && a.directional.is_finite())
}
