//! Which frames are trained on, and in which order.

use crate::dataset::Dataset;
use crate::dataset::error::DatasetError;
use crate::math::rng::{Purpose, Rng};
use serde::{Deserialize, Serialize};
use strum::{EnumString, VariantNames};

/// Order of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Order {
    /// As the dataset lists them.
    Sequential,
    /// Shuffled by the seed.
    Shuffled,
}

/// What a user asked for.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Selection {
    /// Split to train on; `None` takes the one with depth.
    pub split: Option<String>,
    /// Order of the frames.
    pub order: Order,
    /// Every so-many-th frame, at least 1.
    pub stride: usize,
    /// Frames at most.
    pub max_frames: Option<usize>,
}

impl Selection {
    /// All frames of the training split, in their order.
    pub fn everything() -> Self {
        Self { split: None, order: Order::Sequential, stride: 1, max_frames: None }
    }
}

/// The frames a run goes through.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Position of the split in the dataset.
    pub split: usize,
    /// Positions of the frames in the split, in order of training.
    pub frames: Vec<usize>,
    /// Why frames are left out for evaluation, where the dataset has no evaluation split.
    pub held_out: Option<String>,
}

impl Plan {
    /// Resolves a selection. Frames that the dataset holds out for evaluation are left out unless
    /// the split was named by the user.
    pub fn new(dataset: &Dataset, selection: &Selection, seed: u64) -> Result<Self, DatasetError> {
        let split = match &selection.split {
            Some(name) => dataset.split_named(name)?,
            None => dataset.training_split()?,
        };
        let evaluation = dataset.evaluation(split);
        let hold_out = evaluation.held_out && selection.split.is_none();
        let n_frames = dataset.splits[split].frames.len();
        let mut frames: Vec<usize> =
            (0..n_frames).filter(|i| !hold_out || !evaluation.frames.contains(i)).collect();
        frames = frames.into_iter().step_by(selection.stride.max(1)).collect();
        if selection.order == Order::Shuffled {
            Rng::new(seed, Purpose::Order, 0).shuffle(&mut frames);
        }
        frames.truncate(selection.max_frames.unwrap_or(usize::MAX));
        Ok(Self { split, frames, held_out: hold_out.then_some(evaluation.why) })
    }
}
