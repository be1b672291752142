//! Follows a recording in progress: schedules scans of its folder and processes their results.
//!
//! The training thread polls between frames with a short timeout; no background watcher exists. Each scan
//! runs on its own thread, so a drive that does not respond never blocks saving.

use super::error::SessionError;
use super::job::Job;
use super::plan::{Order, Plan, Selection};
use super::settings::scene::SceneError;
use crate::dataset::error::DatasetError;
use crate::dataset::growing::GrowingRecording;
use crate::dataset::splits::{HELD_OUT, HoldOut};
use crate::dataset::{Dataset, FrameMarks, LoadOptions};
use std::collections::VecDeque;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum time that training waits for a scan.
// Most scans take less, and a user does not notice the delay.
const POLL_TIMEOUT: Duration = Duration::from_millis(50);

/// Time after which a drive counts as not responding.
const DRIVE_TIMEOUT: Duration = Duration::from_secs(3);

/// Recording that is polled for new frames while it grows.
pub struct Follow {
    path: PathBuf,
    // The scan thread holds the lock until the drive responds, so other threads never wait for it.
    recording: Arc<Mutex<GrowingRecording>>,
    scan: Option<Job<ScanResult>>,
    /// Unreadable frames that [`Self::give_back`] received during a scan.
    returned: Vec<(String, FrameMarks)>,
    selection: Selection,
    /// Frames found before the start of a session.
    dataset: Option<Arc<Dataset>>,
    started: Instant,
    pace: PollSchedule,
    /// Error message of the last scan.
    problem: Option<String>,
    /// Error message of starting a session on the frames found so far.
    unfit: Option<String>,
    /// Warning that the drive has not responded to the current scan.
    silence: Option<String>,
    is_over: bool,
}

impl Follow {
    /// Starts to follow the recording in the folder `path`, which may not exist yet.
    ///
    /// # Errors
    /// A selection that requires all frames in advance, an option out of range, or a file instead of a
    /// folder.
    pub fn new(
        path: &Path,
        load: &LoadOptions,
        selection: &Selection,
    ) -> Result<Self, DatasetError> {
        // Each of these needs frames that do not exist yet.
        if selection.order != Order::Sequential {
            return Err(follow_error("order", "sequential with follow", "shuffled"));
        }
        if selection.passes > 1 {
            return Err(follow_error("passes", "1 with follow", &selection.passes.to_string()));
        }
        if selection.hold_out == HoldOut::Sector {
            return Err(follow_error("hold-out", "every-8th with follow", "sector"));
        }
        if selection.split.as_deref() == Some(HELD_OUT) {
            let expected = "the recorded split, with follow";
            return Err(follow_error("split", expected, HELD_OUT));
        }
        let recording = GrowingRecording::new(path, load, selection.split_name())?;
        Ok(Self::with(recording, selection))
    }

    /// Follows the recording of an opened dataset for frames after the known ones. `None` if the dataset
    /// is not a folder, or if a sector is held out.
    pub(super) fn of(dataset: &Dataset, split: usize, selection: &Selection) -> Option<Self> {
        // The sector depends on all cameras, so later frames would change it.
        if selection.hold_out == HoldOut::Sector {
            return None;
        }
        Some(Self::with(GrowingRecording::of(dataset, split)?, selection))
    }

    fn with(recording: GrowingRecording, selection: &Selection) -> Self {
        Self {
            path: recording.path().to_owned(),
            recording: Arc::new(Mutex::new(recording)),
            scan: None,
            returned: Vec::new(),
            selection: Selection { follow: true, ..selection.clone() },
            dataset: None,
            started: Instant::now(),
            pace: PollSchedule::default(),
            problem: None,
            unfit: None,
            silence: None,
            is_over: false,
        }
    }

    /// Polls the recording. If it has grown and has a frame to train on, returns all frames so far as a
    /// dataset. A session started with this dataset gets `self` through
    /// [`Session::follow`](super::session::Session::follow).
    ///
    /// # Errors
    /// A defect in a recording that has ended.
    pub fn poll_dataset(&mut self) -> Result<Option<Arc<Dataset>>, DatasetError> {
        let (ScanFindings::Frames(found) | ScanFindings::End(Some(found))) = self.poll()? else {
            return Ok(None);
        };
        self.unfit = None;
        // The scan has ended, so its thread no longer holds the lock.
        let recording = lock(&self.recording);
        let dataset = match self.dataset.take() {
            None if found.splits.is_empty() => return Err(recording.empty_poll_error(found)),
            None => Arc::new(found),
            Some(mut known) => {
                let split = recording.split_of(&known)?;
                Arc::make_mut(&mut known).append_polled(split, found);
                known
            }
        };
        if self.selection.split.is_none() {
            self.selection.followed_split = recording.split().map(str::to_owned);
        }
        drop(recording);
        let dataset = self.dataset.insert(dataset);
        let has_frames = !Plan::new(dataset, &self.selection, 0)?.frames.is_empty();
        Ok((has_frames || self.is_over).then(|| dataset.clone()))
    }

