//! One frame in memory: camera, colour and depth.
//!
//! Frames are checked on creation, by [`FrameEntry::load`](super::FrameEntry::load) for files and by
//! [`Frame::from_memory`] for buffers. Code that reads a frame relies on these checks and handles only holes.

use super::calibration;
use super::calibration::{ColorCamera, IntrinsicsDefect};
use super::error::{FrameError, FrameProblem};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use glam::{DMat4, DVec3};
use std::borrow::Cow;
use std::sync::Arc;

pub use super::depth::{Depth, DepthCodes, DepthKind};

/// Checked frame: images and cameras match, and the pose is rigid. Depth has the size of `camera`.
/// Colour has the size of `color_camera`, or of `camera` if there is none.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Name within the split.
    pub name: String,
    /// Intrinsics and pose of the camera that measured depth.
    pub camera: Camera,
    /// Camera of the colour image if the files describe one that differs from the depth camera. `None`
    /// if colours are assumed to be registered to depth pixel by pixel.
    pub color_camera: Option<ColorCamera>,
    /// Colour image: sRGB-encoded RGBA bytes, not premultiplied; alpha is 255 if the file has none.
    /// [`MASKED`](crate::math::measured_pixel::MASKED) marks pixels that are left out.
    /// Shared, because photometric training keeps the image longer than the frame.
    pub color: Arc<Image<[u8; 4]>>,
    /// Depth image; `None` in splits without depth.
    pub depth: Option<Depth>,
}

/// Colour bytes of an in-memory frame: sRGB-encoded, rows from the top, no padding between rows.
#[derive(Clone, Copy, Debug)]
pub enum ColorBuffer<'a> {
    /// Red, green and blue of every pixel; all pixels are opaque.
    Rgb8(&'a [u8]),
    /// Red, green, blue and alpha of every pixel, not premultiplied. Pixels that are not opaque yield no
    /// points.
    Rgba8(&'a [u8]),
}

/// Depth image of an in-memory frame, taken with the intrinsics and pose of that frame.
#[derive(Clone, Copy, Debug)]
pub struct DepthBuffer<'a> {
    /// Depth of every pixel in world units (metres, if the poses are metric), rows from the top, no
    /// padding. NaN, infinite, zero and negative lengths are holes.
    pub lengths: &'a [f32],
    /// Direction of measurement: along the optical axis or along the pixel's ray.
    pub kind: DepthKind,
    /// Open interval of lengths that training uses, world units; `[0.0, f64::INFINITY]` accepts all.
    pub trusted: [f64; 2],
}

