//! Intrinsics that no camera has.

use crate::math::camera::Intrinsics;

/// What is wrong with intrinsics, in the words of a message.
pub(super) struct IntrinsicsDefect {
    pub expected: String,
    pub found: String,
    pub hint: &'static str,
}

/// Whether a pinhole camera can have this field of view: between 0.1 and 179 degrees.
pub(super) fn is_sane_field_of_view(degrees: f64) -> bool {
    degrees > 0.1 && degrees < 179.0
}

/// Refuses intrinsics that no camera has. Both bounds catch mistakes of unit rather than odd lenses:
/// degrees written for radians, metres for pixels, a matrix that belongs to images of another size.
pub(super) fn check(k: &Intrinsics) -> Result<(), IntrinsicsDefect> {
    let fov_y = 2.0 * (0.5 * f64::from(k.height) / k.fy).atan();
    for (axis, fov) in [("horizontal", k.fov_x()), ("vertical", fov_y)] {
        let degrees = fov.to_degrees();
        if !is_sane_field_of_view(degrees) {
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
