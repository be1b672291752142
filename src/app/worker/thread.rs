//! Training thread: its loop, and the execution of orders.
//!
//! The loop survives panics: the open dataset or model stays open and can be saved.

use super::Shared;
use super::autosave::Files;
use super::files::{Export, begin_write, write_text};
use super::following::Following;
use super::outbox::Outbox;
use super::run::Run;
use crate::app::opening::PathProblem;
use crate::app::rescue::{Crash, CrashedThread, Rescue};
use crate::app::state::{NoticeKind, NoticeTopic, RunState, Subject};
use crate::app::training::TrainSettings;
use crate::eval::report::QualityCurves;
use crate::export::registration::Registration;
use crate::pipeline::job::Waker;
use crate::pipeline::panic_report::PanicReport;
use crate::render::attributes::Attribute;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError};
use std::time::Duration;

pub struct WorkerThread {
    pub(super) inbox: Receiver<WorkerOrder>,
    pub(super) shared: Arc<Shared>,
    pub(super) training: TrainSettings,
    pub(super) run: Run,
    pub(super) files: Files,
    pub(super) following: Following,
    pub(super) outbox: Outbox,
    /// True if the user requested a single step whose frame has not been read yet.
    pub(super) has_pending_step: bool,
    /// Number of unreadable frames since the last trained one.
    pub(super) n_unread: usize,
}

/// Interval at which the worker checks whether an autosave is due while no frames are trained.
const SAVES: Duration = Duration::from_secs(1);

/// Error that ends the thread, because its handle was dropped.
struct Dismissed;

impl WorkerThread {
    pub fn new(
        inbox: Receiver<WorkerOrder>,
        shared: Arc<Shared>,
        waker: Waker,
        folders: Vec<PathBuf>,
    ) -> Self {
        Self {
            inbox,
            outbox: Outbox::new(shared.clone(), waker),
            shared,
            training: TrainSettings::default(),
            run: Run::default(),
            files: Files::new(folders),
            following: Following::default(),
            has_pending_step: false,
            n_unread: 0,
        }
    }

    /// Executes orders and trains until the handle is dropped.
    pub fn run(mut self) {
        // Of any dataset, because none is open yet.
        self.offer_abandoned_run(None);
        while let Ok(order) = self.next_order() {
            // Catches panics of each turn, not of the loop, so that a panic costs one order or one
            // frame.
            let work = catch_unwind(AssertUnwindSafe(|| self.run_turn(order)));
            let Err(payload) = work else { continue };
            let panic = PanicReport::of(&*payload);
            // A second panic during the handling would only recur.
            if catch_unwind(AssertUnwindSafe(|| self.handle_panic(panic))).is_err() {
                return;
            }
        }
        // The user was prompted about unsaved training before.
        self.files.discard();
    }

    /// Returns the next order. Does not block while a frame can be trained. `None` if no order has
    /// arrived but there is other work.
    fn next_order(&self) -> Result<Option<WorkerOrder>, Dismissed> {
        let state = self.outbox.snapshot.state;
        let rest = self.following.time_to_next_poll(state, &self.run);
        if self.has_pending_step || state == RunState::Training && rest.is_none() {
            return match self.inbox.try_recv() {
                Ok(order) => Ok(Some(order)),
                Err(TryRecvError::Empty) => Ok(None),
                Err(TryRecvError::Disconnected) => Err(Dismissed),
            };
        }
        let Some(rest) = rest.or(self.idle_timeout()) else {
            // Nothing can be due without an order: an idle window takes no CPU time.
            return self.inbox.recv().map(Some).map_err(|_| Dismissed);
        };
        match self.inbox.recv_timeout(rest) {
            Ok(order) => Ok(Some(order)),
            Err(RecvTimeoutError::Timeout) => Ok(None),
            Err(RecvTimeoutError::Disconnected) => Err(Dismissed),
        }
    }

    /// Returns the time until the worker has work that needs no order; `None` if there is no such work.
    fn idle_timeout(&self) -> Option<Duration> {
        // Retries the delivery of pending splats.
        if self.outbox.has_news() || self.run.awaits_sampling() {
            return Some(self.shared.interval());
        }
        let saves = self.training.autosave_s.is_some();
        let is_pending =
            saves && self.run.session().is_some_and(|session| self.files.is_pending(session));
        is_pending.then_some(SAVES)
    }

