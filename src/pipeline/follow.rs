//! When to look for the frames of a recording that is under way, and what to do about what is found.
//!
//! Looks are asked for between frames, by whoever trains, who waits a moment for them: so nothing watches
//! that nobody asks.

use super::error::SessionError;
use super::looks::{Found, Looks};
use super::plan::{Order, Plan, Selection};
use super::settings::scene::SceneError;
use crate::dataset::error::DatasetError;
use crate::dataset::growing::GrowingRecording;
use crate::dataset::pace::LookPace;
use crate::dataset::splits::{HELD_OUT, HoldOut};
use crate::dataset::{Dataset, FrameMarks, LoadOptions};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest that whoever trains waits for a look: most take less, and nobody feels it.
const MOMENT: Duration = Duration::from_millis(50);

/// A drive that takes so long does not answer.
const SILENT: Duration = Duration::from_secs(3);

/// A recording that is followed while it grows.
pub struct Follow {
    path: PathBuf,
    looks: Looks,
    selection: Selection,
    /// Found before a session has begun.
    dataset: Option<Arc<Dataset>>,
    started: Instant,
    pace: LookPace,
    problem: Option<String>,
    /// Why a session could not begin on the frames so far.
    unfit: Option<String>,
    /// What is said while a look takes too long.
    silence: Option<String>,
    is_over: bool,
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
        if selection.hold_out == HoldOut::Sector {
            return Err(not_followed("hold-out", "every-8th beside follow", "sector"));
        }
        if selection.split.as_deref() == Some(HELD_OUT) {
            let expected = "the split that is recorded, beside follow";
            return Err(not_followed("split", expected, HELD_OUT));
        }
        let recording = GrowingRecording::new(path, load, selection.split.as_deref())?;
        Ok(Self::with(recording, selection))
    }

    /// Goes on behind the frames of a dataset that was opened; `None` for one that is no folder, and
    /// where a sector trains.
    pub(super) fn of(dataset: &Dataset, split: usize, selection: &Selection) -> Option<Self> {
        if selection.hold_out == HoldOut::Sector {
            return None;
        }
        Some(Self::with(GrowingRecording::of(dataset, split)?, selection))
    }

    fn with(recording: GrowingRecording, selection: &Selection) -> Self {
        Self {
            path: recording.path().to_owned(),
            looks: Looks::new(recording),
            selection: Selection { follow: true, ..selection.clone() },
            dataset: None,
            started: Instant::now(),
            pace: LookPace::default(),
            problem: None,
            unfit: None,
            silence: None,
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
        self.unfit = None;
        let Some(recording) = self.looks.recording() else { return Ok(None) };
        let dataset = match self.dataset.take() {
            None if found.splits.is_empty() => return Err(recording.why_empty(found)),
            None => Arc::new(found),
            Some(mut known) => {
                let split = recording.split_of(&known)?;
                Arc::make_mut(&mut known).grow(split, found);
                known
            }
        };
        drop(recording);
        let dataset = self.dataset.insert(dataset);
        let has_frames = !Plan::new(dataset, &self.selection, 0)?.frames.is_empty();
        Ok((has_frames || self.is_over).then(|| dataset.clone()))
    }

    /// Whether a session may begin after more frames although it did not now: these show nothing.
    pub fn forgives(&mut self, error: &SessionError) -> bool {
        let is_of_frames =
            matches!(error, SessionError::Range(_) | SessionError::Scene(SceneError::NoPoints(_)));
        if is_of_frames {
            // Kept until there are more frames: the next look finds nothing wrong with the recording.
            self.unfit = Some(error.to_string());
        }
        is_of_frames && !self.is_over
    }

    /// What is selected, and that it is followed.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// Time until a look may find something.
    pub fn rest(&self) -> Duration {
        match self.looks.under_way() {
            Some(_) => Duration::ZERO,
            None => self.pace.rest(self.started.elapsed()),
        }
    }

    /// Why the last look found nothing, or nothing began with what was found, where that is not for lack of new
    /// files.
    pub fn problem(&self) -> Option<&str> {
        self.silence.as_deref().or(self.problem.as_deref()).or(self.unfit.as_deref())
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
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
        if self.looks.under_way().is_none() {
            if !self.pace.rest(now).is_zero() {
                return Ok(Found::Nothing);
            }
            self.pace.ask(now);
            if let Err(source) = self.looks.begin(self.pace.retries(now), now.as_secs_f64()) {
                self.problem =
                    Some(format!("{}: no thread to look at it: {source}", self.path.display()));
            }
        }
        let Some(looked) = self.looks.wait(MOMENT) else {
            self.silence = self.looks.under_way().and_then(|elapsed| silence(&self.path, elapsed));
            return Ok(Found::Nothing);
        };
        self.silence = None;
        if looked.has_ended {
            self.is_over = true;
            return looked.found;
        }
        let Some(took) = looked.took else {
            return Ok(Found::Nothing);
        };
        self.problem = looked.found.as_ref().err().map(ToString::to_string);
        let found = looked.found.unwrap_or(Found::Nothing);
        let (now, has_grown) = (self.started.elapsed(), matches!(found, Found::Frames(_)));
        self.pace.looked(now.saturating_sub(took), now, has_grown);
        Ok(found)
    }

    /// Lets a frame that could not be read be found again when its files no longer look so.
    pub(super) fn give_back(&mut self, frame: String, marks: FrameMarks) {
        self.looks.give_back(frame, marks);
    }
}

fn not_followed(setting: &'static str, expected: &'static str, found: &str) -> DatasetError {
    DatasetError::Option { setting, expected, found: found.to_owned() }
}

/// What is said of a folder that was asked so long ago and has not answered; `None` while it may yet.
pub fn silence(path: &Path, elapsed: Duration) -> Option<String> {
    let (path, s) = (path.display(), SILENT.as_secs());
    (elapsed > SILENT).then(|| format!(
        "{path}: expected its drive to answer, found it silent for {s} seconds; check the connection: what was learnt can be saved meanwhile"
    ))
}
