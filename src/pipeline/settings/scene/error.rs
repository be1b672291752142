//! Why a scene cannot begin.

use crate::train::setting::ConfigError;

/// What to do about depth of which nothing is usable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DepthAdvice {
    /// The images hold none at all.
    CheckImages,
    /// It looks like another unit, taken for metres.
    OtherUnit {
        /// That unit.
        unit: &'static str,
        /// What the depth scale has to be multiplied by.
        factor: f64,
    },
    /// No usual unit brings it into the trusted range.
    SetUnit,
}

impl std::fmt::Display for DepthAdvice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::CheckImages => f.write_str("check that the depth images belong to this dataset"),
            Self::OtherUnit { unit, factor } => write!(
                f,
                "the depths look like {unit} taken for metres: multiply the depth scale by {factor}, or widen the depth range"
            ),
            Self::SetUnit => {
                f.write_str("set the depth scale to its unit, or widen the depth range")
            }
        }
    }
}

/// Why a scene cannot begin.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A setting out of range.
    #[error("{0}")]
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
        advice: DepthAdvice,
    },
    /// The structural scale is below what the data can tell apart.
    #[error(
        "structural scale: expected at least {least:.2e} world units, the distance that depth noise makes of one surface here, found {found:.2e}; depths run from {near:.2} to {far:.2}: if they are in another unit, set the depth scale"
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
