//! Surface points, depth image and photograph of one frame: the training data of the scene model.

use super::photograph::Photograph;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use glam::DVec3;

/// Measured surface point. Positions are relative to [`Observation::origin`], in world units along the
/// world axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
// A scalar follows each vector: 64 bytes without padding, as `Pod` requires.
#[repr(C, align(16))]
pub struct SurfacePoint {
    /// Position relative to [`Observation::origin`], world units.
    pub position: [f32; 3],
    /// Distance from the camera along the ray, world units.
    pub range: f32,
    /// sRGB-encoded colour in `[0, 1]`.
    pub color: [f32; 3],
    /// Half-width of the depth noise along the ray, world units.
    pub noise: f32,
    /// Unit surface normal, facing the camera.
    pub normal: [f32; 3],
    /// Width of a pixel at this range, across the ray: range / focal length, world units.
    pub footprint: f32,
    /// Unit direction from the camera to the point.
    pub direction: [f32; 3],
    /// Row-major pixel index.
    pub pixel: u32,
}

impl SurfacePoint {
    /// Position in f64, relative to [`Observation::origin`], world units.
    pub fn position_vector(&self) -> DVec3 {
        vector(self.position)
    }

    /// Unit normal in f64, along the world axes.
    pub fn normal_vector(&self) -> DVec3 {
        vector(self.normal)
    }

    /// Unit direction from the camera to the point in f64, along the world axes.
    pub fn direction_vector(&self) -> DVec3 {
        vector(self.direction)
    }
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// Tolerances for measured against modelled depth and for recorded positions, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthTolerance {
    /// A surface within `margin[0] + margin[1]·range` of the measured one counts as the same.
    pub margin: [f32; 2],
    /// Maximum correction of a point along its ray.
    pub refinement: f32,
    /// Standard deviation of a recorded camera centre per axis.
    pub place: f32,
}

/// Training data of one frame for the scene model.
#[derive(Clone, Debug)]
pub struct Observation {
    /// World position to which the points are relative.
    pub origin: DVec3,
    /// Intrinsics and pose of the depth image.
    pub camera: Camera,
    /// Points in tiles of eight rows and eight sampled pixels per row; tiles row by row from the top,
    /// row-major within a tile.
    pub points: Vec<SurfacePoint>,
    /// Number of pixels represented by each point.
    pub point_weight: u32,
    /// Measured distance along each pixel's ray, world units: infinite if there is no surface, NaN if
    /// unknown.
    pub ranges: Image<f32>,
    /// Depth tolerances.
    pub tolerance: DepthTolerance,
    /// The frame's photograph, if training uses it.
    pub photograph: Option<Photograph>,
}

impl Observation {
    /// Creates an empty observation as a buffer.
    pub fn empty() -> Self {
        let intrinsics = Intrinsics { width: 0, height: 0, fx: 1.0, fy: 1.0, cx: 0.0, cy: 0.0 };
        Self {
            origin: DVec3::ZERO,
            camera: Camera { intrinsics, pose: Pose::IDENTITY },
            points: Vec::new(),
            point_weight: 1,
            ranges: Image::filled(0, 0, f32::NAN),
            tolerance: DepthTolerance { margin: [0.0; 2], refinement: 0.0, place: 0.0 },
            photograph: None,
        }
    }
}