impl Frame {
    /// Creates a frame from images in memory, a pinhole camera and its pose. The pose is a
    /// camera-to-world matrix in OpenCV axes (x right, y down, z forward).
    ///
    /// # Errors
    /// Intrinsics that no camera has, or a matrix that is not a rigid pose (NaN, scale, mirror image).
    /// A buffer whose size differs from that of the camera's image. Depth that contains only holes, or
    /// an empty trusted interval.
    ///
    /// ```
    /// use glam::DMat4;
    /// use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
    /// use vbgs_studio::math::camera::Intrinsics;
    ///
    /// let intrinsics = Intrinsics::from_horizontal_fov(4, 3, 1.0);
    /// let color = ColorBuffer::Rgb8(&[128; 4 * 3 * 3]);
    /// let mut lengths = [1.5f32; 4 * 3];
    /// lengths[0] = f32::NAN;
    /// let depth = |lengths| DepthBuffer {
    ///     lengths,
    ///     kind: DepthKind::Z,
    ///     trusted: [0.3, 4.0],
    /// };
    ///
    /// let pose = DMat4::from_rotation_y(0.1);
    /// let frame = Frame::from_memory("0", intrinsics, pose, color, Some(depth(&lengths)))?;
    /// let z = frame.depth_z().unwrap();
    /// assert_eq!((z.data[0], z.data[1]), (0.0, 1.5), "NaN is a hole");
    ///
    /// let short = Some(depth(&lengths[..7]));
    /// let error = Frame::from_memory("1", intrinsics, pose, color, short).unwrap_err();
    /// assert!(error.to_string().contains("12 lengths"), "{error}");
    /// # Ok::<(), vbgs_studio::dataset::error::FrameError>(())
    /// ```
    pub fn from_memory(
        name: &str,
        intrinsics: Intrinsics,
        world_from_camera: DMat4,
        color: ColorBuffer,
        depth: Option<DepthBuffer>,
    ) -> Result<Self, FrameError> {
        let checked = || -> Result<Self, FrameProblem> {
            // The camera first: the buffers are compared with its size.
            calibration::check(&intrinsics).map_err(|defect| {
                let IntrinsicsDefect { expected, found, hint } = defect;
                FrameProblem::Intrinsics { expected, found, hint: hint.to_owned() }
            })?;
            let pose = Pose::from_opencv(world_from_camera)?;
            let size = (intrinsics.width, intrinsics.height);
            let color = color.image(size)?.into();
            let depth = depth.map(|buffer| buffer.depth(size)).transpose()?;
            let camera = Camera { intrinsics, pose };
            Ok(Self { name: name.to_owned(), camera, color_camera: None, color, depth })
        };
        checked().map_err(|problem| FrameError {
            file: "memory".into(),
            frame: name.to_owned(),
            problem,
        })
    }

    /// Returns the camera of the colour image: `calibrated` if given, else the camera from the files.
    /// `None` if colours are registered to depth.
    pub fn photographed_by(&self, calibrated: Option<&ColorCamera>) -> Option<ColorCamera> {
        let size = [self.color.width, self.color.height].map(|n| n as u32);
        photographed_by(self.color_camera, calibrated, size)
    }

    /// Returns world pose and intrinsics of the camera that took the colour image, scaled to the size of
    /// that image.
    pub fn photo_camera(&self, calibrated: Option<&ColorCamera>) -> Camera {
        let color = self.photographed_by(calibrated);
        color.map_or(self.camera, |color| color.camera_at(&self.camera))
    }

    /// True if the colour at a pixel of the depth image is opaque; `pixel` is a row-major index. Always
    /// true if another camera took the photograph, because its alpha belongs to other pixels.
    pub fn is_opaque(&self, pixel: usize) -> bool {
        self.color_camera.is_some()
            || self.color.data.get(pixel).is_some_and(|rgba| rgba[3] == u8::MAX)
    }

    /// Returns the frame with one colour per depth pixel. Registered colours stay unchanged; others are
    /// sampled from the photograph. Pixels without depth or outside the photograph become transparent.
    pub fn with_registered_color(&self) -> Cow<'_, Self> {
        let (Some(color_camera), Some(depth)) = (self.color_camera, &self.depth) else {
            return Cow::Borrowed(self);
        };
        let (width, height) = depth.size();
        let mut color = Image::filled(width, height, [0; 4]);
        for (i, pixel) in color.data.iter_mut().enumerate() {
            let (column, row) = (i % width, i / width);
            let k = &self.camera.intrinsics;
            // Without depth, the pixel's place in the photograph is unknown.
            let Some(value) = depth.value_at(column, row) else { continue };
            let z = value / length_per_z(k, depth.kind, column, row);
            *pixel = self.nearest_color(&color_camera, k.ray(column, row) * z).unwrap_or([0; 4]);
        }
        Cow::Owned(Self { color: color.into(), color_camera: None, ..self.clone() })
    }

    fn nearest_color(&self, camera: &ColorCamera, point: DVec3) -> Option<[u8; 4]> {
        let at = camera.project(point)?;
        // Checked before the cast, which would move a negative coordinate to the first column.
        let is_inside = at.min_element() >= 0.0
            && at.x < self.color.width as f64
            && at.y < self.color.height as f64;
        is_inside.then(|| *self.color.at(at.x as usize, at.y as usize))
    }

    pub(super) fn require_depth(&self) -> Result<&Depth, FrameError> {
        self.depth.as_ref().ok_or_else(|| FrameError {
            // The frame's name replaces the file, which a frame in memory does not store.
            file: self.name.clone().into(),
            frame: self.name.clone(),
            problem: FrameProblem::NoDepth,
        })
    }

    /// Returns depth along the optical axis in world units, 0 at holes, for evaluation and plane fits.
    /// `None` for a frame without depth. Includes depth outside the trusted interval.
    pub fn depth_z(&self) -> Option<Image<f32>> {
        self.depth_as(DepthKind::Z)
    }

    /// Returns depth as [`Self::depth_z`] does, but measured along `kind`.
    pub fn depth_as(&self, kind: DepthKind) -> Option<Image<f32>> {
        let depth = self.depth.as_ref()?;
        let (width, height) = depth.size();
        let mut out = Image::filled(width, height, 0.0);
        for (i, out) in out.data.iter_mut().enumerate() {
            let (column, row) = (i % width, i / width);
            if let Some(value) = depth.value_at(column, row) {
                let per_z = |kind| length_per_z(&self.camera.intrinsics, kind, column, row);
                *out = (value / per_z(depth.kind) * per_z(kind)) as f32;
            }
        }
        Some(out)
    }
}

