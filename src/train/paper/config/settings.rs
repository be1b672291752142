//! Enumerated settings of the `paper` preset, with their spelling in files and on the command line.

use super::PaperConfig;
use crate::model::splat::splats::CovarianceForm;
use crate::train::setting::value::{Choice, SettingValue, ValueError, named_values};
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::ffi::OsStr;
use std::str::FromStr;
use strum::EnumString;

pub use crate::model::paper::totals::UpdateWidth;

/// Maximum number of candidates per point. The alternative for larger numbers is [`Candidates::Dense`].
pub const MAX_CANDIDATES: usize = 1024;

/// Serialised form of a setting that is a number or a word.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum NumberOrWord {
    Number(usize),
    Word(String),
}

/// Components that each point is compared with: a number, or `dense`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "NumberOrWord", try_from = "NumberOrWord")]
pub enum Candidates {
    /// All components.
    Dense,
    /// The components with the nearest initial spatial means; the value is their number.
    Nearest(usize),
}

impl From<Candidates> for NumberOrWord {
    fn from(setting: Candidates) -> Self {
        match setting {
            Candidates::Dense => Self::Word("dense".to_owned()),
            Candidates::Nearest(n) => Self::Number(n),
        }
    }
}

impl TryFrom<NumberOrWord> for Candidates {
    type Error = String;

    fn try_from(text: NumberOrWord) -> Result<Self, String> {
        match text {
            NumberOrWord::Number(n) => Ok(Self::Nearest(n)),
            NumberOrWord::Word(word) => word.parse(),
        }
    }
}

impl FromStr for Candidates {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "dense" => Ok(Self::Dense),
            _ => text
                .parse()
                .map(Self::Nearest)
                .map_err(|_| format!("expected a number or `dense`, found `{text}`")),
        }
    }
}

impl Candidates {
    /// True if the number of candidates is within the permitted range. Always true for [`Self::Dense`].
    pub fn is_legal(&self) -> bool {
        match self {
            Self::Dense => true,
            Self::Nearest(n) => (1..=MAX_CANDIDATES).contains(n),
        }
    }
}

/// Source of the initial means (`training.md`, Initial means).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Init {
    /// Positions uniform in the normalised cube, independent of the data.
    Random,
    /// Points of the first frame.
    Data,
}

/// When unused components move to badly explained points, and by which scores (`training.md`,
/// Reassignment).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ReassignPolicy {
    /// Unused components never move.
    Off,
    /// Move before the fit, by scores against all components.
    Dense,
    /// Move before the fit, by scores against the candidates, to points among the worst explained; the
    /// paper's default.
    Padded,
    /// Move after the fit, by the scores of the fit; takes effect with the next frame.
    Forwarded,
}

named_values!(by text Candidates);

named_values!(by name Init {
    "random" "Random" "Uniform over the scene's range, independent of the data";
    "data" "First frame" "Points of the first frame";
});

named_values!(by name ReassignPolicy {
    "off" "Off" "Unused components stay where they are";
    "dense" "Dense" "Before the fit, by a pass over all points and components: slow";
    "padded" "Padded" "Before the fit, by a pass over each point's candidates; the paper's default";
    "forwarded" "Forwarded" "After the fit, by its scores; takes effect with the next frame";
});

/// Lists and parses the names of complete conversions from covariance to splat, as given on the command
/// line. Files store only the decomposition of the covariance.
impl SettingValue for CovarianceForm {
    fn choices() -> Vec<Choice> {
        let (right, legacy) = (
            "Eigen-decomposition, scale 1, unused components dropped",
            "As the reference exporter: Cholesky rows, scale 1.41, unused components kept",
        );
        vec![
            Choice { name: "right", label: "Right", help: right },
            Choice { name: "legacy-cov", label: "As the reference", help: legacy },
        ]
    }

    fn parse(text: &OsStr) -> Result<Self, ValueError> {
        match text.to_str() {
            Some("right") => Ok(Self::Eigen),
            Some("legacy-cov") => Ok(Self::LegacyCholesky),
            _ => Err(ValueError::Text("expected right or legacy-cov".to_owned())),
        }
    }
}

/// A named choice of [`Operations`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Precision {
    /// f64 throughout, including points and means: the reference.
    F64,
    /// f32 in inner loops with coordinates relative to a local centre, and 64-bit fixed-point totals.
    Mixed,
    /// Arithmetic chosen by operation, see [`Operations`].
    #[strum(disabled)]
    Custom,
}

named_values!(by name Precision {
    "f64" "Double" "Double precision throughout, the reference";
    "mixed" "Mixed" "Single precision in the loops, exact totals";
});

impl Precision {
    /// Returns the operations of a named precision; `None` for [`Self::Custom`].
    pub fn operations(self) -> Option<Operations> {
        match self {
            Self::F64 => Some(Operations::F64),
            Self::Mixed => Some(Operations::MIXED),
            Self::Custom => None,
        }
    }
}

/// Number type of one operation on f32 points and means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Width {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

/// Arithmetic of the inner loops, by operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Operations {
    /// Squared distances by which candidates are ranked.
    pub distance: Width,
    /// Scores `q` of the candidates.
    pub log_score: Width,
    /// Exponentials of scores and their sum.
    pub normaliser: Width,
    /// Sums over the points of a tile.
    pub moments: Width,
    /// Addition of a tile's sums to the totals.
    pub update: UpdateWidth,
}

impl Operations {
    /// All inner loops in f64, with 128-bit fixed-point totals.
    pub const F64: Self = Self::all(Width::F64, UpdateWidth::Fixed128);
    /// All inner loops in f32, with 64-bit fixed-point totals.
    pub const MIXED: Self = Self::all(Width::F32, UpdateWidth::Fixed64);

    /// Returns operations with the number type `width` for all inner loops and `update` for the totals.
    pub const fn all(width: Width, update: UpdateWidth) -> Self {
        Self { distance: width, log_score: width, normaliser: width, moments: width, update }
    }
}

impl SettingValue for Operations {
    fn parse(_: &OsStr) -> Result<Self, ValueError> {
        Err(ValueError::Text("expected `operations` in the file given by --config".to_owned()))
    }
}

// With `remote = "Self"` on the type, these calls resolve to the derived inherent functions.
impl Serialize for PaperConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        PaperConfig::serialize(self, serializer)
    }
}

impl<'de> Deserialize<'de> for PaperConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        PaperConfig::deserialize(deserializer)?.check().map_err(Error::custom)
    }
}
