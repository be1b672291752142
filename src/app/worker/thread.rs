//! Training thread: its state, its loop, and the execution of orders.
//!
//! The loop survives panics: the open subject stays open and can be saved.

use super::autosave::Files;
use super::awaited::AwaitedRecording;
use super::shared::{Shared, Waker};
use crate::app::edit::marks::LeftOut;
use crate::app::opening::Content;
use crate::app::rescue::Rescue;
use crate::app::state::{
    GivenCalibration, Notice, NoticeKind, NoticeTopic, RunState, Snapshot, Subject,
};
use crate::app::training::TrainSettings;
use crate::dataset::pose_check::PoseCheck;
use crate::dataset::surface::sample::FrameSample;
use crate::export::mapping::Mapping;
use crate::pipeline::panic_report::PanicReport;
use crate::render::attributes::Attribute;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Result of sampling the frames of the opened dataset.
pub struct FrameSampling {
    /// Agreement of poses with depth.
    pub(super) poses: Option<PoseCheck>,
    /// Pixel width and depth noise.
    pub(super) sample: Option<FrameSample>,
}

pub struct WorkerThread {
    pub(super) inbox: Receiver<WorkerOrder>,
    pub(super) shared: Arc<Shared>,
    pub(super) waker: Waker,
    pub(super) published: Instant,
    pub(super) training: TrainSettings,
    /// Calibration of the open subject.
    pub(super) calibration: Option<Arc<GivenCalibration>>,
    pub(super) subject: Option<Subject>,
    pub(super) content: Option<Content>,
    pub(super) snapshot: Snapshot,
    /// End times of recent frames, for the frame rate.
    pub(super) ends: VecDeque<Instant>,
    pub(super) dirty: Dirty,
    /// Attribute by which the viewport colours components.
    pub(super) watched: Option<Attribute>,
    /// Component that snapshots inspect.
    pub(super) inspecting: Option<u32>,
    /// True if the snapshot differs from the published one.
    pub(super) changed: bool,
    pub(super) next_serial: u64,
    pub(super) files: Files,
    /// Thread that samples the frames of the open dataset, until it is done.
    pub(super) first_look: Option<JoinHandle<FrameSampling>>,
    /// Recording on which no session has started.
    pub(super) awaited: Option<AwaitedRecording>,
    /// Time at which the frames of a recording ran out; `None` once training is at rest.
    pub(super) waiting_since: Option<Instant>,
    /// True if a single step waits for a frame that has not been read.
    pub(super) has_pending_step: bool,
    /// Time of the last update of the cameras of a growing recording.
    pub(super) cameras_updated: Instant,
}

/// Interval at which autosaves are polled while no frames are trained.
const SAVES: Duration = Duration::from_secs(1);
/// Maximum number of stored notices.
const MAX_NOTICES: usize = 50;

