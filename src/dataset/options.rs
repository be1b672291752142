//! What a user may override when a dataset is opened.

use super::error::DatasetError;

/// What a user may override when a dataset is opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoadOptions {
    /// World units per step of 16-bit depth, instead of what the dataset says.
    pub depth_scale: Option<f64>,
    /// Nearest and farthest depth that training trusts, world units, instead of the layout's.
    pub depth_range: Option<[f64; 2]>,
}

impl LoadOptions {
    /// Whether every number lies in its range.
    pub(super) fn check(&self) -> Result<(), DatasetError> {
        // Both are negated, so that NaN is refused too; an infinite far end is legal.
        if let Some(scale) = self.depth_scale.filter(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(DatasetError::Option {
                setting: "depth scale",
                expected: "a positive number of world units per code",
                found: scale.to_string(),
            });
        }
        if let Some([near, far]) = self.depth_range.filter(|[a, b]| !(*a >= 0.0 && a < b)) {
            return Err(DatasetError::Option {
                setting: "depth range",
                expected: "0 ≤ near < far in world units",
                found: format!("{near} to {far}"),
            });
        }
        Ok(())
    }
}
