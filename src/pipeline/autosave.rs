//! Autosave without blocking training (`pipeline.md`, Autosave).
//!
//! Between two frames the training thread takes a snapshot and continues; another thread writes it. At most
//! one save is in progress, and a save that becomes due meanwhile is postponed. A slow disk therefore
//! reduces the number of saves, but delays no frames and needs no more memory.

use super::checkpoint::{RunError, SessionSnapshot};
use super::job::Job;
use super::panic_report::PanicReport;
use super::session::Session;
use crate::export::{atomic, checkpoint};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// Default [`AutosaveInterval::time`], seconds. Saving a large scene takes one or two seconds of disk time.
pub const DEFAULT_S: u32 = 30;

/// Autosave interval, in trained frames, in time, or both. If both are given, the earlier one applies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutosaveInterval {
    /// Number of frames, at least 1. A save is due whenever the number of trained frames is a multiple
    /// of this.
    pub frames: Option<usize>,
    /// Largest age of the training that no finished save holds. A save begins earlier by twice the duration
    /// of the previous one, at most by half this time.
    pub time: Option<Duration>,
}

/// Result of a successful save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Autosaved {
    /// Number of trained frames in the file.
    pub frames: u64,
    /// Size of the file in bytes.
    pub bytes: u64,
}

/// Error of a save. Existing files are unchanged.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum AutosaveError {
    /// The file could not be written.
    #[error("{0}; training continues, and the next save is attempted when it is due")]
    Run(#[from] RunError),
    /// The save thread could not be started.
    #[error("{}: the save thread did not start: {source}; the next save is attempted when it is due", path.display())]
    Thread { path: PathBuf, source: std::io::Error },
    /// The save thread panicked.
    #[error("{}: this save failed by a defect of this program, please report it: {panic}; training continues, and the next save is attempted when it is due", path.display())]
    Panicked { path: PathBuf, panic: PanicReport },
}

/// Result of a save.
pub type SaveOutcome = Result<Autosaved, AutosaveError>;

/// Repeated saves of one run to one file; the previous file is retained as `<name>.bak`.
///
/// ```
/// use std::sync::Arc;
/// use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
/// use vbgs_studio::pipeline::autosave::{Autosave, AutosaveInterval};
/// use vbgs_studio::pipeline::checkpoint::SavedRun;
/// use vbgs_studio::pipeline::plan::Selection;
/// use vbgs_studio::pipeline::session::{Session, Step};
/// use vbgs_studio::pipeline::settings::scene::SceneOverrides;
///
/// let small = SyntheticParams { width: 32, height: 24, n_train: 6, n_eval: 1, ..SyntheticParams::demo() };
/// let room = Arc::new(synthetic::dataset(&small)?);
/// let mut session = Session::new(room, SceneOverrides::default(), Selection::all_frames())?;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("run.vbgs");
/// let every_frame = AutosaveInterval { frames: Some(1), ..AutosaveInterval::default() };
/// let mut autosave = Autosave::new(path.clone(), every_frame, &session);
/// session.step()?;
/// assert!(autosave.poll(&session).is_none(), "started, not finished");
/// let saved = autosave.wait().expect("a save in progress")?;
/// assert_eq!((saved.frames, SavedRun::read(&path)?.content.cursor.frames), (1, 1));
/// assert!(!autosave.is_pending(&session), "no frames since the save");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Autosave {
    path: PathBuf,
    interval: AutosaveInterval,
    /// Number of trained frames and time at the start of the latest save.
    begun: (u64, Instant),
    /// Duration of the latest finished save, up to the frame after it.
    lasted: Duration,
    in_flight: Option<Job<SaveOutcome>>,
    gate: Arc<Gate>,
}

/// Longest wait for a save that reads the dataset before it is given up.
const PATIENCE: Duration = Duration::from_secs(1);

/// True once no file may be written any more. Locked while a file is written.
type Gate = Mutex<bool>;

impl Autosave {
    /// Prepares saves to `path` without saving yet, and removes files left over from interrupted saves.
    /// Two runs must not save to the same path.
    pub fn new(path: PathBuf, interval: AutosaveInterval, session: &Session) -> Self {
        atomic::remove_leftovers(&path);
        let begun = (session.learner().status().frames, Instant::now());
        let lasted = Duration::ZERO;
        Self { path, interval, begun, lasted, in_flight: None, gate: Arc::default() }
    }

    /// Path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Changes the interval.
    pub fn set_interval(&mut self, interval: AutosaveInterval) {
        self.interval = interval;
    }

    /// Starts a save if one is due and none is in progress; to be called between frames. Returns the
    /// result of the previous save, once, when it has finished.
    pub fn poll(&mut self, session: &Session) -> Option<SaveOutcome> {
        let ended = self.take_outcome(Duration::ZERO);
        if self.in_flight.is_some() {
            return None;
        }
        let is_due = self.is_due(session.learner().status().frames);
        let refused = is_due.then(|| self.start_save(session).err()).flatten();
        // A thread that did not start takes precedence over the success of the previous save.
        refused.map(Err).or(ended)
    }

    /// True while a save is in progress, or if frames were trained on since the start of the latest
    /// save.
    pub fn is_pending(&self, session: &Session) -> bool {
        let (saved, _) = self.begun;
        self.in_flight.is_some() || session.learner().status().frames > saved
    }

