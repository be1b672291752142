//! Selection and order of the frames to train on.

use crate::dataset::Dataset;
use crate::dataset::error::DatasetError;
use crate::dataset::splits::{HoldOut, without_every_8th};
use crate::math::rng::{Purpose, Rng};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::str::FromStr;
use strum::{EnumString, VariantNames};

/// Maximum number of passes.
// After a few passes, photographs have little effect.
pub const MAX_PASSES: usize = 100;

/// Order of the frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Order {
    /// In the order of the dataset.
    Sequential,
    /// In a random order that depends on the seed.
    Shuffled,
}

/// Part `K/N` of the frames, for one of `N` runs: every `N`-th frame, starting with the `K`-th.
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

/// Requested selection of frames.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Selection {
    /// Dataset split to train on; `None` selects the split with depth.
    pub split: Option<String>,
    /// Order of the frames.
    pub order: Order,
    /// Stride: only every N-th frame is used; at least 1.
    pub stride: usize,
    /// Shard: the part of the frames that one of several runs trains on. Applied after order and
    /// stride.
    pub shard: Option<Shard>,
    /// Number of frames that the run had visited when the shard began: the start's, of which the shard is no part.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub start_frames: usize,
    /// Maximum number of frames.
    pub max_frames: Option<usize>,
    /// Number of passes over the frames, at least 1. The first pass trains on points and photographs,
    /// further passes only on photographs.
    #[serde(default = "once", skip_serializing_if = "is_once")]
    pub passes: usize,
    /// Split of a followed recording if `split` is `None`: that of its first frames, since splits that appear
    /// later must not take its place.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub followed_split: Option<String>,
    /// True if the recording was followed while it grew.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub follow: bool,
    /// Rule that selects the frames held out for evaluation.
    #[serde(default, skip_serializing_if = "HoldOut::is_default")]
    pub hold_out: HoldOut,
}

fn once() -> usize {
    // Runs saved before this field existed had one pass.
    1
}

fn is_zero(n: &usize) -> bool {
    *n == 0
}

fn is_once(passes: &usize) -> bool {
    *passes == 1
}

impl Selection {
    /// Selects all frames of the training split, in sequential order.
    pub fn all_frames() -> Self {
        let (split, followed_split, shard, max_frames) = (None, None, None, None);
        let (order, stride, passes, follow) = (Order::Sequential, 1, 1, false);
        let (start_frames, hold_out) = (0, HoldOut::default());
        Self {
            split,
            order,
            stride,
            shard,
            start_frames,
            max_frames,
            passes,
            followed_split,
            follow,
            hold_out,
        }
    }

    /// Returns the name of the split to train on; `None` for the dataset's default.
    pub fn split_name(&self) -> Option<&str> {
        self.split.as_deref().or(self.followed_split.as_deref())
    }

    /// Returns the order of the frames in pass `pass`, where 0 is the first pass.
    fn repeat_order(&self, frames: &[usize], seed: u64, pass: usize) -> Vec<usize> {
        let mut frames = frames.to_vec();
        if self.order == Order::Shuffled {
            // Sorted first, so that a pass does not depend on the order of the first one.
            frames.sort_unstable();
            Rng::new(seed, Purpose::Order, pass as u64).shuffle(&mut frames);
        }
        frames
    }

    /// Returns the selection without shard and limit, the same for all shards of a run.
    pub fn without_shard(&self) -> Self {
        Self { shard: None, start_frames: 0, max_frames: None, ..self.clone() }
    }

    /// Returns those of the visited frames that the run's start had visited.
    fn of_start<'a, T>(&self, visited: &'a [T]) -> &'a [T] {
        visited.get(..self.start_frames).unwrap_or(visited)
    }

    /// Applies stride, order, shard and limit to the training frames. The shard is a part of the frames that are not
    /// in `start`.
    fn of(&self, training: Vec<usize>, seed: u64, start: &[usize]) -> Vec<usize> {
        let mut frames: Vec<usize> = training.into_iter().step_by(self.stride.max(1)).collect();
        if self.order == Order::Shuffled {
            Rng::new(seed, Purpose::Order, 0).shuffle(&mut frames);
        }
        // Shards are taken after the shuffle, so that all shards together are the whole plan.
        if let Some(Shard { index, of }) = self.shard {
            let start: BTreeSet<usize> = start.iter().copied().collect();
            frames.retain(|frame| !start.contains(frame));
            frames = frames.into_iter().skip(index - 1).step_by(of).collect();
        }
        frames.truncate(self.max_frames.unwrap_or(usize::MAX));
        frames
    }
}