    /// Stores an error of starting a session if it is due to a lack of usable points. Returns true if
    /// further frames may provide such points.
    pub fn may_succeed_later(&mut self, error: &SessionError) -> bool {
        let is_of_frames =
            matches!(error, SessionError::Range(_) | SessionError::Scene(SceneError::NoPoints(_)));
        if is_of_frames {
            // In a field of its own, because the next scan succeeds and would clear `problem`.
            self.unfit = Some(error.to_string());
        }
        is_of_frames && !self.is_over
    }

    /// Selection of the session's frames. Names the followed split once the recording has frames.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// Time until the next scan is due; zero while a scan is in progress.
    pub fn time_to_next_scan(&self) -> Duration {
        if self.scan.is_some() {
            return Duration::ZERO;
        }
        self.pace.time_to_next_check(self.started.elapsed())
    }

    /// Current problem: a drive that does not respond, or the error of the last scan or of starting a
    /// session on the frames found. `None` if there are merely no new files.
    pub fn problem(&self) -> Option<&str> {
        // A silent drive hides everything older.
        self.silence.as_deref().or(self.problem.as_deref()).or(self.unfit.as_deref())
    }

    /// Path of the recording's folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(super) fn without_dataset(self) -> Self {
        // The session owns the frames; a second owner would make it copy the dataset on growth.
        Self { dataset: None, ..self }
    }

    /// Scans the recording if a scan is due, and returns the new frames.
    ///
    /// # Errors
    /// A defect in a recording that has ended. Before the end, a defect may be temporary and is not an
    /// error.
    ///
    /// # Panics
    /// If the scan panicked.
    pub(super) fn poll(&mut self) -> Result<ScanFindings, DatasetError> {
        if self.is_over {
            return Ok(ScanFindings::End(None));
        }
        let now = self.started.elapsed();
        let Some(scan) = self.scan.take().or_else(|| self.start_scan(now)) else {
            return Ok(ScanFindings::Nothing);
        };
        let Some(ended) = scan.wait(POLL_TIMEOUT) else {
            self.silence = silence(&self.path, scan.elapsed());
            self.scan = Some(scan);
            return Ok(ScanFindings::Nothing);
        };
        self.silence = None;
        let ScanResult { found, has_ended, took } =
            ended.unwrap_or_else(|panic| resume_unwind(Box::new(panic.message)));
        if has_ended {
            self.is_over = true;
            return found;
        }
        let Some(took) = took else {
            return Ok(ScanFindings::Nothing);
        };
        self.problem = found.as_ref().err().map(ToString::to_string);
        let found = found.unwrap_or(ScanFindings::Nothing);
        let (now, has_grown) = (self.started.elapsed(), matches!(found, ScanFindings::Frames(_)));
        self.pace.record_poll(now.saturating_sub(took), now, has_grown);
        Ok(found)
    }

    fn start_scan(&mut self, now: Duration) -> Option<Job<ScanResult>> {
        if !self.pace.time_to_next_check(now).is_zero() {
            return None;
        }
        self.pace.record_check(now);
        // No scan is running, so the lock is free.
        for (frame, marks) in self.returned.drain(..) {
            lock(&self.recording).return_frame(frame, marks);
        }
        let (recording, retries) = (self.recording.clone(), self.pace.is_retry_due(now));
        let scan =
            Job::start("scan", move || scan(&mut lock(&recording), retries, now.as_secs_f64()));
        let no_thread = |source| format!("{}: no thread to scan it: {source}", self.path.display());
        scan.map_err(|source| self.problem = Some(no_thread(source))).ok()
    }

    /// Marks an unreadable frame as not found, so that later scans find it again once its files have
    /// changed.
    pub(super) fn give_back(&mut self, frame: String, marks: FrameMarks) {
        match self.scan {
            // The scan holds the lock, perhaps for as long as its drive hangs.
            Some(_) => self.returned.push((frame, marks)),
            None => lock(&self.recording).return_frame(frame, marks),
        }
    }
}

pub(super) enum ScanFindings {
    /// There is no complete new frame.
    Nothing,
    Frames(Dataset),
    /// The recording has ended, perhaps with further frames.
    End(Option<Dataset>),
}

struct ScanResult {
    found: Result<ScanFindings, DatasetError>,
    has_ended: bool,
    /// Time spent reading the recording; `None` if there was nothing to read.
    took: Option<Duration>,
}

fn lock(recording: &Mutex<GrowingRecording>) -> MutexGuard<'_, GrowingRecording> {
    // `poll` raises a panic of the scan again, so a poisoned lock needs no second report.
    recording.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Scans a recording if it has changed or ended. With `retries`, also scans an unchanged recording that
