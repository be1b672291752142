//! Choice of the splits for training and evaluation.

use super::entry::DatasetSplit;
use super::error::DatasetError;
use super::opened::Dataset;

use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use strum::{Display, EnumString, VariantNames};

pub use super::entry::{HELD_OUT, HOLD_OUT_EVERY};

// NeRF-synthetic publishes depth with `test` only, hence the second name.
/// Names of the splits with depth that are preferred for training, in order of preference.
const TRAINING_NAMES: [&str; 2] = ["train", "test"];
/// Names of evaluation splits, in order of preference; the training split is excluded.
const EVALUATION_NAMES: [&str; 3] = ["val", "eval", "test"];

const FREE: &str = "free";

/// Method by which frames are held out of training.
#[derive(
    Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames,
)]
pub enum HoldOut {
    /// Holds out every eighth frame, if the dataset has no evaluation split.
    #[default]
    #[serde(rename = "every-8th")]
    #[strum(serialize = "every-8th")]
    Every8th,
    /// Trains on a sector of the camera path and evaluates views outside it (`evaluation.md`, Views from
    /// the side).
    #[serde(rename = "sector")]
    #[strum(serialize = "sector")]
    Sector,
}

impl HoldOut {
    /// True for the default method, which is omitted when a plan is saved.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

/// Location of the views of a group relative to the camera path.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display)]
pub enum ViewGroupName {
    /// On the camera path, between training frames.
    #[serde(rename = "new views")]
    #[strum(serialize = "new views")]
    NewViews,
    /// Off the camera path.
    #[serde(rename = "from the side")]
    #[strum(serialize = "from the side")]
    FromTheSide,
}

/// Views of one split that are evaluated together.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ViewGroup {
    /// Location of the views; `None` for a split named by the user.
    pub name: Option<ViewGroupName>,
    /// Index into [`Dataset::splits`].
    pub split: usize,
    /// Indices into [`DatasetSplit::frames`].
    pub frames: Vec<usize>,
}

impl ViewGroup {
    /// Returns the index of the split and the indices of its frames.
    pub fn views(&self) -> (usize, &[usize]) {
        (self.split, &self.frames)
    }
}

/// Views for the evaluation of a model.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Evaluation {
    /// Views on the camera path.
    pub new_views: ViewGroup,
    /// Groups of views off the camera path; often there are none. No group is empty.
    pub from_the_side: Vec<ViewGroup>,
    /// Indices of the training split's frames that are used for training; `None` for all frames.
    pub training: Option<Vec<usize>>,
    /// Reason for the choice of views, in one sentence for the user.
    pub why: String,
}

impl Evaluation {
    /// Returns all groups of views, new views first.
    pub fn into_groups(self) -> Vec<ViewGroup> {
        std::iter::once(self.new_views).chain(self.from_the_side).collect()
    }
}

/// Returns the indices of the training frames among `n_frames`, of which every eighth is held out.
pub fn without_every_8th(n_frames: usize) -> Vec<usize> {
    (0..n_frames).filter(|i| !i.is_multiple_of(HOLD_OUT_EVERY)).collect()
}

pub(super) fn is_for_training(split: &DatasetSplit) -> bool {
    !(is_for_evaluation(&split.name) || [FREE, HELD_OUT].contains(&split.name.as_str()))
}

pub(super) fn is_for_evaluation(split: &str) -> bool {
    EVALUATION_NAMES.contains(&split)
}

impl Dataset {
    /// Returns the index of the split with this name.
    ///
    /// # Errors
    /// [`DatasetError::NoSuchSplit`] if no split has this name.
    pub fn split_named(&self, name: &str) -> Result<usize, DatasetError> {
        self.splits.iter().position(|s| s.name == name).ok_or_else(|| DatasetError::NoSuchSplit {
            path: self.display_path(),
            asked: name.to_owned(),
            splits: self.split_names(),
        })
    }

