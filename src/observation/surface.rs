//! What one frame says of the surfaces in it: the input of the scene model.

use super::photograph::Photograph;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use glam::DVec3;

/// One measured point of a surface. Positions are relative to [`Observation::origin`], in world
/// units along the world's axes.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
// A number follows each vector: 64 bytes without padding, which `Pod` would refuse.
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
    /// Unit normal of the surface, turned towards the camera.
    pub normal: [f32; 3],
    /// Length that one pixel covers at this range, across the ray: range / focal length.
    pub footprint: f32,
    /// Unit direction from the camera to the point.
    pub direction: [f32; 3],
    /// Row-major index of the pixel.
    pub pixel: u32,
}

impl SurfacePoint {
    /// Position in f64: relative to [`Observation::origin`], world units.
    pub fn position_vector(&self) -> DVec3 {
        vector(self.position)
    }

    /// Unit normal in f64, along the world's axes.
    pub fn normal_vector(&self) -> DVec3 {
        vector(self.normal)
    }

    /// Unit direction from the camera to the point in f64, along the world's axes.
    pub fn direction_vector(&self) -> DVec3 {
        vector(self.direction)
    }
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// How far measured and modelled depth, and recorded and true places, may differ, world units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthTolerance {
    /// A surface within `margin[0] + margin[1]·range` of the measured one is the measured one.
    pub margin: [f32; 2],
    /// Largest correction of a point along its ray.
    pub refinement: f32,
    /// Standard deviation of a recorded camera centre along an axis.
    pub place: f32,
}

/// One frame as the scene model sees it.
#[derive(Clone, Debug)]
pub struct Observation {
    /// World position that the points are relative to.
    pub origin: DVec3,
    /// Intrinsics and pose of the depth image.
    pub camera: Camera,
    /// Points in tiles eight rows high and eight looked-at pixels wide, rows of tiles from the top, in a tile row
    /// by row.
    pub points: Vec<SurfacePoint>,
    /// Pixels that each point stands for.
    pub point_weight: u32,
    /// Measured distance along every pixel's ray: infinite where there is no surface, NaN where
    /// nothing is known.
    pub ranges: Image<f32>,
    /// How far depths may differ.
    pub tolerance: DepthTolerance,
    /// The frame's photograph, where learning asks for it.
    pub photograph: Option<Photograph>,
}

impl Observation {
    /// Says nothing; memory to be filled.
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