/// has unresolved frames. `now_s` is a monotonic time in seconds.
fn scan(recording: &mut GrowingRecording, retries: bool, now_s: f64) -> ScanResult {
    // Checked before the scan: once the recorder has ended, the scan is complete.
    let has_ended = recording.has_ended();
    let retries = retries && recording.is_unresolved();
    if !(has_ended || retries || recording.has_changed()) {
        return ScanResult { found: Ok(ScanFindings::Nothing), has_ended, took: None };
    }
    let begun = Instant::now();
    let found = recording.poll(!has_ended, now_s);
    let found = match (found, has_ended) {
        (Err(error), _) => Err(error),
        (Ok(found), true) => Ok(ScanFindings::End(Some(found))),
        (Ok(found), false) => match recording.mark_taken(&found) {
            0 if !recording.has_begun() => Err(recording.empty_poll_error(found)),
            0 => Ok(ScanFindings::Nothing),
            _ => Ok(ScanFindings::Frames(found)),
        },
    };
    ScanResult { found, has_ended, took: Some(begun.elapsed()) }
}

fn follow_error(setting: &'static str, expected: &'static str, found: &str) -> DatasetError {
    DatasetError::Option { setting, expected, found: found.to_owned() }
}

/// Returns a warning if a drive has not responded for too long.
pub fn silence(path: &Path, elapsed: Duration) -> Option<String> {
    let (path, s) = (path.display(), DRIVE_TIMEOUT.as_secs());
    (elapsed > DRIVE_TIMEOUT).then(|| format!(
        "{path}: expected its drive to respond, found it silent for {s} seconds; check the connection: the result so far can be saved meanwhile"
    ))
}

/// Minimum time between two checks for changes; shorter than the interval between two camera frames.
const TICK: Duration = Duration::from_millis(20);
/// Minimum time between polls while folders and lists do not change. Such polls may find a file that
/// became complete.
const RETRY: Duration = Duration::from_millis(50);
/// Time without a new frame after which polling slows down.
const QUIET: Duration = Duration::from_secs(10);
const QUIET_TICK: Duration = Duration::from_millis(100);
const QUIET_RETRY: Duration = Duration::from_secs(1);
/// Number of recent polls from which the duration of the next one is estimated.
const LATEST: usize = 8;
/// Polls take at most the fraction 1/`SHARE` of the time.
const SHARE: u32 = 20;

/// Schedule of the polls of a growing recording. Times are relative to an arbitrary start.
#[derive(Default)]
struct PollSchedule {
    last_check: Option<Duration>,
    last_poll: Option<Duration>,
    costs: VecDeque<Duration>,
    last_growth: Duration,
}

impl PollSchedule {
    /// Returns the time until the next check for changes is due.
    fn time_to_next_check(&self, now: Duration) -> Duration {
        let tick = if self.is_quiet(now) { QUIET_TICK } else { TICK };
        let left = |least: Duration, since: Option<Duration>| {
            // Saturates once the time has passed: the check is due at once.
            since.map_or(Duration::ZERO, |since| (since + least).saturating_sub(now))
        };
        // The fastest recent poll: slower ones were delayed by other load.
        let cost = self.costs.iter().min().copied().unwrap_or_default();
        left(tick, self.last_check).max(left(SHARE * cost, self.last_poll))
    }

    /// Records that a check for changes was made.
    fn record_check(&mut self, now: Duration) {
        self.last_check = Some(now);
    }

    /// True if a poll is due although no folder or list has changed. The poll may find a file that
    /// became complete.
    fn is_retry_due(&self, now: Duration) -> bool {
        let retry = if self.is_quiet(now) { QUIET_RETRY } else { RETRY };
        self.last_poll.is_none_or(|polled| now >= polled + retry)
    }

    /// Records the start and end of a poll, and whether it found frames.
    fn record_poll(&mut self, begun: Duration, now: Duration, has_grown: bool) {
        self.last_poll = Some(now);
        if self.costs.len() == LATEST {
            self.costs.pop_front();
        }
        self.costs.push_back(now.saturating_sub(begun));
        if has_grown {
            self.last_growth = now;
        }
    }

    fn is_quiet(&self, now: Duration) -> bool {
        now > self.last_growth + QUIET
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_take_a_twentieth_of_the_time_at_most() {
        let ms = Duration::from_millis;
        let mut pace = PollSchedule::default();
        assert_eq!(pace.time_to_next_check(ms(0)), ms(0), "the first is at once");
        pace.record_check(ms(0));
        assert!(pace.is_retry_due(ms(0)));
        pace.record_poll(ms(0), ms(1), true);
        assert_eq!(pace.time_to_next_check(ms(1)), ms(20), "a quick one: the next tick");
        pace.record_poll(ms(60), ms(110), true);
        assert_eq!(pace.time_to_next_check(ms(110)), ms(20), "it was interrupted");
        for _ in 0..LATEST {
            pace.record_poll(ms(100), ms(110), true);
        }
        assert_eq!(pace.time_to_next_check(ms(110)), ms(200), "looks have become slow");
        assert!(!pace.is_retry_due(ms(159)) && pace.is_retry_due(ms(160)));
        // A long time without new frames.
        pace.record_check(ms(20_000));
        assert_eq!(pace.time_to_next_check(ms(20_000)), ms(100));
        pace.record_poll(ms(20_000), ms(20_000), false);
        assert!(!pace.is_retry_due(ms(20_500)) && pace.is_retry_due(ms(21_000)));
    }
}