    /// Returns the index of the default training split. It is the first split with depth among `train`,
    /// `test` (NeRF-synthetic) and all others.
    ///
    /// # Errors
    /// [`DatasetError::NoDepth`] if no split has depth. [`DatasetError::TrainingSplit`] if the preferred
    /// training split has no usable frame, because the remaining split may be for evaluation.
    pub fn training_split(&self) -> Result<usize, DatasetError> {
        let refuse = |split: &str, found: String| {
            Err(DatasetError::TrainingSplit {
                path: self.display_path(),
                split: split.to_owned(),
                found,
            })
        };
        for name in TRAINING_NAMES {
            if let Some(split) = self.find(|s| s.has_depth && s.name == name) {
                return Ok(split);
            }
            // The next name may be the evaluation split's.
            if let Some((first, n_listed)) = self.unusable_split(name) {
                let found = format!("none in {n_listed} listed; the first problem: {first}");
                return refuse(name, found);
            }
        }
        let split = self.find(|s| s.has_depth).ok_or_else(|| DatasetError::NoDepth {
            path: self.display_path(),
            splits: self.split_names(),
        })?;
        let [training, ..] = TRAINING_NAMES;
        let name = self.splits.get(split).map_or("", |split| split.name.as_str());
        // Training on a split for evaluation would falsify the figures.
        match self.find(|s| s.name == training) {
            Some(_) if is_for_evaluation(name) => refuse(training, "colour only".to_owned()),
            _ => Ok(split),
        }
    }

    fn unusable_split(&self, name: &str) -> Option<(String, usize)> {
        if self.find(|s| s.name == name).is_some() {
            return None;
        }
        let mut refused = self.warnings.iter().filter(|warning| warning.split == name);
        let first = refused.next()?.error.to_string();
        Some((first, 1 + refused.count()))
    }

    pub(super) fn display_path(&self) -> PathBuf {
        self.path.clone().unwrap_or_else(|| self.name.clone().into())
    }

    /// Chooses the default views for evaluation. They are the split `val`, `eval` or `test`, unless it
    /// is the training split; else every eighth training frame. A split `free` (views off the camera
    /// path) is evaluated in addition.
    pub fn evaluation(&self, training_split: usize) -> Evaluation {
        let new_views = |split, frames| {
            let name = Some(ViewGroupName::NewViews);
            ViewGroup { name, split, frames }
        };
        let from_the_side = self.free_views(training_split);
        // Any split will do: colour metrics need no depth.
        if let Some((split, DatasetSplit { name, frames, .. })) =
            self.evaluation_split(training_split)
        {
            let why = format!("all frames of the split `{name}`");
            let new_views = new_views(split, (0..frames.len()).collect());
            return Evaluation { new_views, from_the_side, training: None, why };
        }
        let n_frames = self.splits.get(training_split).map_or(0, |s| s.frames.len());
        Evaluation {
            new_views: new_views(training_split, (0..n_frames).step_by(HOLD_OUT_EVERY).collect()),
            from_the_side,
            training: Some(without_every_8th(n_frames)),
            why: format!(
                "every {HOLD_OUT_EVERY}th frame, held out of training: the dataset has no split for evaluation"
            ),
        }
    }

    /// Returns all frames of a split as one group.
    pub fn whole_split(&self, split: usize) -> ViewGroup {
        let found = self.splits.get(split);
        let is_free = found.is_some_and(|split| split.name == FREE);
        let name = is_free.then_some(ViewGroupName::FromTheSide);
        ViewGroup { name, split, frames: (0..found.map_or(0, |s| s.frames.len())).collect() }
    }

    pub(super) fn evaluation_split(&self, training_split: usize) -> Option<(usize, &DatasetSplit)> {
        let of = |name: &&str| {
            let mut splits = self.splits.iter().enumerate();
            splits.find(|(split, s)| s.name == *name && *split != training_split)
        };
        EVALUATION_NAMES.iter().find_map(of)
    }

    pub(super) fn free_views(&self, training_split: usize) -> Vec<ViewGroup> {
        let free = self.find(|s| s.name == FREE).filter(|free| *free != training_split);
        free.map(|free| self.whole_split(free)).into_iter().collect()
    }

    fn find(&self, is_wanted: impl Fn(&DatasetSplit) -> bool) -> Option<usize> {
        self.splits.iter().position(is_wanted)
    }

    fn split_names(&self) -> String {
        self.splits.iter().map(|s| s.name.as_str()).collect::<Vec<_>>().join(", ")
    }
}
