//! Surface points, depth image and photograph of one frame: the training data of the scene model.

use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::measured_pixel::{MASKED, MeasuredPixel};
use crate::math::pose::Pose;
use glam::{DQuat, DVec3};
use std::ops::Range;
use std::sync::Arc;

/// Measured surface point. Its position is relative to [`Observation::origin`], in world axes and units.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
// A scalar follows each vector: 64 bytes without padding, as `Pod` requires.
#[repr(C, align(16))]
pub struct SurfacePoint {
    /// Position relative to [`Observation::origin`], world units.
    // f32 suffices near the origin; absolute positions cost 0.8 dB at 10⁶ units.
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
    /// Row-major index of the pixel in the depth image.
    pub pixel: u32,
}

impl SurfacePoint {
    /// Returns the position in f64, relative to [`Observation::origin`], world units.
    pub fn position_vector(&self) -> DVec3 {
        vector(self.position)
    }

    /// Returns the unit normal in f64, in world axes.
    pub fn normal_vector(&self) -> DVec3 {
        vector(self.normal)
    }

    /// Returns the unit direction from the camera to the point in f64, in world axes.
    pub fn direction_vector(&self) -> DVec3 {
        vector(self.direction)
    }
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// Tolerances for comparing measured with modelled depth, and for recorded camera positions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthTolerance {
    /// Coefficients of the depth tolerance `margin[0] + margin[1]·range`, world units. A surface within
    /// this tolerance is regarded as the measured one. `range` is the measured distance along the ray.
    pub margin: [f32; 2],
    /// Maximum correction of a point along its ray, world units.
    pub refinement: f32,
    /// Standard deviation of a recorded camera centre per axis, world units.
    pub place: f32,
}

/// Training data of one frame for the scene model.
#[derive(Clone, Debug)]
pub struct Observation {
    /// World position to which the points are relative.
    pub origin: DVec3,
    /// Intrinsics and pose of the camera that measured the depth image.
    pub camera: Camera,
    /// Measured points in tiles of eight rows with eight sampled pixels each. Tiles are ordered in rows
    /// from the top; points within a tile are row-major.
    pub points: Vec<SurfacePoint>,
    /// Number of pixels represented by each point.
    pub point_weight: u32,
    /// Measured distance along each pixel's ray, world units: infinite if there is no surface, NaN if
    /// unknown.
    pub ranges: Image<f32>,
    /// Tolerances for depth and camera position.
    pub tolerance: DepthTolerance,
    /// The frame's photograph, if training uses it.
    pub photograph: Option<Photograph>,
}

impl Observation {
    /// Creates an empty observation, as a buffer for the data of a frame.
    pub fn empty() -> Self {
        // Projections divide by focal lengths.
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

/// Photograph of a frame with its camera.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Pinhole intrinsics of the colour camera.
    pub intrinsics: Intrinsics,
    /// Position of the colour camera in the depth camera's frame, world units.
    pub offset: DVec3,
    /// Rotation from the colour camera's axes to the depth camera's axes.
    pub rotation: DQuat,
    /// sRGB-encoded red, green and blue, and opacity, in 255ths; [`MASKED`] if left out.
    // Shared with the decoded frame instead of copied.
    pub colors: Arc<Image<[u8; 4]>>,
    /// Calibrated gains of red, green and blue.
    pub gain: [f32; 3],
    /// Depth of the surface in each pixel along this camera's optical axis, world units; 0 if unknown.
    pub depths: Image<f32>,
    /// True if opacity and depth indicate how much of each pixel is covered by surfaces.
    pub has_coverage: bool,
}

impl Photograph {
    /// Returns intrinsics and world pose of the colour camera, given the pose of the depth camera.
    pub fn camera(&self, depth: &Pose) -> Camera {
        Camera {
            intrinsics: self.intrinsics,
            pose: depth.attached_camera(self.offset, self.rotation),
        }
    }

    /// Returns the measured pixels of some columns of a row, with the photograph's gain applied. A
    /// surface within `margin[0] + margin[1]·depth` (world units) of the measured depth is regarded as
    /// the measured one.
    pub fn measured_row(
        &self,
        row: usize,
        columns: Range<usize>,
        margin: [f32; 2],
    ) -> impl ExactSizeIterator<Item = MeasuredPixel> + '_ {
        let first = row * self.colors.width + columns.start;
        let depths = &self.depths.data[first..][..columns.len()];
        let colors = &self.colors.data[first..][..columns.len()];
        colors.iter().zip(depths).map(move |(color, depth)| {
            if *color == MASKED {
                return MeasuredPixel::LEFT_OUT;
            }
            let [red, green, blue, alpha] = color.map(|byte| f32::from(byte) / 255.0);
            let covered = match self.has_coverage {
                true if color[3] < u8::MAX => alpha,
                true if *depth > 0.0 => 1.0,
                // An opaque pixel without depth: whether a surface covers it is unknown.
                _ => f32::NAN,
            };
            // Premultiplied: an uncovered pixel is black.
            let [r, g, b] = [red, green, blue].map(|channel| channel * alpha);
            let [r, g, b] = [r * self.gain[0], g * self.gain[1], b * self.gain[2]];
            MeasuredPixel::without_depth([r, g, b, covered]).with_depth(*depth, margin)
        })
    }

    /// Returns the measured pixels of the whole photograph, multiplied by `gain` (red, green and blue)
    /// and by the photograph's own gain. `margin` is that of [`Self::measured_row`].
    pub fn measured_pixels(&self, gain: [f32; 3], margin: [f32; 2]) -> Image<MeasuredPixel> {
        let exposed = |pixel: MeasuredPixel| {
            let [r, g, b] = pixel.color;
            MeasuredPixel { color: [r * gain[0], g * gain[1], b * gain[2]], ..pixel }
        };
        let Image { width, height, .. } = *self.colors;
        let pixels = (0..height)
            .flat_map(|row| self.measured_row(row, 0..width, margin))
            .map(exposed)
            .collect();
        Image::from_vec(width, height, pixels)
    }
}