    /// Executes an order, or trains a frame if there is none, and publishes the result.
    fn run_turn(&mut self, order: Option<WorkerOrder>) {
        // Curves come from the window, which therefore need not be drawn again.
        let acted =
            order.as_ref().is_some_and(|order| !matches!(order, WorkerOrder::RecordCurves(..)));
        match order {
            Some(order) => {
                self.outbox.is_changed = true;
                self.apply(order);
            }
            None if self.has_pending_step => self.step_once(),
            // A frame that was not read yet is tried again in the next turn.
            None if self.outbox.snapshot.state == RunState::Training => drop(self.step()),
            None if self.outbox.snapshot.state == RunState::Waiting => {
                self.poll_awaited_recording();
            }
            None => {}
        }
        // Nothing waits for a frame unless something is trained.
        if !(self.has_pending_step || self.outbox.snapshot.state == RunState::Training) {
            self.outbox.set_unread(false);
        }
        self.autosave();
        self.take_sampling();
        // The first frame is shown at once.
        let is_first = self.outbox.snapshot.frames_done == 1 && self.outbox.is_changed;
        self.outbox.publish(&self.run, acted || is_first);
        // Last: the first frame is shown before its cores are shared.
        self.run.start_due_sampling(self.outbox.snapshot.frames_done > 0);
    }

    fn apply(&mut self, order: WorkerOrder) {
        match order {
            WorkerOrder::TrainBy(settings) => self.training = *settings,
            WorkerOrder::Open(subject) => self.open_with(None, subject),
            WorkerOrder::Calibrate(path) => self.calibrate(&path),
            WorkerOrder::Train => self.set_state(RunState::Training),
            WorkerOrder::Pause => {
                self.set_state(RunState::Paused);
                // Deferred during training, which these deliveries would slow down.
                self.outbox.mark_visibility(&self.run);
            }
            // A click that arrives after the end of training must not restart it.
            WorkerOrder::Step if self.may_train() => {
                // Set before the frame, which may finish or fail the run: that state must remain.
                self.set_state(RunState::Paused);
                self.step_once();
            }
            WorkerOrder::Step => {}
            WorkerOrder::Follow(follows) => self.set_follows(follows),
            WorkerOrder::Reset => self.reset(),
            WorkerOrder::Retrain => {
                self.reset();
                self.set_state(RunState::Training);
            }
            WorkerOrder::Save(number, path) => {
                begin_write(&mut self.outbox, number);
                self.files.save(number, &path, &self.run, &mut self.outbox);
            }
            WorkerOrder::Export(export) => {
                begin_write(&mut self.outbox, export.number);
                // Files include photographs that are still pending.
                self.settle();
                export.write(&self.run, &mut self.outbox, &self.shared.file);
            }
            WorkerOrder::Register(registration) => {
                self.run.register(registration);
                // A checkpoint holds it, so closing the window must ask.
                if self.outbox.snapshot.frames_done > 0 {
                    let warning = self.files.record_registration(self.run.session());
                    self.outbox.snapshot.files.is_registration_unsaved = true;
                    warning.into_iter().for_each(|w| self.outbox.notify(NoticeKind::Warning, w));
                }
            }
            WorkerOrder::RecordCurves(serial, curves) => self.record_curves(serial, curves),
            WorkerOrder::WriteText(path, text) => write_text(&path, &text, &mut self.outbox),
            WorkerOrder::Store(answer) => {
                let rescue = self.end_run();
                // Published before the answer, because its receiver relies on the snapshot.
                self.outbox.publish(&self.run, true);
                // Fails if the receiver no longer waits.
                let _ = answer.send(rescue);
            }
            WorkerOrder::ResumeAbandoned => self.resume_abandoned_run(),
            WorkerOrder::DiscardAbandoned => self.discard_abandoned_run(),
            // Notices of the window are stored here, so that they outlive it.
            WorkerOrder::Report(kind, message) => {
                self.outbox.notify_of(NoticeTopic::Window, kind, message);
            }
            WorkerOrder::Refuse(path, problem) => {
                self.refuse(Some(path.as_path()), NoticeKind::Error, problem);
            }
            WorkerOrder::ForgetReports => self.outbox.forget_notices(NoticeTopic::Window),
            WorkerOrder::Watch(attribute) => self.watch(attribute),
            WorkerOrder::Inspect(id) => self.run.inspecting = id,
            WorkerOrder::Deliver => self.outbox.deliver_all(&self.run),
        }
    }

    pub(super) fn set_state(&mut self, state: RunState) {
        self.has_pending_step = false;
        // An order that arrives after the end of training must not restart it.
        if self.may_train() {
            self.outbox.set_state(state);
            self.outbox.reset_frame_rate();
        }
    }

    fn may_train(&self) -> bool {
        let state = self.outbox.snapshot.state;
        matches!(state, RunState::Ready | RunState::Training | RunState::Paused)
    }

