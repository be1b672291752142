//! Compares the image size of a calibration's colour camera with a dataset's photographs.
//!
//! Photographs are often downscaled while the calibration of the originals is reused: a camera of the same
//! aspect ratio is scaled ([`ColorCamera::scaled_to`]). Another aspect ratio means cropping or another
//! camera; no scale is right then.

use super::calibration::ColorCamera;
use super::entry::DatasetSplit;
use super::error::DatasetError;
use crate::math::camera::Intrinsics;
use std::fmt;

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
    "calibration: `size`: expected {}×{}, the size of the photograph of {frame}, or a size of the same aspect ratio, found {}×{}; give a calibration of these photographs",
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
        let Some(calibrated) = camera.size else { return Ok(None) };
        let mut scaled = None;
        for frame in &self.frames {
            let k = frame.photo_camera(None).intrinsics;
            let found = [k.width, k.height];
            if !have_same_aspect_ratio(calibrated, found) {
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

fn have_same_aspect_ratio(one: [u32; 2], other: [u32; 2]) -> bool {
    // Products of two sides may exceed 32 bits.
    let ([w, h], [width, height]) = (one.map(i64::from), other.map(i64::from));
    // Downscaling rounds each side by up to half a pixel.
    (w * height - h * width).abs() < w.max(h).max(width).max(height)
}

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

#[cfg(test)]
mod tests {
    use super::*;

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