/// Sequence of frames of a run.
///
/// ```
/// use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
/// use vbgs_studio::pipeline::plan::{Plan, Selection};
///
/// let small = SyntheticParams { width: 32, height: 24, n_train: 6, n_eval: 1, ..SyntheticParams::demo() };
/// let room = synthetic::dataset(&small)?;
/// let second = Selection { shard: Some("2/3".parse()?), ..Selection::all_frames() };
/// assert_eq!(Plan::new(&room, &second, 0)?.frames, [1, 4]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Plan {
    /// Index of the split in the dataset.
    pub split: usize,
    /// Indices of the frames in the split, in training order: the first pass, then any further passes.
    pub frames: Vec<usize>,
    /// Description of why frames are held out for evaluation, if any are.
    pub held_out: Option<String>,
}

impl Plan {
    /// Plans the frames of a selection. The hold-out `every-8th` has no effect if the user named the
    /// split; a sector is always held out.
    pub fn new(dataset: &Dataset, selection: &Selection, seed: u64) -> Result<Self, DatasetError> {
        Self::after(dataset, selection, seed, &[])
    }

    fn after(
        dataset: &Dataset,
        selection: &Selection,
        seed: u64,
        start: &[usize],
    ) -> Result<Self, DatasetError> {
        let split = match selection.split_name() {
            Some(name) => dataset.split_named(name)?,
            None => dataset.training_split()?,
        };
        let trains_whole = selection.split.is_some() && selection.hold_out == HoldOut::Every8th;
        let evaluation = dataset.evaluation_by(selection.hold_out, split)?;
        // A single frame trains, unless more will come.
        let is_single = dataset.splits[split].frames.len() == 1 && !selection.follow;
        let training = evaluation.training.filter(|_| !trains_whole && !is_single);
        let held_out = training.is_some().then_some(evaluation.why);
        let all = || (0..dataset.splits[split].frames.len()).collect();
        let frames = selection.of(training.unwrap_or_else(all), seed, start);
        let mut plan = Self { split, frames, held_out };
        plan.repeat(selection, seed);
        Ok(plan)
    }

    fn repeat(&mut self, selection: &Selection, seed: u64) {
        let first = self.frames.clone();
        let further =
            (1..selection.passes).flat_map(|pass| selection.repeat_order(&first, seed, pass));
        self.frames.extend(further);
    }

    /// Returns the frames of the first pass, as indices in the split.
    pub fn first_pass(&self) -> Vec<usize> {
        let repeats = self.repeat_flags();
        self.frames.iter().zip(repeats).filter(|(_, again)| !again).map(|(&i, _)| i).collect()
    }

    /// Returns one flag per plan position: true if the frame also occurs at an earlier position.
    pub fn repeat_flags(&self) -> Vec<bool> {
        let mut known = BTreeSet::new();
        self.frames.iter().map(|&frame| !known.insert(frame)).collect()
    }

    /// Appends the selected frames of a split that has grown from `known` to `n_frames` frames. Requires
    /// sequential order, in which known frames keep their positions. With a sector hold-out, appends
    /// nothing.
    pub fn extend(&mut self, selection: &Selection, known: usize, n_frames: usize) {
        // The sector is fixed at the start: further cameras would change it.
        if selection.hold_out == HoldOut::Sector {
            return;
        }
        // Planned frames stay, even above the limit.
        let most = selection.max_frames.unwrap_or(usize::MAX).max(self.frames.len());
        let all = Selection { max_frames: None, ..selection.clone() };
        let training = match self.held_out {
            Some(_) => without_every_8th(n_frames),
            None => (0..n_frames).collect(),
        };
        // Sequential order does not use the seed.
        let selected = all.of(training, 0, selection.of_start(&self.frames)).into_iter();
        self.frames.extend(selected.filter(|&frame| frame >= known));
        self.frames.truncate(most);
    }

