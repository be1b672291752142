//! Camera corrections that a recording's files lack: pose of the colour camera, depth bias, exposure of
//! each frame. Stored as a RON file that users may edit.
//!
//! Loading a frame applies none of them: a frame holds what its files hold, and the surface stage corrects
//! it (depth in `surface::planes`, colour in `surface::color_lookup`). So evaluation compares with the
//! original photographs, and a calibration search decodes each image once.
//!
//! Corrected depth is `ℓ' = scale·ℓ + offset`, measured along the ray or the optical axis as in the files.
//! The colour camera is expressed in the depth camera's frame because a recording's poses are the depth
//! camera's.

use super::folder::read_settings;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Corrections for the cameras of a dataset; [`Calibration::NONE`] changes nothing.
///
/// ```
/// use vbgs_studio::dataset::calibration::Calibration;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("camera.ron");
/// std::fs::write(&path, "(depth_offset: 0.004)")?;
/// let calibration = Calibration::read(&path)?;
/// assert_eq!((calibration.depth_offset, calibration.depth_scale), (0.004, 1.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
// Users edit this file: a misspelt field must not be a correction that is silently ignored.
#[serde(default, deny_unknown_fields)]
pub struct Calibration {
    /// Camera of the colour images; `None` selects the camera from the dataset's files. If the files
    /// describe no camera, colours are assumed to be registered to depth pixel by pixel.
    pub color_camera: Option<ColorCamera>,
    /// Offset added to every depth after scaling, world units, along the direction of measurement in the
    /// files.
    pub depth_offset: f64,
    /// Factor by which every depth is multiplied; positive.
    pub depth_scale: f64,
    /// Colour gains, one entry per frame with known exposure. Colours of other frames stay unchanged.
    pub exposure: Vec<FrameGain>,
}

/// Pinhole camera of the colour images, rigidly attached to the depth camera.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ColorCamera {
    /// Focal lengths, pixels of the colour image.
    pub focal: [f64; 2],
    /// Principal point, pixels of the colour image.
    pub principal: [f64; 2],
    /// Position in the depth camera's frame (x right, y down, z forward), world units.
    pub offset: [f64; 3],
    /// Rotation vector (axis times angle, radians) from the colour camera's axes to the depth camera's.
    #[serde(default)]
    pub rotation: [f64; 3],
    /// Columns and rows of the colour image; `None` if they equal those of the depth image.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub size: Option<[u32; 2]>,
}

/// Colour gains that correct the exposure of one frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameGain {
    /// Name of the frame within its split.
    pub frame: String,
    /// Positive factors on red, green and blue; corrected colours are clamped to 1.
    pub gain: [f64; 3],
}

/// Reason why a calibration cannot be used.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum CalibrationError {
    /// The file cannot be read.
    #[error("{}: expected a calibration file, found: {source}; check the path and its permissions", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// The file is not a calibration.
    #[error("{}: expected a calibration (RON, such as (depth_offset: 0.004)), found: {source}; correct this place", path.display())]
    Parse { path: PathBuf, source: Box<ron::error::SpannedError> },
    /// A number is outside its range.
    #[error("calibration: `{setting}`: expected {expected}, found {found}; correct it")]
    Value { setting: String, expected: &'static str, found: String },
    /// The calibration cannot be written as RON.
    #[error(transparent)]
    Ron(#[from] ron::Error),
}

impl Calibration {
    /// Calibration without corrections: colour camera and depth as in the files, no exposure gains.
    pub const NONE: Self =
        Self { color_camera: None, depth_offset: 0.0, depth_scale: 1.0, exposure: Vec::new() };

    /// Reads and checks a RON file.
    ///
    /// # Errors
    /// Every [`CalibrationError`] except [`CalibrationError::Ron`].
    pub fn read(path: &Path) -> Result<Self, CalibrationError> {
        let text = read_settings(path)
            .map_err(|source| CalibrationError::Read { path: path.to_owned(), source })?;
        let calibration: Self = options().from_str(&text).map_err(|source| {
            CalibrationError::Parse { path: path.to_owned(), source: Box::new(source) }
        })?;
        calibration.check()?;
        Ok(calibration)
    }

    /// Serialises to the text that [`Self::read`] parses.
    ///
    /// # Errors
    /// [`CalibrationError::Value`] if a number is out of range.
    pub fn to_text(&self) -> Result<String, CalibrationError> {
        self.check()?;
        Ok(options().to_string_pretty(self, ron::ser::PrettyConfig::new())?)
    }

    /// Checks that every number is in range.
    ///
    /// # Errors
    /// [`CalibrationError::Value`] for the first number that is out of range.
    pub fn check(&self) -> Result<(), CalibrationError> {
        let all = |setting: &str, values: &[f64], expected, is_legal: fn(f64) -> bool| {
            let Some(found) = values.iter().find(|v| !is_legal(**v)) else { return Ok(()) };
            let (setting, found) = (setting.to_owned(), found.to_string());
            Err(CalibrationError::Value { setting, expected, found })
        };
        let is_positive = |v: f64| v.is_finite() && v > 0.0;
        all("depth_offset", &[self.depth_offset], "a finite length", f64::is_finite)?;
        all("depth_scale", &[self.depth_scale], "a positive number", is_positive)?;
        if let Some(camera) = &self.color_camera {
            all("focal", &camera.focal, "positive numbers of pixels", is_positive)?;
            all("principal", &camera.principal, "finite numbers of pixels", f64::is_finite)?;
            all("offset", &camera.offset, "finite lengths", f64::is_finite)?;
            all("rotation", &camera.rotation, "finite angles in radians", f64::is_finite)?;
            let size = camera.size.unwrap_or([1; 2]).map(f64::from);
            all("size", &size, "positive numbers of pixels", is_positive)?;
        }
        for FrameGain { frame, gain } in &self.exposure {
            all(&format!("gain of {frame}"), gain, "positive numbers", is_positive)?;
        }
        Ok(())
    }

    /// Returns the gains of red, green and blue of the frame with this name; 1 for an unlisted frame.
    pub fn gain(&self, frame: &str) -> [f64; 3] {
        self.exposure.iter().find(|e| e.frame == frame).map_or([1.0; 3], |e| e.gain)
    }
}

impl Default for Calibration {
    fn default() -> Self {
        Self::NONE
    }
}

// Lets users omit `Some(..)`.
fn options() -> ron::Options {
    ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME)
}

