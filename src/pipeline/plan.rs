//! Which frames are trained on, and in which order.

use crate::dataset::Dataset;
use crate::dataset::error::DatasetError;
use crate::dataset::splits::HOLD_OUT_EVERY;
use crate::math::rng::{Purpose, Rng};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::str::FromStr;
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

/// One of several runs that share the frames: every `of`-th frame, from the `index`-th on. Written
/// `K/N`, `K` from 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Shard {
    index: usize,
    of: usize,
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |part: &str| part.parse().ok().filter(|&n: &usize| n > 0);
        let parts = text.split_once('/').and_then(|(k, n)| Some((number(k)?, number(n)?)));
        match parts {
            Some((index, of)) if index <= of => Ok(Self { index, of }),
            _ => Err(format!("expected K/N with K from 1 to N, such as 2/3, found `{text}`")),
        }
    }
}

impl TryFrom<String> for Shard {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Shard> for String {
    fn from(shard: Shard) -> Self {
        format!("{}/{}", shard.index, shard.of)
    }
}

/// What a user asked for.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// Split to train on; `None` takes the one with depth.
    pub split: Option<String>,
    /// Order of the frames.
    pub order: Order,
    /// Every so-many-th frame, at least 1.
    pub stride: usize,
    /// Share of these frames, taken after order and stride.
    pub shard: Option<Shard>,
    /// Frames at most.
    pub max_frames: Option<usize>,
    /// Whether frames were taken while they were recorded.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub follow: bool,
}

impl Selection {
    /// All frames of the training split, in their order.
    pub fn everything() -> Self {
        let (split, shard, max_frames) = (None, None, None);
        Self { split, order: Order::Sequential, stride: 1, shard, max_frames, follow: false }
    }

    /// The frames of all shards, without a limit: what runs that share them have in common.
    pub fn whole(&self) -> Self {
        Self { shard: None, max_frames: None, ..self.clone() }
    }

    /// Positions of the frames that are taken of a split, in order of training.
    fn of(&self, n_frames: usize, hold_out: bool, seed: u64) -> Vec<usize> {
        let trains = |i: &usize| !hold_out || !i.is_multiple_of(HOLD_OUT_EVERY);
        let frames = (0..n_frames).filter(trains).step_by(self.stride.max(1));
        let mut frames: Vec<usize> = frames.collect();
        if self.order == Order::Shuffled {
            Rng::new(seed, Purpose::Order, 0).shuffle(&mut frames);
        }
        if let Some(Shard { index, of }) = self.shard {
            frames = frames.into_iter().skip(index - 1).step_by(of).collect();
        }
        frames.truncate(self.max_frames.unwrap_or(usize::MAX));
        frames
    }
}

/// The frames a run goes through.
///
/// ```
/// use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
/// use vbgs_studio::pipeline::plan::{Plan, Selection};
///
/// let small = SyntheticParams { width: 32, height: 24, n_train: 6, n_eval: 1, ..SyntheticParams::demo() };
/// let room = synthetic::dataset(&small)?;
/// let second = Selection { shard: Some("2/3".parse()?), ..Selection::everything() };
/// assert_eq!(Plan::new(&room, &second, 0)?.frames, [1, 4]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
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
        let frames = selection.of(dataset.splits[split].frames.len(), hold_out, seed);
        Ok(Self { split, frames, held_out: hold_out.then_some(evaluation.why) })
    }

    /// Appends what a selection takes of the frames of a split that has grown from `known` to
    /// `n_frames`. Only in the order of the dataset do old frames stay where they are.
    pub fn extend(&mut self, selection: &Selection, known: usize, n_frames: usize) {
        let most = selection.max_frames.unwrap_or(usize::MAX).max(self.frames.len());
        let all = Selection { max_frames: None, ..selection.clone() };
        let selected = all.of(n_frames, self.held_out.is_some(), 0).into_iter();
        self.frames.extend(selected.filter(|&frame| frame >= known));
        self.frames.truncate(most);
    }

    /// Pixels of the largest of the frames.
    pub fn pixels(&self, dataset: &Dataset) -> usize {
        let frames = self.frames.iter().map(|&i| &dataset.splits[self.split].frames[i]);
        let sizes = frames.map(|f| f.camera.intrinsics.width * f.camera.intrinsics.height);
        sizes.max().unwrap_or(0) as usize
    }

    /// The frames of a selection when `visited` were gone through already, in that order: these
    /// first, then the others in theirs. `max_frames` counts both.
    pub fn after(
        dataset: &Dataset,
        selection: &Selection,
        seed: u64,
        visited: &[u32],
    ) -> Result<Self, DatasetError> {
        let all = Selection { max_frames: None, ..selection.clone() };
        let mut plan = Self::new(dataset, &all, seed)?;
        let visited: Vec<usize> = visited.iter().map(|&frame| frame as usize).collect();
        let known: BTreeSet<usize> = visited.iter().copied().collect();
        plan.frames.retain(|frame| !known.contains(frame));
        plan.frames.splice(0..0, visited.iter().copied());
        plan.frames.truncate(selection.max_frames.unwrap_or(usize::MAX).max(visited.len()));
        Ok(plan)
    }
}
