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