    /// Number of pixels of the largest frame.
    pub fn pixels(&self, dataset: &Dataset) -> usize {
        let frames = self.frames.iter().map(|&i| &dataset.splits[self.split].frames[i]);
        let sizes = frames.map(|f| f.camera.intrinsics.width * f.camera.intrinsics.height);
        sizes.max().unwrap_or(0) as usize
    }

    /// Plans the continuation of a run: the frames `visited` so far in their order, then the remaining
    /// frames. `max_frames` limits the number of distinct frames, including visited ones.
    pub fn resumed(
        dataset: &Dataset,
        selection: &Selection,
        seed: u64,
        visited: &[u32],
    ) -> Result<Self, DatasetError> {
        // The limit counts visited frames as well, so it is applied below.
        let all = Selection { max_frames: None, passes: 1, ..selection.clone() };
        let visited: Vec<usize> = visited.iter().map(|&frame| frame as usize).collect();
        let mut plan = Self::after(dataset, &all, seed, selection.of_start(&visited))?;
        // Frames of the first pass, then the remaining ones of all passes.
        let mut known = BTreeSet::new();
        let first: Vec<usize> =
            visited.iter().copied().filter(|&frame| known.insert(frame)).collect();
        plan.frames.retain(|frame| !known.contains(frame));
        plan.frames.splice(0..0, first);
        // Visited frames stay, even above a lower limit.
        plan.frames.truncate(selection.max_frames.unwrap_or(usize::MAX).max(known.len()));
        plan.repeat(selection, seed);
        let mut left = plan.frames;
        for frame in &visited {
            // Every visited frame is in the first pass, so it occurs at least as often as it was visited.
            if let Some(at) = left.iter().position(|planned| planned == frame) {
                left.remove(at);
            }
        }
        plan.frames = [visited, left].concat();
        Ok(plan)
    }

