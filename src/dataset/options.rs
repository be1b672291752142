//! What a user may override when a dataset is opened.

use super::error::DatasetError;
use super::pose_convention::PoseConvention;

/// What a user may override when a dataset is opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoadOptions {
    /// World units per step of 16-bit depth, instead of what the dataset says.
    pub depth_scale: Option<f64>,
    /// Nearest and farthest depth that training trusts, world units, instead of the layout's.
    pub depth_range: Option<[f64; 2]>,
    /// What the recording's pose matrices mean, instead of what its layout says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub poses: Option<PoseConvention>,
    /// `fx`, `fy`, `cx`, `cy` of the depth image in pixels, instead of what the dataset says or, in
    /// layouts that do not say it, of the known cameras.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub intrinsics: Option<[f64; 4]>,
    /// Least confidence, 0 to 2, of depth that is used, where a sensor tells it; 1 without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub confidence: Option<u8>,
    /// Whether recordings without readable photographs are to be opened all the same, in grey.
    #[serde(default, skip_serializing_if = "is_false")]
    pub geometry_only: bool,
    /// Whether poses are left to tracking: recorded ones are ignored, and none are needed.
    #[serde(default, skip_serializing_if = "is_false")]
    pub track: bool,
}

fn is_false(value: &bool) -> bool {
    !value
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
        let is_camera = |[fx, fy, cx, cy]: &[f64; 4]| {
            fx.is_finite() && fy.is_finite() && *fx > 0.0 && *fy > 0.0 && *cx >= 0.0 && *cy >= 0.0
        };
        if let Some(given) = self.intrinsics.filter(|given| !is_camera(given)) {
            return Err(DatasetError::Option {
                setting: "intrinsics",
                expected: "positive focal lengths and a principal point inside the image, pixels",
                found: format!("{given:?}"),
            });
        }
        if let Some(confidence) = self.confidence.filter(|least| *least > 2) {
            return Err(DatasetError::Option {
                setting: "confidence",
                expected: "0, 1 or 2",
                found: confidence.to_string(),
            });
        }
        Ok(())
    }
}
