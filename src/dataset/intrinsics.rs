//! Checks of intrinsics.

use super::error::DatasetError;
use crate::math::camera::Intrinsics;

/// Parts of a message about invalid intrinsics.
pub(super) struct IntrinsicsDefect {
    pub expected: String,
    pub found: String,
    pub hint: &'static str,
}

/// True if a pinhole camera can have this field of view: between 0.1 and 179 degrees.
pub(super) fn is_plausible_field_of_view(degrees: f64) -> bool {
    degrees > 0.1 && degrees < 179.0
}

/// Intrinsics given by the user, for images of `size` (columns, rows).
///
/// # Errors
/// [`DatasetError::Option`] if no camera has them.
pub(super) fn from_user(
    [fx, fy, cx, cy]: [f64; 4],
    size: (u32, u32),
) -> Result<Intrinsics, DatasetError> {
    let k = Intrinsics { width: size.0, height: size.1, fx, fy, cx, cy };
    check(&k).map_err(|defect| DatasetError::Option {
        setting: "intrinsics",
        expected: "focal lengths and principal point in pixels, for images of this size",
        found: defect.found,
    })?;
    Ok(k)
}

/// Refuses intrinsics that no camera has. Both bounds catch errors of unit rather than unusual lenses:
/// degrees for radians, metres for pixels, or a matrix for images of another size.
pub(super) fn check(k: &Intrinsics) -> Result<(), IntrinsicsDefect> {
    let fov_y = 2.0 * (0.5 * f64::from(k.height) / k.fy).atan();
    for (axis, fov) in [("horizontal", k.fov_x()), ("vertical", fov_y)] {
        let degrees = fov.to_degrees();
        if !is_plausible_field_of_view(degrees) {
            return Err(IntrinsicsDefect {
                expected: format!("a {axis} field of view between 0.1 and 179 degrees"),
                found: format!("{degrees:.4} degrees (focal lengths {} and {})", k.fx, k.fy),
                hint: "correct the focal length, which is in pixels",
            });
        }
    }
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