    /// True if a run that has `visited` frames begins `shard` of the frames that are left when it is resumed with it.
    /// False if it continues its own shard: that of a start, or one with frames left.
    pub fn begins_shard(
        dataset: &Dataset,
        selection: &Selection,
        seed: u64,
        visited: &[u32],
        shard: Shard,
    ) -> Result<bool, DatasetError> {
        if selection.shard != Some(shard) {
            return Ok(true);
        }
        let unlimited = Selection { max_frames: None, passes: 1, ..selection.clone() };
        let plan = Self::resumed(dataset, &unlimited, seed, visited)?;
        Ok(selection.start_frames == 0 && plan.frames.len() == visited.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{self, SyntheticParams};
    use std::sync::LazyLock;

    // Rendering the room takes longer than all plans of it.
    static ROOM: LazyLock<Dataset> = LazyLock::new(|| {
        let params = SyntheticParams {
            width: 32,
            height: 24,
            n_train: 6,
            n_eval: 1,
            ..SyntheticParams::demo()
        };
        synthetic::dataset(&params).unwrap()
    });

    fn plan(selection: &Selection, visited: &[u32]) -> Vec<usize> {
        Plan::resumed(&ROOM, selection, 5, visited).unwrap().frames
    }

    #[test]
    fn a_run_that_goes_on_has_the_plan_it_had() {
        for (passes, order) in
            [(1, Order::Sequential), (2, Order::Sequential), (3, Order::Shuffled)]
        {
            let selection = Selection { passes, order, ..Selection::all_frames() };
            let whole = plan(&selection, &[]);
            assert_eq!(whole.len(), 6 * passes);
            assert!(whole.chunks(6).all(|pass| pass.iter().collect::<BTreeSet<_>>().len() == 6));
            for n in 0..=whole.len() {
                let visited: Vec<u32> = whole[..n].iter().map(|&frame| frame as u32).collect();
                assert_eq!(plan(&selection, &visited), whole, "{passes} passes, {n} visited");
            }
        }
        let shuffled = Selection { passes: 2, order: Order::Shuffled, ..Selection::all_frames() };
        let whole = plan(&shuffled, &[]);
        assert_ne!(whole[..6], whole[6..], "each pass has its own order");
    }

    #[test]
    fn shards_of_a_start_share_the_frames_that_it_left() {
        let shard = |text: &str| text.parse::<Shard>().ok();
        let start = Selection { shard: shard("1/3"), ..Selection::all_frames() };
        assert_eq!(plan(&start, &[]), [0, 3]);
        let of_start = |text| Selection { shard: shard(text), start_frames: 2, ..start.clone() };
        assert_eq!(plan(&of_start("1/3"), &[0, 3]), [0, 3, 1, 5]);
        assert_eq!(plan(&of_start("2/3"), &[0, 3]), [0, 3, 2]);
        // A shard that was interrupted continues.
        assert_eq!(plan(&of_start("1/3"), &[0, 3, 1]), [0, 3, 1, 5]);
        let begins = |selection: &Selection, visited: &[u32], text| {
            let shard = shard(text).unwrap();
            Plan::begins_shard(&ROOM, selection, 5, visited, shard).unwrap()
        };
        assert!(begins(&start, &[0, 3], "2/3") && begins(&start, &[0], "1/2"));
        assert!(begins(&start, &[0, 3], "1/3"), "a complete start");
        assert!(!begins(&start, &[0], "1/3"), "an interrupted start");
        assert!(!begins(&of_start("1/3"), &[0, 3, 1, 5], "1/3"), "a complete shard");
        let mut grown = Plan { split: 0, frames: vec![0, 3, 1, 5], held_out: None };
        grown.extend(&of_start("1/3"), 6, 9);
        assert_eq!(grown.frames, [0, 3, 1, 5, 8]);
    }

    #[test]
    fn more_frames_and_passes_come_behind_those_visited() {
        let few = Selection { passes: 2, max_frames: Some(2), ..Selection::all_frames() };
        assert_eq!(plan(&few, &[]), [0, 1, 0, 1]);
        let more = Selection { max_frames: Some(3), ..few.clone() };
        assert_eq!(plan(&more, &[0, 1, 0]), [0, 1, 0, 2, 1, 2]);
        let oftener = Selection { passes: 3, ..few };
        assert_eq!(plan(&oftener, &[0, 1, 0, 1]), [0, 1, 0, 1, 0, 1]);
    }

    #[test]
    fn a_sector_trains_on_the_first_part_of_the_way_and_stays_when_it_goes_on() {
        let params = SyntheticParams {
            width: 32,
            height: 24,
            n_train: 20,
            n_eval: 2,
            ..SyntheticParams::demo()
        };
        let room = synthetic::dataset(&params).unwrap();
        let selection = Selection { hold_out: HoldOut::Sector, ..Selection::all_frames() };
        let mut plan = Plan::new(&room, &selection, 0).unwrap();
        let trained = [1, 2, 3, 4, 5, 6, 7, 9, 10, 11];
        assert_eq!(plan.frames, trained);
        assert!(plan.held_out.as_ref().is_some_and(|why| why.contains("a recording")));
        let on = Plan::resumed(&room, &selection, 0, &[1, 2, 3]).unwrap();
        assert_eq!(on.frames, trained);
        plan.extend(&selection, 20, 40);
        assert_eq!(plan.frames, trained);
        let named = Selection { split: Some("train".to_owned()), stride: 2, ..selection };
        assert_eq!(Plan::new(&room, &named, 0).unwrap().frames, [1, 3, 5, 7, 10]);
    }

    #[test]
    fn files_leave_the_default_out_and_name_a_sector() {
        let text = |selection: &Selection| serde_json::to_string(selection).unwrap();
        let plain = text(&Selection::all_frames());
        assert!(!plain.contains("hold_out"), "{plain}");
        assert_eq!(serde_json::from_str::<Selection>(&plain).unwrap(), Selection::all_frames());
        let sector = Selection { hold_out: HoldOut::Sector, ..Selection::all_frames() };
        assert!(text(&sector).contains(r#""hold_out":"sector""#));
        assert_eq!(serde_json::from_str::<Selection>(&text(&sector)).unwrap(), sector);
    }
}
