//! Which split trains and which evaluates.

use super::entry::DatasetSplit;
use super::error::DatasetError;
use super::opened::Dataset;

pub use super::entry::{HELD_OUT, HOLD_OUT_EVERY};

/// Preferred training splits among those with depth.
const TRAINING_NAMES: [&str; 2] = ["train", "test"];
/// Preferred evaluation splits; `test` only counts where something else trains.
const EVALUATION_NAMES: [&str; 3] = ["val", "eval", "test"];

/// The views a model is measured on.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Evaluation {
    /// Position in [`Dataset::splits`].
    pub split: usize,
    /// Positions in [`DatasetSplit::frames`], ascending.
    pub frames: Vec<usize>,
    /// Whether these frames belong to the training split and training must leave them out.
    pub held_out: bool,
    /// The choice in one sentence, for the user.
    pub why: String,
}

impl Dataset {
    /// Position of a named split.
    pub fn split_named(&self, name: &str) -> Result<usize, DatasetError> {
        self.splits.iter().position(|s| s.name == name).ok_or_else(|| DatasetError::NoSuchSplit {
            path: self.path.clone().unwrap_or_else(|| self.name.clone().into()),
            asked: name.to_owned(),
            splits: self.split_names(),
        })
    }

    /// Position of the split that training takes unless told otherwise: the one with depth
    /// (NeRF-synthetic: `test`), `train` first if several have it.
    pub fn training_split(&self) -> Result<usize, DatasetError> {
        let named = |name: &&str| self.find(|s| s.has_depth && s.name == *name);
        TRAINING_NAMES.iter().find_map(named).or_else(|| self.find(|s| s.has_depth)).ok_or_else(
            || DatasetError::NoDepth {
                path: self.path.clone().unwrap_or_else(|| self.name.clone().into()),
                splits: self.split_names(),
            },
        )
    }

    /// The views that evaluation takes unless told otherwise, given the split that trains: `val`,
    /// `eval` or `test` if it is another split, else every eighth frame of the training split.
    pub fn evaluation(&self, training_split: usize) -> Evaluation {
        let trained = self.splits.get(training_split).map(|s| s.name.as_str());
        // Depth is not asked for: photographs alone measure colour.
        let other = |name: &&str| self.find(|s| s.name == *name && trained != Some(name));
        if let Some(split) = EVALUATION_NAMES.iter().find_map(other) {
            let frames = (0..self.splits[split].frames.len()).collect();
            let why = format!("all frames of the split `{}`", self.splits[split].name);
            return Evaluation { split, frames, held_out: false, why };
        }
        let n_frames = self.splits.get(training_split).map_or(0, |s| s.frames.len());
        Evaluation {
            split: training_split,
            frames: (0..n_frames).step_by(HOLD_OUT_EVERY).collect(),
            held_out: true,
            why: format!(
                "every {HOLD_OUT_EVERY}th frame, held out of training: the dataset has no split for evaluation"
            ),
        }
    }

    fn find(&self, is_wanted: impl Fn(&DatasetSplit) -> bool) -> Option<usize> {
        self.splits.iter().position(is_wanted)
    }

    fn split_names(&self) -> String {
        self.splits.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ")
    }
}