    /// Starts a save regardless of the schedule. First waits for any save in progress.
    ///
    /// # Errors
    /// [`AutosaveError::Thread`], or the error of the save in progress.
    pub fn start_save(&mut self, session: &Session) -> Result<(), AutosaveError> {
        self.start_save_with(write, session)
    }

    fn start_save_with(
        &mut self,
        save: impl FnOnce(&Path, SessionSnapshot, &Gate) -> SaveOutcome + Send + 'static,
        session: &Session,
    ) -> Result<(), AutosaveError> {
        self.wait().transpose()?;
        let snapshot = session.snapshot();
        // Recorded before the thread starts, so that a failed start is retried when due, not after every
        // frame.
        self.begun = (snapshot.frames(), Instant::now());
        let (path, gate) = (self.path.clone(), self.gate.clone());
        let save = Job::start("autosave", move || save(&path, snapshot, &gate))
            .map_err(|source| AutosaveError::Thread { path: self.path.clone(), source })?;
        self.in_flight = Some(save);
        Ok(())
    }

    /// Waits for the save in progress and returns its result; `None` if no save is in progress.
    pub fn wait(&mut self) -> Option<SaveOutcome> {
        self.take_outcome(Duration::MAX)
    }

    fn take_outcome(&mut self, patience: Duration) -> Option<SaveOutcome> {
        let outcome = self.in_flight.as_ref()?.wait(patience)?;
        self.in_flight = None;
        self.lasted = self.begun.1.elapsed();
        Some(outcome.unwrap_or_else(|panic| {
            Err(AutosaveError::Panicked { path: self.path.clone(), panic })
        }))
    }

    fn is_due(&self, frames: u64) -> bool {
        let (before, at) = self.begun;
        // Multiples instead of distances, so that a resumed run saves at the same frames. At least 1, because
        // an interval of zero frames must not divide by zero.
        let by_frames = |n: usize| frames / n.max(1) as u64 > before / n.max(1) as u64;
        // What was trained meanwhile is lost if a save is killed. The first one has no predecessor.
        let ahead = |time: Duration| (2 * self.lasted).clamp(time / 20, time / 2);
        let by_time = |time: Duration| frames > before && at.elapsed() + ahead(time) >= time;
        self.interval.frames.is_some_and(by_frames) || self.interval.time.is_some_and(by_time)
    }
}

impl Drop for Autosave {
    fn drop(&mut self) {
        if self.in_flight.is_none() || self.take_outcome(PATIENCE).is_some() {
            return;
        }
        // No file may change after the end of the run. A save that still reads the dataset is given up, since
        // its drive may never answer.
        let is_closed = self.gate.try_lock().map(|mut is_closed| *is_closed = true).is_ok();
        if !is_closed {
            drop(self.wait());
        }
    }
}

fn write(path: &Path, snapshot: SessionSnapshot, gate: &Gate) -> SaveOutcome {
    let frames = snapshot.frames();
    let content = snapshot.into_checkpoint().map_err(RunError::from)?;
    let is_closed = gate.lock().unwrap_or_else(PoisonError::into_inner);
    if *is_closed {
        // Nobody reads this outcome.
        return Ok(Autosaved { frames, bytes: 0 });
    }
    let bytes = checkpoint::write_keeping_old(path, content).map_err(RunError::from)?;
    Ok(Autosaved { frames, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{SyntheticParams, dataset};
    use crate::pipeline::checkpoint::SavedRun;
    use crate::pipeline::plan::Selection;
    use crate::pipeline::settings::scene::SceneOverrides;

    #[test]
    fn a_panic_of_the_saving_thread_costs_one_save_and_is_told() {
        let small = SyntheticParams {
            width: 32,
            height: 24,
            n_train: 3,
            n_eval: 1,
            ..SyntheticParams::demo()
        };
        let room = Arc::new(dataset(&small).unwrap());
        let mut session =
            Session::new(room, SceneOverrides::default(), Selection::all_frames()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.vbgs");
        let every_frame = AutosaveInterval { frames: Some(1), ..AutosaveInterval::default() };
        let mut autosave = Autosave::new(path.clone(), every_frame, &session);
        session.step().unwrap();
        autosave.start_save(&session).unwrap();
        assert_eq!(autosave.wait().unwrap().unwrap().frames, 1);

        let defect = |path: &Path, _: SessionSnapshot, _: &Gate| -> SaveOutcome {
            let written = atomic::write_with_backup(path, |out| {
                out.write_all(&[0; 1 << 20])?;
                panic!("injected into a save")
            });
            Ok(Autosaved { frames: 0, bytes: written.unwrap() })
        };
        session.step().unwrap();
        autosave.start_save_with(defect, &session).unwrap();
        let said = autosave.wait().unwrap().unwrap_err().to_string();
        for part in ["run.vbgs", "injected into a save", "training continues", "when it is due"] {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
        let frames = || SavedRun::read(&path).unwrap().content.cursor.frames;
        assert_eq!(frames(), 1, "the previous save is complete");

        session.step().unwrap();
        assert!(autosave.poll(&session).is_none(), "started, not finished");
        assert_eq!(autosave.wait().unwrap().unwrap().frames, 3);
        assert_eq!(frames(), 3);
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "the run and its backup, nothing of the save that panicked");
    }
}
