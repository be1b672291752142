//! Enumerated settings of the `paper` preset, with their spelling in files and on the command line.

use crate::model::splat::splats::CovarianceForm;
use crate::train::setting::value::{Choice, SettingValue, ValueError, named_values};
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use strum::{EnumString, VariantNames};

/// Maximum number of candidates per point; larger numbers should use the dense E-step.
pub const MAX_CANDIDATES: usize = 1024;

/// Serialized form of a setting that is a number or a word.
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
    /// The components whose initial spatial means are nearest, in number.
    Nearest(usize),
}

/// Number of points processed at once: a number, or `frame`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "NumberOrWord", try_from = "NumberOrWord")]
pub enum Batch {
    /// The whole frame.
    Frame,
    /// This many points, rounded up to whole tiles of at most 64.
    Points(usize),
}

macro_rules! number_or_word {
    ($setting:ident, $number:ident, $word:ident, $text:literal) => {
        impl From<$setting> for NumberOrWord {
            fn from(setting: $setting) -> Self {
                match setting {
                    $setting::$word => Self::Word($text.to_owned()),
                    $setting::$number(n) => Self::Number(n),
                }
            }
        }

        impl TryFrom<NumberOrWord> for $setting {
            type Error = String;

            fn try_from(text: NumberOrWord) -> Result<Self, String> {
                match text {
                    NumberOrWord::Number(n) => Ok(Self::$number(n)),
                    NumberOrWord::Word(word) => word.parse(),
                }
            }
        }

        impl std::str::FromStr for $setting {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                match text {
                    $text => Ok(Self::$word),
                    _ => text
                        .parse()
                        .map(Self::$number)
                        .map_err(|_| format!("expected a number or `{}`, found `{text}`", $text)),
                }
            }
        }
    };
}

impl Candidates {
    /// True if the number is within the permitted range.
    pub fn is_legal(&self) -> bool {
        match self {
            Self::Dense => true,
            Self::Nearest(n) => (1..=MAX_CANDIDATES).contains(n),
        }
    }
}

number_or_word!(Candidates, Nearest, Dense, "dense");
number_or_word!(Batch, Points, Frame, "frame");

/// Source of the initial means (`train.md`, Initial means).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Init {
    /// Uniform in the normalised cube, independent of the data.
    Random,
    /// Points of the first frame.
    Data,
}

/// Time and scores by which unused components move (`train.md`, Reassignment).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ReassignPolicy {
    /// Never.
    Off,
    /// Before the fit, by scores against all components.
    Dense,
    /// Before the fit, by truncated scores, among the worst-explained points.
    Truncated,
    /// Like `Truncated`, in buffers of fixed capacity allocated before the first frame; the paper's
    /// default.
    Padded,
    /// After the fit, by the scores of the fit; affects the next frame.
    Forwarded,
}

/// Memory layout between responsibilities and their weighted sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum StatisticsForm {
    /// A tile's responsibilities are summed directly and stay in the CPU caches.
    Fused,
    /// Candidates, scores and responsibilities of a whole batch are stored before they are summed.
    Unfused,
}

/// Index for the candidate search.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum IndexKind {
    /// A uniform grid searched tile by tile.
    Grid,
    /// `kiddo`'s KD-tree, rebuilt every frame and queried point by point; the reference.
    KdTree,
}

named_values!(by text Candidates, Batch);
named_values!(by name StatisticsForm, IndexKind);

named_values!(by name Init {
    "random" "Random" "Uniform over the scene's range, independent of the data";
    "data" "First frame" "Points of the first frame";
});

named_values!(by name ReassignPolicy {
    "off" "Off" "Unused components stay where they are";
    "dense" "Dense" "Before the fit, by a pass over all points and components: slow";
    "truncated" "Truncated" "Before the fit, by a pass over each point's candidates";
    "padded" "Padded" "As truncated, in memory reserved before the first frame; the paper's default";
    "forwarded" "Forwarded" "After the fit, by its scores; takes effect with the next frame";
});

/// The command line names whole conversions, files only their decomposition.
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