impl ColorBuffer<'_> {
    fn image(&self, size: (u32, u32)) -> Result<Image<[u8; 4]>, FrameProblem> {
        let pixels = match *self {
            Self::Rgb8(bytes) => {
                check_length("bytes of RGB colour", bytes.len(), size, 3)?;
                bytes.as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, u8::MAX]).collect()
            }
            Self::Rgba8(bytes) => {
                check_length("bytes of RGBA colour", bytes.len(), size, 4)?;
                bytes.as_chunks().0.to_vec()
            }
        };
        Ok(Image::from_vec(size.0 as usize, size.1 as usize, pixels))
    }
}

impl DepthBuffer<'_> {
    fn depth(&self, size: (u32, u32)) -> Result<Depth, FrameProblem> {
        check_length("lengths of depth", self.lengths.len(), size, 1)?;
        let [near, far] = self.trusted;
        // Negated, so that NaN is refused as well.
        if !(near >= 0.0 && near < far) {
            return Err(FrameProblem::TrustedDepth { near, far });
        }
        let lengths = Image::from_vec(size.0 as usize, size.1 as usize, self.lengths.to_vec());
        let codes = DepthCodes::Lengths(lengths);
        let depth = Depth { codes, kind: self.kind, trusted: self.trusted, units_per_metre: 1.0 };
        depth.check(size)?;
        Ok(depth)
    }
}

fn check_length(
    what: &'static str,
    found: usize,
    (width, height): (u32, u32),
    per_pixel: usize,
) -> Result<(), FrameProblem> {
    let expected = width as usize * height as usize * per_pixel;
    match found == expected {
        true => Ok(()),
        false => Err(FrameProblem::BufferSize { what, size: (width, height), expected, found }),
    }
}

/// Returns the camera of a photograph, scaled to the photograph's size (columns, rows). A calibrated
/// camera takes precedence over the recorded one.
pub(super) fn photographed_by(
    recorded: Option<ColorCamera>,
    calibrated: Option<&ColorCamera>,
    size: [u32; 2],
) -> Option<ColorCamera> {
    calibrated.copied().or(recorded).map(|camera| camera.scaled_to(size))
}

/// Returns the ratio of a length measured along `kind` to depth along the optical axis, at a pixel. It
/// is 1 for [`DepthKind::Z`].
pub(super) fn length_per_z(k: &Intrinsics, kind: DepthKind, column: usize, row: usize) -> f64 {
    match kind {
        DepthKind::RayDistance => k.ray(column, row).length(),
        DepthKind::Z => 1.0,
    }
}
