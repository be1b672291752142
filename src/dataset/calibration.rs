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
//!
//! Photographs are often downscaled while the calibration of the originals is reused: a camera of the same
//! aspect ratio is scaled ([`ColorCamera::scaled_to`]). Another aspect ratio means cropping or another
//! camera; no scale is right then.

use super::entry::DatasetSplit;
use super::error::DatasetError;
use super::folder::read_settings;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use glam::{DMat3, DQuat, DVec2, DVec3};
use serde::{Deserialize, Serialize};
use std::fmt;
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

/// Scaling of a calibrated colour camera from the size of the calibrated images to that of the
/// photographs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ScaledCamera {
    /// Columns and rows of the images that were calibrated.
    pub calibrated: [u32; 2],
    /// Columns and rows of the photographs.
    pub found: [u32; 2],
}

impl fmt::Display for ScaledCamera {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([w, h], [width, height]) = (self.calibrated, self.found);
        write!(
            f,
            "the calibration's colour camera is for images of {w}×{h} and is scaled to photographs of {width}×{height}"
        )
    }
}

/// Error: the images of a calibrated colour camera have another aspect ratio than the photographs.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "calibration: `size`: expected {}×{}, the size of the photograph of {frame}, or a stated size of the same aspect ratio, found {}×{}; give a calibration of these photographs",
    found[0], found[1], calibrated[0], calibrated[1]
)]
pub struct AspectRatioMismatch {
    /// Name of the first frame whose photograph has another aspect ratio.
    pub frame: String,
    /// Columns and rows of the photograph of `frame`.
    pub found: [u32; 2],
    /// Columns and rows of the images that were calibrated.
    pub calibrated: [u32; 2],
}

impl DatasetSplit {
    /// Returns the scaling that fits a calibration's colour camera to the photographs; `None` if no
    /// scaling is needed.
    ///
    /// # Errors
    /// [`AspectRatioMismatch`] for the first photograph whose aspect ratio differs.
    pub fn camera_scaling(
        &self,
        camera: &ColorCamera,
    ) -> Result<Option<ScaledCamera>, AspectRatioMismatch> {
        let mut scaled = None;
        for frame in &self.frames {
            let k = frame.photo_camera(None).intrinsics;
            let found = [k.width, k.height];
            let [cx, cy] = camera.principal;
            // Without a size, the principal point shows that images of another size were calibrated.
            let is_fitting = camera.size.map_or_else(
                || check_centre(&Intrinsics { cx, cy, ..k }).is_ok(),
                |size| have_same_aspect_ratio(size, found),
            );
            let centred = || camera.principal.map(|c| (2.0 * c).round() as u32);
            let calibrated =
                camera.size.unwrap_or_else(|| if is_fitting { found } else { centred() });
            if !is_fitting {
                return Err(AspectRatioMismatch { frame: frame.name.clone(), found, calibrated });
            }
            if found != calibrated {
                // The first one is reported; the loop goes on to check every aspect ratio.
                scaled = scaled.or(Some(ScaledCamera { calibrated, found }));
            }
        }
        Ok(scaled)
    }
}

pub(super) fn have_same_aspect_ratio(one: [u32; 2], other: [u32; 2]) -> bool {
    // Products of two sides may exceed 32 bits.
    let ([w, h], [width, height]) = (one.map(i64::from), other.map(i64::from));
    // Downscaling rounds each side by up to half a pixel.
    (w * height - h * width).abs() < w.max(h).max(width).max(height)
}

/// Largest number of pixels of a camera, twice that of any phone.
const MAX_PIXELS: u64 = 1 << 28;

pub(super) struct IntrinsicsDefect {
    pub expected: String,
    pub found: String,
    pub hint: &'static str,
}

pub(super) fn is_plausible_field_of_view(degrees: f64) -> bool {
    degrees > 0.1 && degrees < 179.0
}

pub(super) fn from_user(
    [fx, fy, cx, cy]: [f64; 4],
    size: (u32, u32),
) -> Result<Intrinsics, DatasetError> {
    let k = Intrinsics { width: size.0, height: size.1, fx, fy, cx, cy };
    check(&k).map_err(|defect| DatasetError::Option {
        setting: "intrinsics",
        expected: "focal lengths and principal point in pixels, for images of this size",
        // The hint of a file's intrinsics does not apply to a setting.
        found: defect.found,
    })?;
    Ok(k)
}