/// Error if the handle was dropped.
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
            shared,
            waker,
            published: Instant::now(),
            training: TrainSettings::default(),
            calibration: None,
            subject: None,
            content: None,
            snapshot: Snapshot::default(),
            ends: VecDeque::new(),
            dirty: Dirty::default(),
            watched: None,
            inspecting: None,
            changed: true,
            next_serial: 1,
            files: Files::new(folders),
            first_look: None,
            awaited: None,
            waiting_since: None,
            has_pending_step: false,
            cameras_updated: Instant::now(),
        }
    }

    /// Executes orders and trains until the handle is dropped.
    pub fn run(mut self) {
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

    /// Returns the next order; blocks for it unless there is a frame to train.
    fn next_order(&self) -> Result<Option<WorkerOrder>, Dismissed> {
        let rest = self.time_to_next_poll();
        if self.has_pending_step || self.snapshot.state == RunState::Training && rest.is_none() {
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

    /// Time until something may be due without an order; `None` if nothing can be.
    fn idle_timeout(&self) -> Option<Duration> {
        // Retries the delivery of pending splats.
        if self.changed || !self.dirty.is_empty() || self.first_look.is_some() {
            return Some(self.shared.interval());
        }
        self.has_pending_autosave().then_some(SAVES)
    }

    /// Executes an order, or trains a frame if there is none, and publishes the result.
    fn run_turn(&mut self, order: Option<WorkerOrder>) {
        let acted = order.is_some();
        self.changed |= acted;
        match order {
            Some(order) => self.apply(order),
            None if self.has_pending_step => self.step_once(),
            None if self.snapshot.state == RunState::Training => drop(self.step()),
            None if self.snapshot.state == RunState::Waiting => self.poll_awaited_recording(),
            None => {}
        }
        if !(self.has_pending_step || self.snapshot.state == RunState::Training) {
            self.shared.unread.end();
        }
        self.autosave();
        self.take_frame_sampling();
        // The first frame is shown at once.
        let is_first = self.snapshot.frames_done == 1 && self.changed;
        self.publish(acted || is_first);
    }

    fn apply(&mut self, order: WorkerOrder) {
        match order {
            WorkerOrder::TrainBy(settings) => self.training = *settings,
            WorkerOrder::Open(subject) => self.open_with(None, subject),
            WorkerOrder::OpenFirst(paths) => self.open_first(&paths),
            WorkerOrder::Calibrate(path) => self.calibrate(&path),
            WorkerOrder::Train => self.set_state(RunState::Training),
            WorkerOrder::Pause => {
                self.set_state(RunState::Paused);
                self.mark_visibility();
            }
            // A click that arrives after the end of training must not restart it.
            WorkerOrder::Step if self.may_train() => {
                // Before the frame, which may finish or fail the run: that state must remain.
                self.set_state(RunState::Paused);
                self.step_once();
            }
            WorkerOrder::Step => {}
            WorkerOrder::Follow(follows) => self.set_follows(follows),
            WorkerOrder::Reset => self.reset(),
            WorkerOrder::Retrain(settings) => {
                self.training = *settings;
                self.reset();
                self.set_state(RunState::Training);
            }
            WorkerOrder::Save(number, path) => self.save(number, &path),
            WorkerOrder::Export(number, path, mapping, left_out) => {
                self.export(number, &path, mapping, &left_out);
            }
            WorkerOrder::WriteText(path, text) => self.write_text(&path, &text),
            WorkerOrder::Store(answer) => {
                let rescue = self.end_run();
                // Before the answer, because its receiver relies on the snapshot.
                self.publish(true);
                // Fails if the receiver no longer waits.
                let _ = answer.send(rescue);
            }
            WorkerOrder::ResumeAbandoned => self.resume_abandoned_run(),
            WorkerOrder::DiscardAbandoned => self.discard_abandoned_run(),
            // Notices of the window are stored here, so that they outlive it.
            WorkerOrder::Report(kind, message) => {
                self.notify_of(NoticeTopic::Window, kind, message);
            }
            WorkerOrder::ForgetReports => self.forget_notices(NoticeTopic::Window),
            WorkerOrder::Watch(attribute) => self.watch(attribute),
            WorkerOrder::Inspect(id) => self.inspecting = id,
            WorkerOrder::Deliver => self.deliver_all(),
        }
    }

    /// Trains one frame, once it has been read.
    fn step_once(&mut self) {
        self.has_pending_step = !self.step();
        if !self.has_pending_step {
            self.mark_visibility();
        }
    }

    /// Reopens the subject with its calibration and the current settings, which thus take effect.
    fn reset(&mut self) {
        if let Some(subject) = self.subject.clone() {
            self.open_with(self.calibration.clone(), subject);
        }
    }

    pub(super) fn set_state(&mut self, state: RunState) {
        self.has_pending_step = false;
        // An order that arrives after the end of training must not restart it.
        if self.may_train() {
            self.snapshot.state = state;
            self.reset_frame_rate();
        }
    }

    fn may_train(&self) -> bool {
        matches!(self.snapshot.state, RunState::Ready | RunState::Training | RunState::Paused)
    }

    /// Restarts the measurement of the frame rate.
    pub(super) fn reset_frame_rate(&mut self) {
        self.ends.clear();
        self.snapshot.frames_per_s = 0.0;
    }

    pub(super) fn fail(&mut self, message: String) {
        self.snapshot.state = RunState::Failed;
        self.reset_frame_rate();
        self.notify(NoticeKind::Error, message);
    }

    pub(super) fn notify(&mut self, kind: NoticeKind, text: String) {
        self.notify_of(NoticeTopic::Event, kind, text);
    }

    /// Removes the notices of a topic that no longer applies.
    pub(super) fn forget_notices(&mut self, topic: NoticeTopic) {
        let kept = self.snapshot.notices.iter().filter(|notice| notice.topic != topic);
        self.snapshot.notices = Arc::new(kept.cloned().collect());
    }

    pub(super) fn notify_of(&mut self, topic: NoticeTopic, kind: NoticeKind, text: String) {
        match kind {
            NoticeKind::Error => tracing::error!("{text}"),
            NoticeKind::Warning => tracing::warn!("{text}"),
            NoticeKind::Info => tracing::info!("{text}"),
        }
        // A new list, because published snapshots share the old one.
        let mut notices = self.snapshot.notices.to_vec();
        if notices.len() == MAX_NOTICES {
            notices.remove(0);
        }
        // Opened subjects use the same counter: both numbers only have to increase.
        notices.push(Notice { serial: self.next_serial, topic, kind, text });
        self.next_serial += 1;
        self.snapshot.notices = Arc::new(notices);
    }
}

/// Set of components that changed since the last update of the viewport.
#[derive(Default)]
pub struct Dirty {
    // The list, because most frames change few components; the flags, because a frame may list a
    // component that is already in the list.
    ids: Vec<u32>,
    is_dirty: Vec<bool>,
}

impl Dirty {
    /// True if the viewport has received every change.
    pub fn is_empty(&self) -> bool {
        self.ids.is_empty()
    }

    /// Adds components, which may be new.
    pub fn mark(&mut self, ids: &[u32]) {
        for &id in ids {
            let n = self.is_dirty.len().max(id as usize + 1);
            self.is_dirty.resize(n, false);
            if !std::mem::replace(&mut self.is_dirty[id as usize], true) {
                self.ids.push(id);
            }
        }
    }

    /// Adds all components.
    pub fn mark_all(&mut self, components: usize) {
        self.ids = (0..components as u32).collect();
        self.is_dirty = vec![true; components];
    }

    /// Returns each component once, and empties the set.
    pub fn take(&mut self) -> Vec<u32> {
        // One by one: clearing all flags would cost time in proportion to the scene at every update.
        for &id in &self.ids {
            self.is_dirty[id as usize] = false;
        }
        std::mem::take(&mut self.ids)
    }
}

/// Order to the training thread.
#[derive(Clone, Debug)]
pub enum WorkerOrder {
    /// Use these settings for what is opened or reset from now on.
    TrainBy(Box<TrainSettings>),
    /// Open a subject; the demo is also trained at once.
    Open(Subject),
    /// Open the first path that can be opened, and list the others in a notice.
    OpenFirst(Vec<PathBuf>),
    /// Restart with the open subject, its cameras corrected by a calibration file.
    Calibrate(PathBuf),
    /// Train until paused or done.
    Train,
    /// Stop after the current frame.
    Pause,
    /// Train one frame.
    Step,
    /// Follow recordings, the open one and those opened next; or stop following.
    Follow(bool),
    /// Restart with the same subject.
    Reset,
    /// Restart with the same subject and other settings, and train at once.
    Retrain(Box<TrainSettings>),
    /// Write a checkpoint of the newest state; the snapshot reports the outcome by this number.
    Save(u64, PathBuf),
    /// Export the newest scene, with the mapping from native to plain splats and the splats left out by
    /// edits; the snapshot reports the outcome by this number.
    Export(u64, PathBuf, Mapping, LeftOut),
    /// Write a text to a file, under an unused name if it exists.
    WriteText(PathBuf, String),
    /// Stop, and store training that no checkpoint holds for the next start, because the program ends
    /// unexpectedly.
    Store(SyncSender<Rescue>),
    /// Resume the run that the snapshot offers.
    ResumeAbandoned,
    /// Discard the offered run.
    DiscardAbandoned,
    /// Publish a notice of the window.
    Report(NoticeKind, String),
    /// Remove the notices of the window, because another adapter draws.
    ForgetReports,
    /// Deliver attributes of components with their splats from now on; `None` stops that.
    Watch(Option<Attribute>),
    /// Include the inspection of a component in snapshots; `None` stops that.
    Inspect(Option<u32>),
    /// Deliver all splats again, for a new window.
    Deliver,
}

#[cfg(test)]
mod dirty_tests {
    use super::*;

    #[test]
    fn components_are_told_once_and_may_be_new() {
        let mut dirty = Dirty::default();
        dirty.mark(&[2, 0, 2]);
        dirty.mark(&[7, 0]);
        assert_eq!(dirty.take(), [2, 0, 7]);
        assert!(dirty.is_empty());
        dirty.mark(&[1]);
        dirty.mark_all(3);
        dirty.mark(&[2, 3]);
        assert_eq!(dirty.take(), [0, 1, 2, 3]);
    }
}
