//! Camera and options in the form used for preparation, and the steps common to all renderers.

use super::projected;
use super::record::Rect;
use crate::math::camera::{Camera, Intrinsics};
use crate::model::splat::splats::Splat;
use crate::render::options::{
    ALPHA_CUT, Antialias, DisplayStyle, ExactOptions, FOOTPRINT_PX2, Lens, REFERENCE_VARIANCE,
    RenderMethod, RenderOptions, tangent_range,
};
use glam::{DMat3, DVec2, DVec3, Vec3Swizzles};

/// Camera and options of a view.
#[derive(Clone)]
pub(in crate::render) struct CpuView {
    pub width: usize,
    pub height: usize,
    pub world_from_camera: DMat3,
    pub camera_from_world: DMat3,
    pub centre: DVec3,
    pub intrinsics: Intrinsics,
    /// Lower limit of `x/z` and `y/z`; `tangent_hi` is the upper limit. The Jacobian is evaluated at
    /// the splat's centre, clamped to these limits.
    pub tangent_lo: DVec2,
    pub tangent_hi: DVec2,
    pub near: f32,
    pub method: RenderMethod,
    pub style: DisplayStyle,
    /// See [`crate::model::splat::appearance::Finishing::is_antialiased`].
    pub is_antialiased: bool,
}

/// Splat in camera axes.
#[derive(Clone, Copy)]
pub(in crate::render) struct CameraSplat {
    /// Centre in camera axes (x right, y down, z forward), world units.
    pub m: DVec3,
    /// Unit vectors along the principal axes, in the camera's frame, one per column.
    pub axes: DMat3,
    /// Standard deviations along the principal axes as drawn, world units (see
    /// [`DisplayStyle::display_scales`]).
    pub scale: DVec3,
    pub opacity: f64,
}

impl CpuView {
    pub(in crate::render) fn new(camera: &Camera, options: &RenderOptions) -> Self {
        let k = camera.intrinsics;
        let [tangent_lo, tangent_hi] = tangent_range(&k);
        Self {
            width: k.width as usize,
            height: k.height as usize,
            world_from_camera: camera.pose.rotation(),
            camera_from_world: camera.pose.rotation().transpose(),
            centre: camera.pose.centre(),
            intrinsics: k,
            tangent_lo,
            tangent_hi,
            near: options.near.max(0.0) as f32,
            method: options.method,
            style: options.style,
            is_antialiased: false,
        }
    }

    /// Transforms a splat to camera axes. `None` if its opacity is below the alpha cut or the display
    /// style's cut. Also `None` if its centre is not beyond the near plane.
    pub(in crate::render) fn to_camera(&self, splat: &Splat) -> Option<CameraSplat> {
        // The camera is subtracted in f64, because far from the origin f32 would lose the difference.
        let mean = DVec3::from_array(splat.mean.map(f64::from));
        let m = self.camera_from_world * (mean - self.centre);
        let depth = match self.method.lens() {
            Lens::Pinhole => m.z,
            Lens::Fisheye => m.length(),
        };
        let opacity = f64::from(splat.opacity);
        // Splats hidden by the viewer, or below the alpha cut in every pixel, are dropped before
        // projection.
        let faint = opacity < ALPHA_CUT || splat.opacity < self.style.opacity_cut;
        // Compared in f32 as on the GPU, so that both treat a splat on the near plane alike.
        if depth as f32 <= self.near || faint {
            return None;
        }
        let axes = self.camera_from_world * rotation_matrix(splat.rotation);
        let placed = CameraSplat { m, axes, scale: self.style.display_scales(splat), opacity };
        if self.is_antialiased { placed.compensate_opacity(self) } else { Some(placed) }
    }

    /// Clips a pixel rectangle to the image; `None` if nothing remains. Infinite bounds give the whole
    /// image, because casts saturate.
    pub(super) fn clip(&self, lo: DVec2, hi: DVec2) -> Option<Rect> {
        // Records hold 16 bits per side.
        let limit =
            |value: f64, size: usize| (value as u16).min(size.min(usize::from(u16::MAX)) as u16);
        let rect = Rect {
            x0: limit(lo.x, self.width),
            x1: limit(hi.x, self.width),
            y0: limit(lo.y, self.height),
            y1: limit(hi.y, self.height),
        };
        (rect.x0 < rect.x1 && rect.y0 < rect.y1).then_some(rect)
    }

