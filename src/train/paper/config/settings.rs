//! The choices a configuration is made of, as files and the command line spell them.

use crate::model::splat::splats::CovarianceForm;
use crate::train::setting::value::{Choice, SettingValue, ValueError, named_values};
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use strum::{EnumString, VariantNames};

/// Most candidates per point; beyond this the dense E-step is meant.
pub const MAX_CANDIDATES: usize = 1024;

/// A number or one word, as a setting that allows both is written.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum NumberOrWord {
    Number(usize),
    Word(String),
}

/// Which components a point is compared with; a number or `dense` in files and on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "NumberOrWord", try_from = "NumberOrWord")]
pub enum Candidates {
    /// All of them.
    Dense,
    /// The C components whose initial spatial means are nearest.
    Nearest(usize),
}

/// Points that pass through the engine at once; a number or `frame`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "NumberOrWord", try_from = "NumberOrWord")]
pub enum Batch {
    /// All of a frame.
    Frame,
    /// So many, rounded up to whole tiles of at most 64.
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
    /// Whether there are as many as a point may have.
    pub fn is_legal(&self) -> bool {
        match self {
            Self::Dense => true,
            Self::Nearest(n) => (1..=MAX_CANDIDATES).contains(n),
        }
    }
}

number_or_word!(Candidates, Nearest, Dense, "dense");
number_or_word!(Batch, Points, Frame, "frame");

/// Where the initial means come from (`train.md`, Initial means).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Init {
    /// Uniform in the normalised cube, independent of the data.
    Random,
    /// Points of the first frame.
    Data,
}

/// When and by which scores unused components move (`train.md`, Reassignment).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ReassignPolicy {
    /// Never.
    Off,
    /// Before the fit, from a dense pass over every point.
    Dense,
    /// Before the fit, from a truncated pass, among the lowest scores.
    Truncated,
    /// As truncated, in buffers of fixed capacity that are reserved before the first frame: the
    /// paper's default.
    Padded,
    /// After the fit, from the scores of the fit itself; takes effect with the next frame.
    Forwarded,
}

/// What happens between the responsibilities and their weighted sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum StatisticsForm {
    /// A tile's responsibilities are summed at once and never leave the processor's caches.
    Fused,
    /// Candidates, scores and responsibilities of a whole batch are written out before they are
    /// summed.
    Unfused,
}

/// How the nearest components are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum IndexKind {
    /// A uniform grid searched tile by tile.
    Grid,
    /// `kiddo`'s KD-tree, built again every frame and asked point by point: the plain path.
    KdTree,
}

named_values!(by text Candidates, Batch);
named_values!(by name StatisticsForm, IndexKind);

named_values!(by name Init {
    "random" "Random" "Spread over the scene's range, whatever the data";
    "data" "First frame" "Points of the first frame";
});

named_values!(by name ReassignPolicy {
    "off" "Off" "Unused components stay where they are";
    "dense" "Dense" "Before the fit, by a pass over all points and components: slow";
    "truncated" "Truncated" "Before the fit, by a pass over each point's candidates";
    "padded" "Padded" "As truncated, in room that is reserved before the first frame: the paper's";
    "forwarded" "Forwarded" "After the fit, by the fit's own scores; takes effect with the next frame";
});

/// The command line names whole conversions, files their decomposition.
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