    /// Records curves for checkpoints, unless another dataset or model was opened meanwhile.
    fn record_curves(&mut self, serial: u64, curves: QualityCurves) {
        let is_open = self.outbox.snapshot.opened.as_ref().is_some_and(|o| o.serial == serial);
        if let Some(session) = self.run.session_mut().filter(|_| is_open) {
            session.set_curves(curves.clone());
            self.outbox.snapshot.curves = Arc::new(curves);
        }
    }

    pub(super) fn fail(&mut self, message: String) {
        self.outbox.set_state(RunState::Failed);
        self.outbox.reset_frame_rate();
        self.outbox.notify(NoticeKind::Error, message);
    }

    pub(super) fn watch(&mut self, attribute: Option<Attribute>) {
        self.run.watch(attribute);
        // Everything again: attributes of unchanged components have not been sent.
        if attribute.is_some() {
            self.outbox.mark_all(&self.run);
        }
    }

    /// Starts an autosave if one is due, and reports a failed one. Called between two turns of the
    /// worker.
    fn autosave(&mut self) {
        let (Some(seconds), Some(session)) = (self.training.autosave_s, self.run.session()) else {
            return;
        };
        if let Some(warning) = self.files.poll(session, Duration::from_secs(seconds.into())) {
            self.outbox.notify(NoticeKind::Warning, warning);
        }
    }

    /// Stores the run after a panic of this thread, and reports the crash to the window, which stays
    /// open.
    fn handle_panic(&mut self, panic: PanicReport) {
        // The panic may have occurred while a file was written.
        self.shared.file.end();
        let rescue = self.files.store(self.run.session());
        let crash = Crash { thread: CrashedThread::Training, panic, rescue };
        // Recorded first, so that the program reports the crash at its end even if the next steps fail.
        self.shared.crash.set(Some(crash.clone()));
        self.fail(crash.to_string());
        self.outbox.publish(&self.run, true);
    }

    /// Stops training because the program ends, and stores the run. Windows then close.
    fn end_run(&mut self) -> Rescue {
        self.set_state(RunState::Paused);
        let rescue = self.files.store(self.run.session());
        match &rescue {
            Rescue::Nothing => {}
            Rescue::Stored { .. } => self.outbox.notify(NoticeKind::Info, rescue.to_string()),
            Rescue::Lost { .. } => self.outbox.notify(NoticeKind::Error, rescue.to_string()),
        }
        self.outbox.snapshot.is_terminated = true;
        rescue
    }
}

#[derive(Clone, Debug)]
pub enum WorkerOrder {
    /// Sets the training settings for datasets that are opened or reset later.
    TrainBy(Box<TrainSettings>),
    /// Opens a dataset or model. The demo is also trained at once.
    Open(Subject),
    /// Reopens the dataset with cameras corrected by a calibration file.
    Calibrate(PathBuf),
    Train,
    /// Stops training after the current frame.
    Pause,
    Step,
    /// Sets whether recordings are followed, that is, trained on while they are being written. Applies to
    /// the open recording and those opened later.
    Follow(bool),
    Reset,
    /// Reopens the dataset with the current settings and trains at once.
    Retrain,
    /// Writes a checkpoint of the newest state. The snapshot reports the outcome with the given number.
    Save(u64, PathBuf),
    /// Exports the newest scene. The snapshot reports the outcome with the number of the export.
    Export(Export),
    /// Sets or removes the registration of the world, which exports apply.
    Register(Option<Registration>),
    /// Records the quality measured in the run of the dataset with this serial number.
    RecordCurves(u64, QualityCurves),
    /// Writes a text to a file; under an unused name if the path exists.
    WriteText(PathBuf, String),
    /// Stops training and stores frames that no checkpoint contains, because the program ends
    /// unexpectedly. Returns the outcome through the channel.
    Store(SyncSender<Rescue>),
    /// Resumes the abandoned run that the snapshot offers.
    ResumeAbandoned,
    DiscardAbandoned,
    /// Publishes a notice about the window.
    Report(NoticeKind, String),
    /// Publishes a notice about a path that cannot be opened.
    Refuse(PathBuf, PathProblem),
    /// Removes the notices about the window, because another adapter draws it.
    ForgetReports,
    /// Sets the attribute that is delivered with changed splats; `None` delivers no attributes.
    Watch(Option<Attribute>),
    /// Sets the component whose inspection snapshots include; `None` includes none.
    Inspect(Option<u32>),
    /// Delivers all splats again, because a new window has opened.
    Deliver,
}
