//! When to look for the frames of a recording that is under way, and what to do about what is found.
//!
//! Looks are made between frames, by whoever trains: so there is no thread that watches.

use super::error::SessionError;
use super::plan::{Order, Plan, Selection};
use super::settings::scene::SceneError;
use crate::dataset::error::DatasetError;
use crate::dataset::growing::GrowingRecording;
use crate::dataset::pace::LookPace;
use crate::dataset::splits::HELD_OUT;
use crate::dataset::{Dataset, FrameEntry, LoadOptions};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A recording that is followed while it grows.
pub struct Follow {
    recording: GrowingRecording,
    selection: Selection,
    /// Found before a session has begun.
    dataset: Option<Arc<Dataset>>,
    started: Instant,
    pace: LookPace,
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
        if selection.passes > 1 {
            return Err(not_followed("passes", "1 beside follow", &selection.passes.to_string()));
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
        Self {
            recording,
            selection: Selection { follow: true, ..selection.clone() },
            dataset: None,
            started: Instant::now(),
            pace: LookPace::default(),
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
        self.pace.rest(self.started.elapsed())
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
        let now = self.started.elapsed();
        if !self.pace.rest(now).is_zero() {
            return Ok(Found::Nothing);
        }
        self.pace.ask(now);
        let recording = &mut self.recording;
        // Asked first: what is there when the recorder has ended is all.
        let has_ended = recording.has_ended();
        let retries = recording.is_unresolved() && self.pace.retries(now);
        if !(has_ended || retries || recording.has_changed()) {
            return Ok(Found::Nothing);
        }
        let found = recording.look(!has_ended, now.as_secs_f64());
        if has_ended {
            self.is_over = true;
            return found.map(|found| Found::End(Some(found)));
        }
        let found = found.and_then(|found| match recording.take(&found) {
            0 if !recording.has_begun() => Err(recording.why_empty(found)),
            0 => Ok(Found::Nothing),
            _ => Ok(Found::Frames(found)),
        });
        self.problem = found.as_ref().err().map(ToString::to_string);
        let found = found.unwrap_or(Found::Nothing);
        let has_grown = matches!(found, Found::Frames(_));
        self.pace.looked(now, self.started.elapsed(), has_grown);
        Ok(found)
    }

    /// Lets a frame that could not be read be found again when its files change.
    pub(super) fn give_back(&mut self, frame: &FrameEntry) {
        self.recording.give_back(frame);
    }
}

fn not_followed(setting: &'static str, expected: &'static str, found: &str) -> DatasetError {
    DatasetError::Option { setting, expected, found: found.to_owned() }
}