/// Checks that a real camera can have the field of view and principal point of the intrinsics. The
/// bounds catch wrong units (degrees for radians, metres for pixels) and intrinsics for images of
/// another size. They accept unusual lenses.
pub(super) fn check(k: &Intrinsics) -> Result<(), IntrinsicsDefect> {
    if u64::from(k.width) * u64::from(k.height) > MAX_PIXELS {
        return Err(IntrinsicsDefect {
            expected: format!("an image of at most {} megapixels", MAX_PIXELS >> 20),
            found: format!("{}x{}", k.width, k.height),
            hint: "correct the size, which is in pixels",
        });
    }
    for (axis, fov) in [("horizontal", k.fov_x()), ("vertical", k.fov_y())] {
        let degrees = fov.to_degrees();
        if !is_plausible_field_of_view(degrees) {
            return Err(IntrinsicsDefect {
                expected: format!("a {axis} field of view between 0.1 and 179 degrees"),
                found: format!("{degrees:.4} degrees (focal lengths {} and {})", k.fx, k.fy),
                hint: "correct the focal length, which is in pixels",
            });
        }
    }
    // False for NaN.
    let inside = |c: f64, size: u32| c >= 0.0 && c <= f64::from(size);
    if !(inside(k.cx, k.width) && inside(k.cy, k.height)) {
        return Err(IntrinsicsDefect {
            expected: format!("a principal point inside the {}x{} image", k.width, k.height),
            found: format!("({}, {})", k.cx, k.cy),
            hint: "use the intrinsics that belong to images of this size",
        });
    }
    Ok(())
}

/// Distance of a principal point from the image centre, as a fraction of the side, at which intrinsics
/// may belong to images of another size. Lenses are centred to within a few hundredths.
const OFF_CENTRE: f64 = 0.1;
/// Least distance along one side if the distances along both sides differ; equal ones tell of a scale.
const FAR_OFF_CENTRE: f64 = 0.2;

/// Refuses intrinsics for images of another size: the principal point is off the centre towards one
/// corner, by the same fraction of both sides or far.
pub(super) fn check_centre(k: &Intrinsics) -> Result<(), IntrinsicsDefect> {
    let [x, y] = [k.cx / f64::from(k.width), k.cy / f64::from(k.height)].map(|at| at - 0.5);
    let least = if (x - y).abs() < 0.5 * OFF_CENTRE { OFF_CENTRE } else { FAR_OFF_CENTRE };
    if x * y <= 0.0 || x.abs().min(y.abs()) < least {
        return Ok(());
    }
    Err(IntrinsicsDefect {
        expected: format!(
            "a principal point near the centre of the {}x{} image",
            k.width, k.height
        ),
        found: format!("({}, {}), the centre of {:.0}x{:.0}", k.cx, k.cy, 2.0 * k.cx, 2.0 * k.cy),
        hint: "use the intrinsics that belong to images of this size, or give them with --intrinsics",
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn centres_of_other_sizes_are_told_from_lenses_off_centre() {
        let at = |cx, cy| {
            let k = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 500.0, cx, cy };
            check_centre(&k).is_ok()
        };
        assert!(at(320.0, 240.0) && at(350.0, 270.0) && at(330.0, 470.0) && at(630.0, 20.0));
        for (cx, cy) in [(160.0, 120.0), (640.0, 480.0), (400.0, 300.0), (640.0, 360.0)] {
            assert!(!at(cx, cy), "({cx}, {cy})");
        }
    }

    #[test]
    fn sizes_of_one_shape_differ_by_less_than_a_pixel() {
        for scaled in [[960, 720], [1920, 1440], [641, 481], [3, 2], [5760, 4321]] {
            assert!(have_same_aspect_ratio([1920, 1440], scaled), "{scaled:?}");
        }
        for other in [[1920, 1080], [1440, 1920], [640, 478], [1920, 1442]] {
            assert!(!have_same_aspect_ratio([1920, 1440], other), "{other:?}");
        }
    }
}