    /// Returns the rectangle of the pixels whose centres lie between two points of the image plane, in
    /// pixels. `None` if the image contains no such pixel.
    pub(super) fn pixels(&self, lo: DVec2, hi: DVec2) -> Option<Rect> {
        self.clip((lo - 0.5).ceil(), (hi - 0.5).floor() + 1.0)
    }
}

/// Converts a quaternion `w x y z` of any non-zero length to a rotation matrix. Its columns are the
/// world directions of the principal axes. The squared length is divided out once, instead of
/// normalising.
fn rotation_matrix(rotation: [f32; 4]) -> DMat3 {
    let [w, x, y, z] = rotation.map(f64::from);
    let double = 2.0 / (w * w + x * x + y * y + z * z);
    let (dx, dy, dz) = (double * x, double * y, double * z);
    let (xx, yy, zz) = (x * dx, y * dy, z * dz);
    let (xy, xz, yz) = (x * dy, x * dz, y * dz);
    let (wx, wy, wz) = (w * dx, w * dy, w * dz);
    DMat3::from_cols(
        DVec3::new(1.0 - yy - zz, xy + wz, xz - wy),
        DVec3::new(xy - wz, 1.0 - xx - zz, yz + wx),
        DVec3::new(xz + wy, yz - wx, 1.0 - xx - yy),
    )
}

impl CameraSplat {
    /// Returns the squared Mahalanobis distance `k²` at which alpha, `o·exp(−k²/2)` with opacity `o`,
    /// equals the alpha cut.
    pub(super) fn extent_squared(&self) -> f64 {
        2.0 * (self.opacity / ALPHA_CUT).ln()
    }

    /// Variance that the exact renderer's footprint adds along every axis, world units².
    fn footprint_variance(&self, k: &Intrinsics) -> f64 {
        FOOTPRINT_PX2 * self.m.length_squared() / (k.fx * k.fy)
    }

    /// Multiplies the opacity by the splat's area in the image without antialiasing, as a fraction of the area
    /// with it (`rendering.md`, Opacity compensation). `None` if the opacity falls below the alpha cut.
    fn compensate_opacity(mut self, view: &CpuView) -> Option<Self> {
        self.opacity *= match view.method {
            RenderMethod::Projected => projected::area_share(view, &self),
            RenderMethod::Exact(ExactOptions { antialias: Antialias::Footprint, .. }) => {
                let direction = self.axes.transpose_mul_vec3(self.m);
                // Squared area of the shadow along the line of sight, up to a constant factor.
                let shadow = |s: DVec3| (s.yzx() * s.zxy()).dot(direction * direction);
                let variances = self.scale * self.scale;
                let widened = variances + self.footprint_variance(&view.intrinsics);
                (shadow(variances) / shadow(widened)).sqrt()
            }
            // Nothing is added, or the opacity is lowered anyway.
            RenderMethod::Exact(_) => 1.0,
        };
        (self.opacity >= ALPHA_CUT).then_some(self)
    }

    /// Widens the splat by the exact renderer's antialiasing (`rendering.md`, Antialiasing). `None` if
    /// the opacity falls below the alpha cut.
    pub(in crate::render) fn apply_antialiasing(
        mut self,
        exact: ExactOptions,
        k: &Intrinsics,
    ) -> Option<Self> {
        let variance = match exact.antialias {
            Antialias::None => return Some(self),
            Antialias::Footprint => self.footprint_variance(k),
            Antialias::Reference => REFERENCE_VARIANCE,
        };
        let widened = (self.scale * self.scale + variance).map(f64::sqrt);
        // Only the reference fades a splat by its gain in volume (`rendering.md`, Antialiasing).
        if exact.antialias == Antialias::Reference {
            self.opacity *= (self.scale / widened).element_product();
        }
        self.scale = widened;
        (self.opacity >= ALPHA_CUT).then_some(self)
    }
}
