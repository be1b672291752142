//! Autosaves the training run, and stores it when the program ends unexpectedly.
//!
//! The first autosave is written a second after the first unsaved frame, later ones by the interval. The demo is
//! never written, because it can be recomputed. The autosave is removed once the user has saved the run to
//! a file or discarded it.

use crate::app::rescue::{self, AbandonedRun, AutosaveSlot, Rescue};
use crate::pipeline::autosave::{Autosave, AutosaveInterval};
use crate::pipeline::session::Session;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub struct Files {
    /// Folders for autosave slots, in order of preference. All but the first are used only when the
    /// program ends unexpectedly.
    folders: Vec<PathBuf>,
    saver: Saver,
    /// Number of trained frames that no checkpoint contains.
    n_unsaved: usize,
    /// True if no checkpoint contains the latest scale, level or coordinates.
    is_registration_unsaved: bool,
}

/// Time from the first unsaved frame to the first autosave.
const FIRST: Duration = Duration::from_secs(1);

enum Saver {
    /// Nothing is saved yet. Holds the time of the first unsaved frame, if there is one.
    Waiting(Option<Instant>),
    On(Autosave, AutosaveSlot),
    /// Autosave has failed and the user was warned, or nothing is open that can be autosaved.
    Off,
    /// The run was stored because of a panic or the end of the program, and its slot is released.
    Stored(Rescue),
}

impl Files {
    pub fn new(folders: Vec<PathBuf>) -> Self {
        Self { folders, saver: Saver::Off, n_unsaved: 0, is_registration_unsaved: false }
    }

    pub fn record_frame(&mut self) {
        self.n_unsaved += 1;
    }

    /// Records a new scale, level or coordinates, and saves them although no frame is trained. Returns a
    /// warning if this fails.
    pub fn record_registration(&mut self, session: Option<&Session>) -> Option<String> {
        self.is_registration_unsaved = true;
        match (&mut self.saver, session) {
            (Saver::On(autosave, _), Some(session)) => {
                autosave.start_save(session).err().map(|error| error.to_string())
            }
            // The first autosave contains it.
            _ => None,
        }
    }

    fn has_unsaved(&self) -> bool {
        self.n_unsaved > 0 || self.is_registration_unsaved
    }

    pub fn record_save(&mut self) {
        // The slot was released, so that another window may hold it.
        if let Saver::Stored(Rescue::Stored { path, .. }) = &self.saver
            && let Ok(Some(slot)) = AutosaveSlot::lock_existing(path)
        {
            slot.delete_files();
        }
        self.discard();
    }

    /// Deletes the autosave of a run that the user has saved or discarded, and prepares for the next
    /// run. The file of a stored run remains until the next startup.
    pub fn discard(&mut self) {
        (self.n_unsaved, self.is_registration_unsaved) = (0, false);
        let saver = std::mem::replace(&mut self.saver, Saver::Waiting(None));
        if let Saver::On(autosave, slot) = saver {
            // Dropped first, because it may still write to the slot.
            drop(autosave);
            slot.delete_files();
        }
    }

    /// Starts an autosave if one is due. Returns a warning if an autosave has failed.
    pub fn poll(&mut self, session: &Session, time: Duration) -> Option<String> {
        let has_unsaved = self.has_unsaved();
        match &mut self.saver {
            Saver::Off | Saver::Stored(_) => None,
            Saver::On(autosave, _) => {
                // The user may change the interval at any time.
                autosave.set_interval(AutosaveInterval { frames: None, time: Some(time) });
                autosave.poll(session)?.err().map(|error| error.to_string())
            }
            Saver::Waiting(_) if !has_unsaved => None,
            Saver::Waiting(since) => {
                // Soon, so that a short run that is killed is offered, too.
                let is_due = since.get_or_insert_with(Instant::now).elapsed() >= time.min(FIRST);
                if is_due { self.start(session).err() } else { None }
            }
        }
    }

    /// True if an autosave may start or finish although no order arrives and no frame is trained.
    pub fn is_pending(&self, session: &Session) -> bool {
        match &self.saver {
            Saver::Off | Saver::Stored(_) => false,
            Saver::Waiting(_) => self.has_unsaved(),
            Saver::On(autosave, _) => autosave.is_pending(session),
        }
    }

    fn start(&mut self, session: &Session) -> Result<(), String> {
        // Stays off if no slot can be claimed, so that the user is warned once.
        self.saver = Saver::Off;
        // The demo has no path; it can be recomputed and is not saved.
        let (Some(folder), Some(dataset)) = (self.folders.first(), &session.dataset().path) else {
            return Ok(());
        };
        let slot = AutosaveSlot::claim(folder, dataset).map_err(|error| {
            format!(
                "{}: autosave is off for this run: {error}; use Save to write it to a folder of your choice",
                folder.display()
            )
        })?;
        let path = slot.path().to_owned();
        let mut autosave = Autosave::new(path, AutosaveInterval::default(), session);
        let begun = autosave.start_save(session).map_err(|error| error.to_string());
        self.saver = Saver::On(autosave, slot);
        begun
    }

    /// Continues autosaving a resumed run in its slot.
    pub fn adopt(&mut self, slot: AutosaveSlot, session: &Session) {
        let path = slot.path().to_owned();
        let autosave = Autosave::new(path, AutosaveInterval::default(), session);
        self.saver = Saver::On(autosave, slot);
        // None of these frames are in a file of the user's.
        self.n_unsaved = session.learner().status().frames as usize;
    }

    /// Finds the newest run that an earlier window neither saved nor discarded. Without `dataset`,
    /// considers the runs of all datasets.
    pub fn find_abandoned(&self, dataset: Option<&Path>) -> Option<AbandonedRun> {
        rescue::find_newest(&self.folders, dataset)
    }

    /// Stores training that no checkpoint contains, even if autosave is off, so that it can be resumed
    /// after the next startup. Repeated calls store it only once. The demo is not stored.
    pub fn store(&mut self, session: Option<&Session>) -> Rescue {
        // A panic and the end of the program may both store the same state.
        if let Saver::Stored(known) = &self.saver {
            return known.clone();
        }
        let frames = self.n_unsaved;
        let Some(session) = session.filter(|_| self.has_unsaved()) else { return Rescue::Nothing };
        let Some(dataset) = &session.dataset().path else { return Rescue::Nothing };
        let used = match std::mem::replace(&mut self.saver, Saver::Off) {
            Saver::On(autosave, slot) => {
                // Dropped first, because it may still write to the slot.
                drop(autosave);
                Some(slot)
            }
            _ => None,
        };
        let others = self.folders.iter().map(|folder| {
            AutosaveSlot::claim(folder, dataset)
                .map_err(|error| format!("{}: {error}", folder.display()))
        });
        let mut problems = Vec::new();
        let mut rescue = None;
        // The slot in use comes first: it holds an older state of the same run.
        for slot in used.map(Ok).into_iter().chain(others) {
            let stored = slot.and_then(|slot| {
                let path = slot.path().to_owned();
                session.save_after_panic(&path).map(|()| path)
            });
            match stored {
                Ok(path) => {
                    rescue = Some(Rescue::Stored { path, frames });
                    break;
                }
                Err(problem) => problems.push(problem),
            }
        }
        let rescue = rescue.unwrap_or(Rescue::Lost { frames, problems });
        self.saver = Saver::Stored(rescue.clone());
        rescue
    }
}
