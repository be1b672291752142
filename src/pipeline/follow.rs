//! When to look for the frames of a recording that is under way, and what to do about what is found.
//!
//! Looks are made between frames, by whoever trains: a look takes a twentieth of the time at most, and
//! a rest is a few calls of the system (`dataset/growing.rs`), so that no thread has to be woken.

use super::error::SessionError;
use super::plan::{Order, Plan, Selection};
use super::settings::scene::SceneError;
use crate::dataset::error::DatasetError;
use crate::dataset::growing::GrowingRecording;
use crate::dataset::splits::HELD_OUT;
use crate::dataset::{Dataset, FrameEntry, LoadOptions};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Least time between two looks: less than a frame of a camera.
const TICK: Duration = Duration::from_millis(20);
/// Time between two looks for what no folder or list tells of, such as a file that was half there.
const RETRY: Duration = Duration::from_millis(50);
/// After so long without a frame nothing is in a hurry.
const QUIET: Duration = Duration::from_secs(10);
/// Time between two looks then, and between two for what no folder or list tells of.
const QUIET_TICK: Duration = Duration::from_millis(100);
const QUIET_RETRY: Duration = Duration::from_secs(1);
/// A look may take so small a part of the time.
const SHARE: u32 = 20;

/// A recording that is followed while it grows.
pub struct Follow {
    recording: GrowingRecording,
    selection: Selection,
    /// Found before a session has begun.
    dataset: Option<Arc<Dataset>>,
    started: Instant,
    /// When it was asked last whether a look is worth it.
    ticked: Option<Instant>,
    /// When the last look ended, and how long it took.
    read: Option<Instant>,
    cost: Duration,
    /// When frames were found last.
    grown: Instant,
    problem: Option<String>,
    is_over: bool,
}

/// What a look found.
pub(super) enum Found {
    /// No frame that is whole.
    Nothing,
    /// Frames.
    Frames(Dataset),
    /// The end of the recording, and what was there before it.
    End(Option<Dataset>),
}

impl Follow {
    /// Begins with nothing: even the folder may come later.
    ///
    /// # Errors
    /// A selection that needs to know all frames, an option out of its range, a file in place of a
    /// folder.
    pub fn new(
        path: &Path,
        load: &LoadOptions,
        selection: &Selection,
    ) -> Result<Self, DatasetError> {
        if selection.order != Order::Sequential {
            return Err(not_followed("order", "sequential beside follow", "shuffled"));
        }
        if selection.split.as_deref() == Some(HELD_OUT) {
            let expected = "the split that is recorded, beside follow";
            return Err(not_followed("split", expected, HELD_OUT));
        }
        let recording = GrowingRecording::new(path, load, selection.split.as_deref())?;
        Ok(Self::with(recording, selection))
    }

    /// Goes on behind the frames of a dataset that was opened; `None` for one that is no folder.
    pub(super) fn of(dataset: &Dataset, split: usize, selection: &Selection) -> Option<Self> {
        Some(Self::with(GrowingRecording::of(dataset, split)?, selection))
    }

    fn with(recording: GrowingRecording, selection: &Selection) -> Self {
        let now = Instant::now();
        Self {
            recording,
            selection: Selection { follow: true, ..selection.clone() },
            dataset: None,
            started: now,
            ticked: None,
            read: None,
            cost: Duration::ZERO,
            grown: now,
            problem: None,
            is_over: false,
        }
    }

    /// The recording so far, whenever it has grown and holds a frame to train on; for a session to
    /// begin with, to which [`Session::follow`](super::session::Session::follow) hands the rest over.
    ///
    /// # Errors
    /// What is wrong with a recording that has ended.
    pub fn more(&mut self) -> Result<Option<Arc<Dataset>>, DatasetError> {
        let (Found::Frames(found) | Found::End(Some(found))) = self.look()? else {
            return Ok(None);
        };
        let dataset = match self.dataset.take() {
            None if found.splits.is_empty() => return Err(self.recording.why_empty(found)),
            None => Arc::new(found),
            Some(mut known) => {
                let split = self.recording.split_of(&known)?;
                Arc::make_mut(&mut known).grow(split, found);
                known
            }
        };
        let dataset = self.dataset.insert(dataset);
        let has_frames = !Plan::new(dataset, &self.selection, 0)?.frames.is_empty();
        Ok((has_frames || self.is_over).then(|| dataset.clone()))
    }

    /// Whether a session may begin after more frames although it did not now: these show nothing.
    pub fn forgives(&mut self, error: &SessionError) -> bool {
        let is_of_frames =
            matches!(error, SessionError::Range(_) | SessionError::Scene(SceneError::NoPoints(_)));
        if is_of_frames {
            self.problem = Some(error.to_string());
        }
        is_of_frames && !self.is_over
    }

    /// What is selected, and that it is followed.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// Time until a look may find something.
    pub fn rest(&self) -> Duration {
        let tick = if self.is_quiet() { QUIET_TICK } else { TICK };
        let left = |least: Duration, since: Option<Instant>| {
            since.map_or(Duration::ZERO, |since| least.saturating_sub(since.elapsed()))
        };
        left(tick, self.ticked).max(left(SHARE * self.cost, self.read))
    }

    /// Why the last look found nothing, where that is not for lack of new files.
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.recording.path()
    }

    /// From here on a session holds the frames.
    pub(super) fn hand_over(self) -> Self {
        Self { dataset: None, ..self }
    }

    /// What came since the last look, if it is time for another.
    ///
    /// # Errors
    /// What is wrong with a recording that has ended. Before, time may mend it.
    pub(super) fn look(&mut self) -> Result<Found, DatasetError> {
        if self.is_over {
            return Ok(Found::End(None));
        }
        if !self.rest().is_zero() {
            return Ok(Found::Nothing);
        }
        self.ticked = Some(Instant::now());
        // Asked first: what is there when the recorder has ended is all.
        let has_ended = self.recording.has_ended();
        if !has_ended && !self.is_due() {
            return Ok(Found::Nothing);
        }
        let begun = Instant::now();
        let found = self.recording.look(!has_ended, self.started.elapsed().as_secs_f64());
        (self.read, self.cost) = (Some(Instant::now()), begun.elapsed());
        if has_ended {
            self.is_over = true;
            return found.map(|found| Found::End(Some(found)));
        }
        let found = found.and_then(|found| match self.recording.take(&found) {
            0 if !self.recording.has_begun() => Err(self.recording.why_empty(found)),
            0 => Ok(Found::Nothing),
            _ => Ok(Found::Frames(found)),
        });
        self.problem = found.as_ref().err().map(ToString::to_string);
        let found = found.unwrap_or(Found::Nothing);
        if let Found::Frames(_) = found {
            self.grown = Instant::now();
        }
        Ok(found)
    }

    /// Lets a frame that could not be read be found again when its files change.
    pub(super) fn give_back(&mut self, frame: &FrameEntry) {
        self.recording.give_back(frame);
    }

    fn is_due(&self) -> bool {
        let retry = if self.is_quiet() { QUIET_RETRY } else { RETRY };
        let waited = self.read.is_none_or(|read| read.elapsed() >= retry);
        self.recording.has_changed() || self.recording.is_unresolved() && waited
    }

    fn is_quiet(&self) -> bool {
        self.grown.elapsed() > QUIET
    }
}

fn not_followed(setting: &'static str, expected: &'static str, found: &str) -> DatasetError {
    DatasetError::Option { setting, expected, found: found.to_owned() }
}
