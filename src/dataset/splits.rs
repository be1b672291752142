//! Which split trains and which evaluates.

use super::entry::DatasetSplit;
use super::error::DatasetError;
use super::opened::Dataset;

use std::path::PathBuf;

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
            path: self.shown(),
            asked: name.to_owned(),
            splits: self.split_names(),
        })
    }

    /// Position of the split that training takes unless told otherwise: the one with depth
    /// (NeRF-synthetic: `test`), `train` first if several have it.
    ///
    /// # Errors
    /// [`DatasetError::NoDepth`]; [`DatasetError::TrainingSplit`] where a split that should train has no
    /// usable frame: what is left may be the views that the scene is to be measured on.
    pub fn training_split(&self) -> Result<usize, DatasetError> {
        let refuse = |split: &str, found: String| {
            Err(DatasetError::TrainingSplit { path: self.shown(), split: split.to_owned(), found })
        };
        for name in TRAINING_NAMES {
            if let Some(split) = self.find(|s| s.has_depth && s.name == name) {
                return Ok(split);
            }
            if let Some((first, n_listed)) = self.refused_whole(name) {
                let found = format!("none in {n_listed} listed; the first problem: {first}");
                return refuse(name, found);
            }
        }
        let split = self.find(|s| s.has_depth).ok_or_else(|| DatasetError::NoDepth {
            path: self.shown(),
            splits: self.split_names(),
        })?;
        let [training, ..] = TRAINING_NAMES;
        let name = self.splits.get(split).map_or("", |split| split.name.as_str());
        let is_for_evaluation = EVALUATION_NAMES.contains(&name);
        match self.find(|s| s.name == training) {
            Some(_) if is_for_evaluation => refuse(training, "colour only".to_owned()),
            _ => Ok(split),
        }
    }

    /// The first problem of a split that was listed and has no usable frame, and how many it has.
    fn refused_whole(&self, name: &str) -> Option<(String, usize)> {
        if self.find(|s| s.name == name).is_some() {
            return None;
        }
        let mut refused = self.warnings.iter().filter(|warning| warning.split == name);
        let first = refused.next()?.error.to_string();
        Some((first, 1 + refused.count()))
    }

    /// What messages call it.
    fn shown(&self) -> PathBuf {
        self.path.clone().unwrap_or_else(|| self.name.clone().into())
    }

    /// The views that evaluation takes unless told otherwise, given the split that trains: `val`,
    /// `eval` or `test` if it is another split, else every eighth frame of the training split.
    pub fn evaluation(&self, training_split: usize) -> Evaluation {
        let trained = self.splits.get(training_split).map(|s| s.name.as_str());
        // Depth is not asked for: photographs alone measure colour.
        let other = |name: &&str| self.find(|s| s.name == *name && trained != Some(name));
        if let Some(split) = EVALUATION_NAMES.iter().find_map(other)
            && let Some(DatasetSplit { name, frames, .. }) = self.splits.get(split)
        {
            let frames = (0..frames.len()).collect();
            let why = format!("all frames of the split `{name}`");
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
