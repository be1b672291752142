//! Autosave of the training run, and resuming a run that an earlier window left behind.
//!
//! Nothing is written before training has lasted the interval, and nothing of the demo, which can be
//! recomputed. The autosave is removed once the user has saved the run to a file or discarded it.

use super::thread::{RunAutosave, WorkerThread};
use crate::app::abandoned::{AbandonedRun, AutosaveSlot};
use crate::app::opening::Content;
use crate::app::rescue::Rescue;
use crate::app::state::{GivenCalibration, NoticeKind, RunState, Subject};
use crate::app::{abandoned, opening};
use crate::pipeline::autosave::{Autosave, AutosaveInterval, SaveOutcome};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Subfolder of the first rescue folder.
const FOLDER: &str = "autosave";

impl WorkerThread {
    /// Between two turns: starts an autosave if one is due, and reports a failed one.
    pub(super) fn autosave(&mut self) {
        let Some(seconds) = self.training.autosave_s else { return };
        let time = Duration::from_secs(seconds.into());
        let Some(Content::Session(session)) = &self.content else { return };
        let outcome = match &mut self.saver {
            RunAutosave::Off => None,
            RunAutosave::On(autosave, _) => {
                autosave.set_interval(AutosaveInterval { frames: None, time: Some(time) });
                autosave.poll(session)
            }
            RunAutosave::Waiting(_) if self.frames_since_checkpoint == 0 => None,
            RunAutosave::Waiting(since) => {
                let is_due = since.get_or_insert_with(Instant::now).elapsed() >= time;
                if is_due {
                    self.start_autosave();
                }
                return;
            }
        };
        self.report_autosave(outcome);
    }

    /// True if an autosave may start or end without an order or a trained frame.
    pub(super) fn has_pending_autosave(&self) -> bool {
        let Some(Content::Session(session)) = &self.content else { return false };
        match &self.saver {
            _ if self.training.autosave_s.is_none() => false,
            RunAutosave::Off => false,
            RunAutosave::Waiting(_) => self.frames_since_checkpoint > 0,
            RunAutosave::On(autosave, _) => autosave.is_pending(session),
        }
    }

    /// Claims a slot and starts the first autosave.
    fn start_autosave(&mut self) {
        let Some(Content::Session(session)) = &self.content else { return };
        let (Some(folder), Some(dataset)) = (self.autosave_folder(), &session.dataset().path)
        else {
            self.saver = RunAutosave::Off;
            return;
        };
        match AutosaveSlot::claim(&folder, dataset) {
            Ok(slot) => {
                let path = slot.path().to_owned();
                let mut autosave = Autosave::new(path, AutosaveInterval::default(), session);
                let begun = autosave.start_save(session).err().map(Err);
                self.saver = RunAutosave::On(autosave, slot);
                self.report_autosave(begun);
            }
            Err(error) => {
                self.saver = RunAutosave::Off;
                let text = format!(
                    "{}: autosave is off for this run: {error}; use Save to write it to a folder of your choice",
                    folder.display()
                );
                self.notify(NoticeKind::Warning, text);
            }
        }
    }

    fn report_autosave(&mut self, outcome: Option<SaveOutcome>) {
        if let Some(Err(error)) = outcome {
            self.changed = true;
            self.notify(NoticeKind::Warning, error.to_string());
        }
    }

    /// Discards the autosave, because the run is in a file of the user's or is not wanted.
    pub(super) fn discard_autosave(&mut self) {
        let saver = std::mem::replace(&mut self.saver, RunAutosave::Waiting(None));
        if let RunAutosave::On(autosave, slot) = saver {
            // Dropped first, because it may still write to the slot.
            drop(autosave);
            slot.delete_files();
        }
    }

    /// Stops training because the program is terminated, and stores training that no checkpoint holds
    /// in a slot, else in a rescue folder. The demo is not stored, as it can be recomputed.
    pub(super) fn store_for_next_window(&mut self) -> Rescue {
        self.set_state(RunState::Paused);
        let kept = self.store_unsaved_training();
        match &kept {
            Rescue::Nothing => {}
            Rescue::Saved { .. } => self.notify(NoticeKind::Info, format!("terminated: {kept}")),
            Rescue::Lost { .. } => self.notify(NoticeKind::Error, format!("terminated: {kept}")),
        }
        self.snapshot.is_terminated = true;
        kept
    }

