//! Errors of starting a scene.

use crate::dataset::calibrated_size::AspectRatioMismatch;
use crate::dataset::surface::sample::NoUsableDepth;
use crate::train::setting::ConfigError;

/// Reason why a scene cannot start.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting is out of range.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// No pixel of the sampled frames gives a point.
    #[error(transparent)]
    NoPoints(#[from] NoUsableDepth),
    /// The calibration is for photographs of another shape.
    #[error("{0}")]
    Photographs(#[from] AspectRatioMismatch),
    /// The structural scale is below the depth noise.
    #[error(
        "structural scale: expected at least {least:.2e} world units, the apparent thickness of a surface due to depth noise, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, set the depth scale and range in it"
    )]
    BelowNoise {
        /// Minimum scale, in world units.
        least: f64,
        /// Requested scale, in world units.
        found: f64,
        /// 5 % quantile of depth.
        near: f64,
        /// 95 % quantile of depth.
        far: f64,
    },
}