impl ColorCamera {
    /// Colour camera of the 7-Scenes Kinect, whose colour images are not registered to depth. Lengths
    /// are in metres. The values minimise the variance of colour within the components of trained models
    /// (`dataset.md`, Colour camera).
    pub const KINECT: Self = Self {
        focal: [522.0, 522.0],
        principal: [320.0, 238.5],
        offset: [0.023, 0.0015, 0.0],
        rotation: [0.0; 3],
        size: None,
    };

    /// Returns the colour camera of photographs of `size` taken through the lens of the depth camera,
    /// as by phones.
    pub(super) fn from_depth_intrinsics(depth: &Intrinsics, size: [u32; 2]) -> Self {
        let camera = Self {
            focal: [depth.fx, depth.fy],
            principal: [depth.cx, depth.cy],
            offset: [0.0; 3],
            rotation: [0.0; 3],
            size: Some([depth.width, depth.height]),
        };
        camera.scaled_to(size)
    }

    /// Scales the intrinsics to images of `size` (columns, rows). If no size is stored, the intrinsics
    /// are unchanged.
    pub fn scaled_to(self, size: [u32; 2]) -> Self {
        let [own_width, own_height] = self.size.unwrap_or(size).map(f64::from);
        let [width, height] = size.map(f64::from);
        // One factor per axis: sides are rounded separately when an image is scaled.
        let ([sx, sy], [fx, fy], [cx, cy]) =
            ([width / own_width, height / own_height], self.focal, self.principal);
        Self { focal: [fx * sx, fy * sy], principal: [cx * sx, cy * sy], size: Some(size), ..self }
    }

    pub(super) fn with_extrinsics_between(self, depth: &Pose, color: &Pose) -> Self {
        let (offset, turn) = depth.offset_to(color);
        Self { offset: offset.to_array(), rotation: turn.to_scaled_axis().to_array(), ..self }
    }

    /// Returns world pose and intrinsics of the colour camera, given the depth camera.
    pub fn camera_at(&self, depth: &Camera) -> Camera {
        let offset = DVec3::from_array(self.offset);
        Camera {
            intrinsics: self.intrinsics(depth.intrinsics),
            pose: depth.pose.attached_camera(offset, self.rotation_quat()),
        }
    }

    pub(super) fn intrinsics(&self, depth: Intrinsics) -> Intrinsics {
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal);
        let [width, height] = self.size.unwrap_or([depth.width, depth.height]);
        Intrinsics { width, height, fx, fy, cx, cy }
    }

    pub(super) fn rotation_quat(&self) -> DQuat {
        DQuat::from_scaled_axis(DVec3::from_array(self.rotation))
    }

    pub(super) fn color_from_depth(&self) -> DMat3 {
        // `rotation` maps axes from colour to depth; points map the other way.
        DMat3::from_quat(self.rotation_quat().inverse())
    }

    /// Transforms a point from the depth camera's frame to the colour camera's.
    pub fn to_color_frame(&self, point: DVec3) -> DVec3 {
        self.color_from_depth() * (point - DVec3::from_array(self.offset))
    }

    /// Projects a point in the depth camera's frame to pixel coordinates of the colour image (centres at
    /// +½). Returns `None` for a point behind the colour camera.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let p = self.to_color_frame(point);
        let [focal, principal] = [self.focal, self.principal].map(DVec2::from_array);
        (p.z > 0.0).then(|| focal * p.truncate() / p.z + principal)
    }
}
