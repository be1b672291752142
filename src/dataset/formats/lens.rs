//! Refuses lens models in frame lists other than a pinhole with Brown–Conrady distortion.

use super::recording::metadata_error;
use crate::dataset::error::DatasetError;
use serde_json::Value;
use std::path::Path;

/// Models with the terms `k1`, `k2`, `k3`, `p1` and `p2`, or none.
const KNOWN_MODELS: [&str; 7] = [
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "RADIAL",
    "SIMPLE_RADIAL",
    "PERSPECTIVE",
    "FULL_OPENCV",
];
/// Terms of other models, unless zero.
const OTHER_TERMS: [&str; 6] = ["k4", "k5", "k6", "skew", "sk_x", "sk_y"];
/// Flags of other models.
const OTHER_FLAGS: [&str; 2] = ["is_fisheye", "fisheye"];

/// Refuses a camera that is not perspective, according to a frame or the list that contains it.
pub(super) fn check_model(frame: &Value, list: &Value, file: &Path) -> Result<(), DatasetError> {
    let said = |key: &str| frame.get(key).or_else(|| list.get(key));
    let model = said("camera_model").and_then(Value::as_str);
    let other_model = model.filter(|model| !KNOWN_MODELS.contains(model));
    let other_term = OTHER_TERMS.iter().find(|key| {
        // A value that is not a number does not count as zero.
        said(key).is_some_and(|value| value.as_f64() != Some(0.0))
    });
    let other_flag =
        OTHER_FLAGS.iter().find(|key| said(key).and_then(Value::as_bool) == Some(true));
    let found = match (other_model, other_term.or(other_flag)) {
        (Some(model), _) => format!("`camera_model` {model}"),
        (None, Some(key)) => format!("`{key}` {}", said(key).unwrap_or(&Value::Null)),
        (None, None) => return Ok(()),
    };
    let expected = "a perspective camera with k1, k2, k3, p1, p2";
    Err(metadata_error(file, expected, found, "undistort the images to a pinhole first"))
}
