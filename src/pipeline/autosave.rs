//! Saving a run on its way without holding it up (`pipeline.md`, Autosave).
//!
//! Between two frames the training thread copies what a checkpoint is made of and goes on; another
//! thread writes the copy. One save is in flight at most: one that falls due meanwhile is put off
//! until that has ended, so that a slow disk costs saves and neither frames nor memory.

use super::checkpoint::{RunError, SessionSnapshot};
use super::panic_text::{NO_WORDS, panic_text};
use super::session::Session;
use crate::export::{atomic, checkpoint};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How often a run is saved on its way: by frames or by time, whichever comes first.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct AutosaveInterval {
    /// Whenever the number of frames learnt is a multiple of this, at least 1.
    pub frames: Option<usize>,
    /// Time from one save to the next.
    pub time: Option<Duration>,
}

/// A save that succeeded.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Autosaved {
    /// Frames learnt that are in the file.
    pub frames: u64,
    /// Size of the file.
    pub bytes: u64,
}

/// A save that failed. The files are as they were before it.
#[derive(Debug, thiserror::Error)]
pub enum AutosaveError {
    /// It could not be written.
    #[error("{0}; training goes on, and the next save is tried when it is due")]
    Run(#[from] RunError),
    /// There is no thread to write it.
    #[error("{}: the thread that saves did not start: {source}; the next save is tried when it is due", path.display())]
    Thread {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The thread ended by a defect of the program.
    #[error("{}: this save was ended by a defect of this program, please report it: {said}; training goes on, and the next save is tried when it is due", path.display())]
    Panicked {
        /// The file.
        path: PathBuf,
        /// What the panic said.
        said: String,
    },
}

/// What became of a save.
pub type SaveOutcome = Result<Autosaved, AutosaveError>;

/// Saves one run again and again under one name; the file before stays as `<name>.bak`.
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
/// let mut session = Session::new(room, SceneOverrides::default(), Selection::everything())?;
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("run.vbgs");
/// let every_frame = AutosaveInterval { frames: Some(1), ..AutosaveInterval::default() };
/// let mut autosave = Autosave::new(path.clone(), every_frame, &session);
/// session.step()?;
/// assert!(autosave.between_frames(&session).is_none(), "begun, not waited for");
/// let saved = autosave.wait().expect("one was in flight")?;
/// assert_eq!((saved.frames, SavedRun::read(&path)?.content.cursor.frames), (1, 1));
/// assert!(!autosave.is_pending(&session), "nothing was learnt since");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Autosave {
    path: PathBuf,
    interval: AutosaveInterval,
    /// Frames learnt, and the moment, when the latest save began.
    begun: (u64, Instant),
    in_flight: Option<JoinHandle<SaveOutcome>>,
}

impl Autosave {
    /// Counts from now on. What saves to this name that were cut short have left is removed: no two
    /// runs may save to one name.
    pub fn new(path: PathBuf, interval: AutosaveInterval, session: &Session) -> Self {
        atomic::remove_leftovers(&path);
        let begun = (session.learner().frames(), Instant::now());
        Self { path, interval, begun, in_flight: None }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Changes how often.
    pub fn set_interval(&mut self, interval: AutosaveInterval) {
        self.interval = interval;
    }

    /// To be called between frames: begins a save if one is due and none is in flight. What became of
    /// the one before, once, when it has ended.
    pub fn between_frames(&mut self, session: &Session) -> Option<SaveOutcome> {
        if self.in_flight.as_ref().is_some_and(|save| !save.is_finished()) {
            return None;
        }
        let ended = self.wait();
        let is_due = self.is_due(session.learner().frames());
        let refused = is_due.then(|| self.begin(session).err()).flatten();
        // A thread that does not start is news; that the save before succeeded is none beside it.
        refused.map(Err).or(ended)
    }

    /// Whether a save is in flight, or will be due after a while by what was learnt so far.
    pub fn is_pending(&self, session: &Session) -> bool {
        let (saved, _) = self.begun;
        self.in_flight.is_some() || session.learner().frames() > saved
    }

    /// Begins a save, due or not, once the one in flight has ended.
    ///
    /// # Errors
    /// [`AutosaveError::Thread`]; or what became of the save in flight, if that failed.
    pub fn begin(&mut self, session: &Session) -> Result<(), AutosaveError> {
        self.begin_by(write, session)
    }

    fn begin_by(
        &mut self,
        save: impl FnOnce(&Path, SessionSnapshot) -> SaveOutcome + Send + 'static,
        session: &Session,
    ) -> Result<(), AutosaveError> {
        self.wait().transpose()?;
        let snapshot = session.snapshot();
        self.begun = (snapshot.frames(), Instant::now());
        let path = self.path.clone();
        let save = std::thread::Builder::new()
            .name("autosave".into())
            .spawn(move || save(&path, snapshot))
            .map_err(|source| AutosaveError::Thread { path: self.path.clone(), source })?;
        self.in_flight = Some(save);
        Ok(())
    }

    /// Waits for the save in flight; what became of it.
    pub fn wait(&mut self) -> Option<SaveOutcome> {
        let outcome = self.in_flight.take()?.join();
        Some(outcome.unwrap_or_else(|panic| {
            let said = panic_text(&*panic).unwrap_or(NO_WORDS).to_owned();
            Err(AutosaveError::Panicked { path: self.path.clone(), said })
        }))
    }

    fn is_due(&self, frames: u64) -> bool {
        let (before, at) = self.begun;
        // Multiples rather than distances, so that a run that goes on saves where it would have.
        let by_frames = |n: usize| frames / n.max(1) as u64 > before / n.max(1) as u64;
        let by_time = |time: Duration| frames > before && at.elapsed() >= time;
        self.interval.frames.is_some_and(by_frames) || self.interval.time.is_some_and(by_time)
    }
}

impl Drop for Autosave {
    /// No file changes after the run is over.
    fn drop(&mut self) {
        drop(self.wait());
    }
}

fn write(path: &Path, snapshot: SessionSnapshot) -> SaveOutcome {
    let frames = snapshot.frames();
    let content = snapshot.into_checkpoint().map_err(RunError::from)?;
    let bytes = checkpoint::write_keeping_old(path, &content).map_err(RunError::from)?;
    Ok(Autosaved { frames, bytes })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{SyntheticParams, dataset};
    use crate::pipeline::checkpoint::SavedRun;
    use crate::pipeline::plan::Selection;
    use crate::pipeline::settings::scene::SceneOverrides;
    use std::sync::Arc;

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
            Session::new(room, SceneOverrides::default(), Selection::everything()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.vbgs");
        let every_frame = AutosaveInterval { frames: Some(1), ..AutosaveInterval::default() };
        let mut autosave = Autosave::new(path.clone(), every_frame, &session);
        session.step().unwrap();
        autosave.begin(&session).unwrap();
        assert_eq!(autosave.wait().unwrap().unwrap().frames, 1);

        let defect = |path: &Path, _: SessionSnapshot| -> SaveOutcome {
            let written = atomic::write_keeping_old(path, |out| {
                out.write_all(&[0; 1 << 20])?;
                panic!("injected into a save")
            });
            Ok(Autosaved { frames: 0, bytes: written.unwrap() })
        };
        session.step().unwrap();
        autosave.begin_by(defect, &session).unwrap();
        let said = autosave.wait().unwrap().unwrap_err().to_string();
        for part in ["run.vbgs", "injected into a save", "training goes on", "when it is due"] {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
        let frames = || SavedRun::read(&path).unwrap().content.cursor.frames;
        assert_eq!(frames(), 1, "the save before is whole");

        session.step().unwrap();
        assert!(autosave.between_frames(&session).is_none(), "begun, not waited for");
        assert_eq!(autosave.wait().unwrap().unwrap().frames, 3);
        assert_eq!(frames(), 3);
        let left = std::fs::read_dir(folder.path()).unwrap().count();
        assert_eq!(left, 2, "the run and the one before, nothing of the save that panicked");
    }
}
