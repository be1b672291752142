//! Saving what is trained on its way, and going on with what an earlier window left behind.
//!
//! Nothing is written before training is older than the interval, nor of the demo, which can be made
//! again at any time. What was saved on the way is removed once the user has the run in a file, or
//! has said that it is not wanted.

use super::run_autosave::RunAutosave;
use super::thread::WorkerThread;
use crate::app::abandoned::{self, AbandonedRun, AutosaveSlot};
use crate::app::opening::{self, Content};
use crate::app::rescue::Rescue;
use crate::app::state::{GivenCalibration, NoticeKind, RunState, Subject};
use crate::pipeline::autosave::{Autosave, AutosaveInterval, SaveOutcome};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Subfolder of the first folder for rescued scenes.
const FOLDER: &str = "autosave";

impl WorkerThread {
    /// Between two turns: begins a save if one is due, and tells of one that failed.
    pub(super) fn autosave(&mut self) {
        let Some(seconds) = self.training.autosave_s else { return };
        let time = Duration::from_secs(seconds.into());
        let Some(Content::Session(session)) = &self.content else { return };
        let outcome = match &mut self.saver {
            RunAutosave::Off => None,
            RunAutosave::On(autosave, _) => {
                autosave.set_interval(AutosaveInterval { frames: None, time: Some(time) });
                autosave.between_frames(session)
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
        self.tell_of_autosave(outcome);
    }

    /// Whether a save may begin or end before anything is ordered or trained.
    pub(super) fn saves_by_itself(&self) -> bool {
        let Some(Content::Session(session)) = &self.content else { return false };
        match &self.saver {
            _ if self.training.autosave_s.is_none() => false,
            RunAutosave::Off => false,
            RunAutosave::Waiting(_) => self.frames_since_checkpoint > 0,
            RunAutosave::On(autosave, _) => autosave.is_pending(session),
        }
    }

    /// Claims a slot and begins the first save.
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
                let begun = autosave.begin(session).err().map(Err);
                self.saver = RunAutosave::On(autosave, slot);
                self.tell_of_autosave(begun);
            }
            Err(error) => {
                self.saver = RunAutosave::Off;
                let text = format!(
                    "{}: this run is not saved on its way: {error}; Save writes it where you say",
                    folder.display()
                );
                self.notify(NoticeKind::Warning, text);
            }
        }
    }

    fn tell_of_autosave(&mut self, outcome: Option<SaveOutcome>) {
        if let Some(Err(error)) = outcome {
            self.changed = true;
            self.notify(NoticeKind::Warning, error.to_string());
        }
    }

    /// What is trained is in a file of the user's choice or is given up: what was saved on the way is
    /// not needed.
    pub(super) fn forget_autosave(&mut self) {
        let saver = std::mem::replace(&mut self.saver, RunAutosave::Waiting(None));
        if let RunAutosave::On(autosave, slot) = saver {
            // First, for it may write to the slot until then.
            drop(autosave);
            slot.discard();
        }
    }

    /// The program is ended from outside: training stops, and what no checkpoint holds is kept in a slot, else
    /// where scenes are rescued to. The demo can be made again at any time.
    pub(super) fn leave_behind(&mut self) -> Rescue {
        self.set_state(RunState::Paused);
        let kept = self.keep();
        match &kept {
            Rescue::Nothing => {}
            Rescue::Saved { .. } => self.notify(NoticeKind::Info, format!("ended: {kept}")),
            Rescue::Lost { .. } => self.notify(NoticeKind::Error, format!("ended: {kept}")),
        }
        self.snapshot.is_left_behind = true;
        kept
    }

    fn keep(&mut self) -> Rescue {
        let frames = self.frames_since_checkpoint;
        let Some(Content::Session(session)) = &self.content else { return Rescue::Nothing };
        if frames == 0 || session.dataset().path.is_none() {
            return Rescue::Nothing;
        }
        match &mut self.saver {
            RunAutosave::On(autosave, _) => {
                let begun = autosave.begin(session).err().map(Err);
                self.tell_of_autosave(begun);
            }
            // Whatever the user said of saving now and then: this is the end.
            RunAutosave::Waiting(_) | RunAutosave::Off => self.start_autosave(),
        }
        // The slot is let go and not discarded.
        if let RunAutosave::On(mut autosave, slot) =
            std::mem::replace(&mut self.saver, RunAutosave::Off)
            && let Some(Ok(_)) = autosave.wait()
        {
            return Rescue::Saved { path: slot.path().to_owned(), frames };
        }
        self.rescue()
    }

    /// The thread ends. Whoever ended it has asked the user about what is not saved, unless a crash
    /// came before; then this file is all there is.
    pub(super) fn end_autosave(&mut self) {
        if !matches!(self.rescued, Some(Rescue::Lost { .. })) {
            self.forget_autosave();
        }
    }

    /// Offers the newest run that an earlier window left behind, of one dataset or of any.
    pub(super) fn look_for_abandoned(&mut self, dataset: Option<&Path>) {
        let found = self.autosave_folder().and_then(|folder| abandoned::find(&folder, dataset));
        if let Some(run) = found {
            self.snapshot.abandoned = Some(Arc::new(run));
        }
    }

    /// Opens the run that is offered where it stopped.
    pub(super) fn go_on(&mut self) {
        let Some(run) = self.snapshot.abandoned.take() else { return };
        let before = self.snapshot.state;
        let slot = match AutosaveSlot::take(&run.slot) {
            Ok(Some(slot)) => slot,
            Ok(None) => return self.keep_offer(&run, "another window has gone on with it"),
            Err(error) => return self.keep_offer(&run, &error.to_string()),
        };
        self.snapshot.state = RunState::Loading;
        self.publish(true);
        let (file, serial) = (run.file.clone(), self.next_serial);
        // Its dataset may be on a drive that is gone meanwhile.
        let read = self.read(Some(&run.dataset), move || {
            opening::open_run(&file, serial).map_err(|error| error.to_string())
        });
        match read.and_then(|opened| Ok(opened?)) {
            Ok(opened) => {
                self.next_serial += 1;
                self.subject = Some(Subject::Path(run.dataset.clone()));
                self.begin(opened);
                self.take_over(slot);
            }
            Err(refusal) => {
                self.restore_state(before);
                self.keep_offer(&run, &refusal.text);
            }
        }
    }

    /// What was opened goes on saving where it came from: no frame of it is in a file of the user's.
    fn take_over(&mut self, slot: AutosaveSlot) {
        let Some(Content::Session(session)) = &self.content else { return };
        let method = &session.config().method;
        let is_given = !method.assumes_calibration(session.dataset());
        let calibration = method.any().calibration().filter(|_| is_given).cloned();
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
        let text = format!("{}: training cannot go on: {problem}", run.file.display());
        self.notify(NoticeKind::Error, text);
    }

    /// Removes the run that is offered.
    pub(super) fn give_up(&mut self) {
        let Some(run) = self.snapshot.abandoned.take() else { return };
        if let Ok(Some(slot)) = AutosaveSlot::take(&run.slot) {
            slot.discard();
        }
    }

    fn autosave_folder(&self) -> Option<PathBuf> {
        Some(self.rescue_folders.first()?.join(FOLDER))
    }
}
