//! Why a scene cannot begin.

use crate::train::setting::ConfigError;

/// Why a scene cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting out of range.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// No pixel of the sampled frames is a point.
    #[error(
        "{dataset}: expected depth within the trusted {trusted}, found {found} in {frames} sampled frames and not one usable pixel; {advice}"
    )]
    NoPoints {
        /// Name of the dataset.
        dataset: String,
        /// Interval of lengths that training uses, world units.
        trusted: String,
        /// What the depth images hold, world units.
        found: String,
        /// Frames looked at.
        frames: usize,
        /// What to do.
        advice: String,
    },
    /// The structural scale is below what the data can tell apart.
    #[error(
        "--scale: expected at least {least:.2e} world units, the distance that depth noise makes of one surface here, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, say so with --depth-scale"
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