    fn store_unsaved_training(&mut self) -> Rescue {
        let frames = self.frames_since_checkpoint;
        let Some(Content::Session(session)) = &self.content else { return Rescue::Nothing };
        if frames == 0 || session.dataset().path.is_none() {
            return Rescue::Nothing;
        }
        match &mut self.saver {
            RunAutosave::On(autosave, _) => {
                let begun = autosave.start_save(session).err().map(Err);
                self.report_autosave(begun);
            }
            // Even if autosave is off, because this is the last chance.
            RunAutosave::Waiting(_) | RunAutosave::Off => self.start_autosave(),
        }
        // The slot is released, not discarded, so that the next window finds it.
        if let RunAutosave::On(mut autosave, slot) =
            std::mem::replace(&mut self.saver, RunAutosave::Off)
            && let Some(Ok(_)) = autosave.wait()
        {
            return Rescue::Saved { path: slot.path().to_owned(), frames };
        }
        self.rescue()
    }

    /// Discards the autosave when the thread ends, because the user was prompted about unsaved training
    /// before. After a crash whose rescue failed it is retained: then this file is the only copy.
    pub(super) fn end_autosave(&mut self) {
        if !matches!(self.rescued, Some(Rescue::Lost { .. })) {
            self.discard_autosave();
        }
    }

    /// Offers the newest run that an earlier window left behind, of one dataset or of any.
    pub(super) fn offer_abandoned_run(&mut self, dataset: Option<&Path>) {
        let found =
            self.autosave_folder().and_then(|folder| abandoned::find_newest(&folder, dataset));
        if let Some(run) = found {
            self.snapshot.abandoned = Some(Arc::new(run));
        }
    }

    /// Resumes the offered run.
    pub(super) fn resume_abandoned_run(&mut self) {
        let Some(run) = self.snapshot.abandoned.take() else { return };
        let before = self.snapshot.state;
        let slot = match AutosaveSlot::lock_existing(&run.slot) {
            Ok(Some(slot)) => slot,
            Ok(None) => return self.keep_offer(&run, "another window has resumed it"),
            Err(error) => return self.keep_offer(&run, &error.to_string()),
        };
        self.snapshot.state = RunState::Loading;
        self.publish(true);
        let (file, serial) = (run.file.clone(), self.next_serial);
        // The drive of the dataset may have been disconnected.
        let read = self.read_cancellable(Some(&run.dataset), move || {
            opening::open_run(&file, serial).map_err(|error| error.to_string())
        });
        match read.and_then(|opened| Ok(opened?)) {
            Ok(opened) => {
                self.next_serial += 1;
                self.subject = Some(Subject::Path(run.dataset.clone()));
                self.install_subject(opened);
                self.take_over(slot);
            }
            Err(refusal) => {
                self.restore_state(before);
                self.keep_offer(&run, &refusal.text);
            }
        }
    }

    /// Continues the autosave in the slot of the resumed run, none of whose frames are in a file of the
    /// user's.
    fn take_over(&mut self, slot: AutosaveSlot) {
        let Some(Content::Session(session)) = &self.content else { return };
        let method = &session.config().method;
        let is_given = !method.assumes_calibration(session.dataset());
        let calibration = method.as_any().calibration().filter(|_| is_given).cloned();
        self.calibration =
            calibration.map(|calibration| Arc::new(GivenCalibration { calibration, file: None }));
        self.snapshot.calibration = self.calibration.clone();
        let path = slot.path().to_owned();
        let autosave = Autosave::new(path, AutosaveInterval::default(), session);
        self.saver = RunAutosave::On(autosave, slot);
        self.frames_since_checkpoint = self.snapshot.frames_done;
        self.snapshot.unsaved_frames = self.snapshot.frames_done;
    }

    fn keep_offer(&mut self, run: &Arc<AbandonedRun>, problem: &str) {
        self.snapshot.abandoned = Some(run.clone());
        let text = format!("{}: training cannot be resumed: {problem}", run.file.display());
        self.notify(NoticeKind::Error, text);
    }

    /// Discards the offered run.
    pub(super) fn discard_abandoned_run(&mut self) {
        let Some(run) = self.snapshot.abandoned.take() else { return };
        if let Ok(Some(slot)) = AutosaveSlot::lock_existing(&run.slot) {
            slot.delete_files();
        }
    }

    fn autosave_folder(&self) -> Option<PathBuf> {
        Some(self.rescue_folders.first()?.join(FOLDER))
    }
}
