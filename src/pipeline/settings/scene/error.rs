//! Why a scene cannot begin.

use crate::dataset::calibrated_size::OtherShape;
use crate::dataset::surface::sample::NoUsableDepth;
use crate::train::setting::ConfigError;

/// Why a scene cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting out of range.
    #[error("{0}")]
    Config(#[from] ConfigError),
    /// No pixel of the sampled frames is a point.
    #[error(transparent)]
    NoPoints(#[from] NoUsableDepth),
    /// The calibration is of other photographs.
    #[error("{0}")]
    Photographs(#[from] OtherShape),
    /// The structural scale is below what the data can tell apart.
    #[error(
        "structural scale: expected at least {least:.2e} world units, the distance that depth noise makes of one surface here, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, set the depth scale and range in it"
    )]
    BelowNoise {
        /// Least scale.
        least: f64,
        /// Scale asked for.
        found: f64,
        /// Depth below which a twentieth of the points lie.
        near: f64,
        /// Depth above which a twentieth of the points lie.
        far: f64,
    },
}
