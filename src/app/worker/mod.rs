//! The thread that owns the trainer. It takes orders between frames, publishes snapshots and
//! changed splats, and never waits for the window.

mod calibrate;
mod dirty;
mod files;

use crate::app::feed::{Delivery, SplatChange, SplatFeed};
use crate::app::opening::{self, Content};
use crate::app::state::{
    HISTORY, Inspected, Notice, NoticeKind, RunState, Snapshot, Source, Subject,
};
use crate::app::training::TrainSettings;
use crate::app::wording;
use crate::dataset::calibration::Calibration;
use crate::eval::report::{FrameReport, Summary};
use crate::export::mapping::Mapping;
use crate::model::appearance::SplatSet;
use crate::model::attributes::Attributes;
use crate::pipeline::session::{SessionError, Step};
use crate::render::attributes::Attribute;
use crate::train::config::Preset;
use dirty::Dirty;
use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// An order to the trainer.
#[derive(Clone, Debug)]
pub enum Order {
    /// Train so what is opened or reset from now on.
    TrainBy(Box<TrainSettings>),
    /// Open something and, for the demo, train it at once.
    Open(Subject),
    /// Start over with what is open, its cameras corrected by a file.
    Calibrate(PathBuf),
    /// Train until paused or done.
    Train,
    /// Stop after the current frame.
    Pause,
    /// Train one frame.
    Step,
    /// Start over with the same subject.
    Reset,
    /// Write a checkpoint of the newest state.
    Save(PathBuf),
    /// Write the newest scene to a file; how it becomes plain splats, where it is more.
    Export(PathBuf, Mapping),
    /// Show something that happened elsewhere in the window.
    Report(NoticeKind, String),
    /// Deliver what is known of components with their splats, from now on; `None` ends that.
    Watch(Option<Attribute>),
    /// Keep what is known of a component in the snapshots; `None` ends that.
    Inspect(Option<u32>),
    /// Deliver all splats again, to a window that has none yet.
    Deliver,
}

/// What the worker and the window share.
#[derive(Default)]
struct Shared {
    snapshot: Mutex<Arc<Snapshot>>,
    feed: SplatFeed,
    /// Least time between two snapshots, microseconds.
    interval_us: AtomicU64,
}

impl Shared {
    fn interval(&self) -> Duration {
        Duration::from_micros(self.interval_us.load(Ordering::Relaxed))
    }
}

/// Handle of the trainer's thread; dropping it stops the thread after the current frame.
pub struct Worker {
    orders: Option<Sender<Order>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

/// Wakes the window after something was published.
pub type Waker = Arc<dyn Fn() + Send + Sync>;

impl Worker {
    /// Starts the thread. See [`Self::set_interval`].
    pub fn start(waker: Waker) -> std::io::Result<Self> {
        let (orders, inbox) = channel();
        let shared = Arc::new(Shared::default());
        let state = Trainer::new(inbox, shared.clone(), waker);
        let thread =
            std::thread::Builder::new().name("trainer".into()).spawn(move || state.run())?;
        let worker = Self { orders: Some(orders), shared, thread: Some(thread) };
        worker.set_interval(INTERVAL);
        Ok(worker)
    }

    /// Changes the least time between two snapshots, with the splats that changed meanwhile; 33 ms
    /// at first.
    pub fn set_interval(&self, interval: Duration) {
        self.shared.interval_us.store(interval.as_micros() as u64, Ordering::Relaxed);
    }

    /// Hands an order over; returns at once.
    pub fn send(&self, order: Order) {
        if let Some(orders) = &self.orders {
            // The thread ends only when this handle is dropped.
            let _ = orders.send(order);
        }
    }

    /// The newest snapshot.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Changed splats on their way to the viewport.
    pub fn feed(&self) -> &SplatFeed {
        &self.shared.feed
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        self.orders = None;
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was reported when it happened.
            let _ = thread.join();
        }
    }
}

/// The thread's own state.
struct Trainer {
    inbox: Receiver<Order>,
    shared: Arc<Shared>,
    waker: Waker,
    published: Instant,
    training: TrainSettings,
    /// Of what is open.
    calibration: Option<Calibration>,
    subject: Option<Subject>,
    content: Option<Content>,
    snapshot: Snapshot,
    recent: VecDeque<FrameReport>,
    /// When recent frames ended, for the frame rate.
    ends: VecDeque<Instant>,
    dirty: Dirty,
    /// What the viewport colours components by.
    watched: Option<Attribute>,
    /// The component whose posterior snapshots show.
    inspecting: Option<u32>,
    /// Whether the snapshot differs from the published one.
    changed: bool,
    next_serial: u64,
}

/// Least time between two snapshots where a GPU draws them.
const INTERVAL: Duration = Duration::from_millis(33);
/// Frames over which the frame rate is taken.
const RATE_FRAMES: usize = 30;
/// Most notices kept.
const MAX_NOTICES: usize = 50;

impl Trainer {
    fn new(inbox: Receiver<Order>, shared: Arc<Shared>, waker: Waker) -> Self {
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
            recent: VecDeque::new(),
            ends: VecDeque::new(),
            dirty: Dirty::default(),
            watched: None,
            inspecting: None,
            changed: true,
            next_serial: 1,
        }
    }

    fn run(mut self) {
        loop {
            let order = if self.snapshot.state == RunState::Training {
                match self.inbox.try_recv() {
                    Ok(order) => Some(order),
                    Err(std::sync::mpsc::TryRecvError::Empty) => None,
                    Err(std::sync::mpsc::TryRecvError::Disconnected) => return,
                }
            } else {
                // Splats that could not be delivered yet are tried again while idle.
                match self.inbox.recv_timeout(self.shared.interval()) {
                    Ok(order) => Some(order),
                    Err(RecvTimeoutError::Timeout) => None,
                    Err(RecvTimeoutError::Disconnected) => return,
                }
            };
            let acted = order.is_some();
            self.changed |= acted || self.snapshot.state == RunState::Training;
            let work = catch_unwind(AssertUnwindSafe(|| match order {
                Some(order) => self.obey(order),
                None if self.snapshot.state == RunState::Training => self.step(),
                None => {}
            }));
            if let Err(panic) = work {
                self.fail(format!(
                    "the trainer crashed: {}; the scene up to here can be exported",
                    text_of(&*panic)
                ));
            }
            // The first frame is shown as soon as it is there.
            let is_first = self.snapshot.frames_done == 1 && self.changed;
            self.publish(acted || is_first);
        }
    }

    fn obey(&mut self, order: Order) {
        match order {
            Order::TrainBy(settings) => self.training = *settings,
            Order::Open(subject) => self.open_with(None, subject),
            Order::Calibrate(path) => self.calibrate(&path),
            Order::Train => self.set_state(RunState::Training),
            Order::Pause => {
                self.set_state(RunState::Paused);
                self.tell_looks();
            }
            Order::Step => {
                self.set_state(RunState::Paused);
                self.step();
                self.tell_looks();
            }
            Order::Reset => {
                if let Some(subject) = self.subject.clone() {
                    self.open_with(self.calibration.clone(), subject);
                }
            }
            Order::Save(path) => self.save(&path),
            Order::Export(path, mapping) => self.export(&path, mapping),
            Order::Report(kind, message) => self.notify(kind, message),
            Order::Watch(attribute) => self.watch(attribute),
            Order::Inspect(id) => self.inspecting = id,
            Order::Deliver => self.deliver_all(),
        }
    }

    fn set_state(&mut self, state: RunState) {
        // An order that crossed with the end of training must not revive it.
        if matches!(self.snapshot.state, RunState::Ready | RunState::Training | RunState::Paused) {
            self.snapshot.state = state;
            self.ends.clear();
        }
    }

    fn open_with(&mut self, calibration: Option<Calibration>, subject: Subject) {
        let mut training = self.training.clone();
        training.scene.calibration = calibration.clone();
        let before = self.snapshot.state;
        self.snapshot.state = RunState::Loading;
        self.publish(true);
        match opening::open(&subject, &training, self.next_serial) {
            Ok(opened) => {
                self.next_serial += 1;
                (self.subject, self.calibration) = (Some(subject), calibration);
                self.begin(opened);
            }
            Err(error) => {
                // What was open stays open.
                self.snapshot.state = match before {
                    RunState::Training => RunState::Paused,
                    RunState::Loading => RunState::Empty,
                    other => other,
                };
                self.notify(NoticeKind::Error, error.to_string());
            }
        }
    }

    fn begin(&mut self, opened: opening::Result) {
        self.recent.clear();
        self.ends.clear();
        self.dirty = Dirty::default();
        let notices = self.snapshot.notices.clone();
        self.snapshot =
            Snapshot { opened: Some(Arc::new(opened.facts)), notices, ..Snapshot::default() };
        self.inspecting = None;
        self.shared.feed.push(SplatChange::All(opened.splats).into());
        match &opened.content {
            Content::Session(session) => {
                self.snapshot.source = Source::Dataset;
                self.snapshot.n_frames = session.plan().frames.len();
                self.snapshot.frames_done = session.learner().frames() as usize;
                self.snapshot.state = match session.visited() {
                    0 if self.subject == Some(Subject::Demo) => RunState::Training,
                    0 => RunState::Ready,
                    n if n < self.snapshot.n_frames => RunState::Paused,
                    _ => RunState::Finished,
                };
                let recent = session.frames().len().saturating_sub(HISTORY);
                self.recent.extend(session.frames()[recent..].iter().cloned());
            }
            Content::Model(splats) => {
                self.snapshot.source = Source::Model;
                self.snapshot.state = RunState::Finished;
                self.snapshot.components = splats.len();
                self.snapshot.used = splats.len();
            }
        }
        self.content = Some(opened.content);
        self.watch(self.watched);
        for (kind, text) in opened.notices {
            self.notify(kind, text);
        }
        self.refresh_session_facts();
    }

    fn step(&mut self) {
        let Some(Content::Session(session)) = &mut self.content else { return };
        // What the frame before told of them is over, whether or not the next one touches them.
        self.dirty.mark(session.learner().components_with_elbo());
        match session.step() {
            Ok(Step::Trained(frame)) => {
                self.dirty.mark(session.learner().touched());
                self.learned(frame);
            }
            Ok(Step::Skipped(skipped)) => {
                tracing::warn!("{}", skipped.message);
                self.refresh_session_facts();
            }
            Ok(Step::Finished) => self.finish(),
            Err(error @ SessionError::NoUsableFrame { .. }) => self.fail(error.to_string()),
            Err(error) => self.fail(format!("{error}; the scene up to here can be exported")),
        }
    }

    fn learned(&mut self, frame: FrameReport) {
        if self.recent.len() == HISTORY {
            self.recent.pop_front();
        }
        self.recent.push_back(frame);
        self.snapshot.frames_done += 1;
        self.snapshot.unsaved_frames += 1;
        if self.ends.len() == RATE_FRAMES {
            self.ends.pop_front();
        }
        self.ends.push_back(Instant::now());
        if let (Some(first), Some(last)) = (self.ends.front(), self.ends.back()) {
            let span_s = (*last - *first).as_secs_f64();
            self.snapshot.frames_per_s =
                if span_s > 0.0 { (self.ends.len() - 1) as f64 / span_s } else { 0.0 };
        }
        self.refresh_session_facts();
    }

    fn finish(&mut self) {
        self.snapshot.state = RunState::Finished;
        self.snapshot.frames_per_s = 0.0;
        self.tell_looks();
        if let Some(Content::Session(session)) = &self.content {
            let summary = Summary::of_frames(session.frames(), 0.0);
            tracing::info!("finished: train_ms_median {:.3}", summary.train_ms_median);
            for warning in session.learner().warnings() {
                self.notify(NoticeKind::Warning, wording::warning(&warning));
            }
        }
    }

    /// Components that a frame looked through differ without having received a point. The viewport
    /// is told of them when training rests: all of them after every frame would take its time.
    fn tell_looks(&mut self) {
        if let Some(Content::Session(session)) = &self.content
            && session.config().method.preset() == Preset::Scene
        {
            self.dirty.mark_all(session.learner().components());
        }
    }

    fn refresh_session_facts(&mut self) {
        let Some(Content::Session(session)) = &self.content else { return };
        self.snapshot.components = session.learner().components();
        self.snapshot.used = session.learner().used();
        self.snapshot.model_bytes = session.learner().model_bytes();
        if self.snapshot.skipped.len() != session.skipped().len() {
            self.snapshot.skipped = Arc::new(session.skipped().to_vec());
        }
    }

    /// The newest state of the scene, whatever the viewport shows.
    fn splats(&self) -> SplatSet {
        match &self.content {
            Some(Content::Session(session)) => session.splats(),
            Some(Content::Model(splats)) => splats.clone(),
            None => SplatSet::default(),
        }
    }

    fn fail(&mut self, message: String) {
        self.snapshot.state = RunState::Failed;
        self.notify(NoticeKind::Error, message);
    }

    fn notify(&mut self, kind: NoticeKind, text: String) {
        match kind {
            NoticeKind::Error => tracing::error!("{text}"),
            NoticeKind::Warning => tracing::warn!("{text}"),
            NoticeKind::Info => tracing::info!("{text}"),
        }
        let mut notices = self.snapshot.notices.to_vec();
        if notices.len() == MAX_NOTICES {
            notices.remove(0);
        }
        notices.push(Notice { serial: self.next_serial, kind, text });
        self.next_serial += 1;
        self.snapshot.notices = Arc::new(notices);
    }

    /// Tells the window, at most once per interval unless `at_once`. Changed splats are converted
    /// only when the viewport took the last ones.
    fn publish(&mut self, at_once: bool) {
        let due = self.published.elapsed() >= self.shared.interval();
        let news = self.changed || !self.dirty.is_empty();
        if !(at_once || due && news) {
            return;
        }
        self.deliver_splats();
        self.snapshot.inspected = self.inspect();
        self.snapshot.recent = Arc::new(self.recent.iter().cloned().collect());
        let snapshot = Arc::new(self.snapshot.clone());
        *self.shared.snapshot.lock().unwrap_or_else(PoisonError::into_inner) = snapshot;
        self.published = Instant::now();
        self.changed = false;
        (self.waker)();
    }

    fn deliver_splats(&mut self) {
        let Some(Content::Session(session)) = &self.content else { return };
        if !self.dirty.is_empty() && self.shared.feed.is_empty() {
            let ids = self.dirty.take();
            let splats = session.splats_of(&ids);
            let attributes = self.attributes_of(&ids);
            let change = SplatChange::Some { ids, splats };
            self.shared.feed.push(Delivery { change, attributes });
        }
    }

    fn deliver_all(&mut self) {
        self.dirty.take();
        let splats = self.splats();
        let ids: Vec<u32> = (0..splats.len() as u32).collect();
        let attributes = self.attributes_of(&ids);
        self.shared.feed.push(Delivery { change: SplatChange::All(splats), attributes });
    }

    /// What is known of components, if the viewport asks for it.
    fn attributes_of(&self, ids: &[u32]) -> Vec<Attributes> {
        match &self.content {
            Some(Content::Session(session)) if self.watched.is_some() => session.attributes_of(ids),
            _ => Vec::new(),
        }
    }

    /// Everything is delivered again: what is known of components at rest has not been told.
    fn watch(&mut self, attribute: Option<Attribute>) {
        self.watched = attribute;
        let Some(Content::Session(session)) = &mut self.content else { return };
        match attribute {
            Some(Attribute::Elbo) => session.start_component_elbo(),
            _ => session.stop_component_elbo(),
        }
        if attribute.is_some() {
            self.dirty.mark_all(session.learner().components());
        }
    }

    fn inspect(&self) -> Option<Arc<Inspected>> {
        let id = self.inspecting?;
        let inspected = match self.content.as_ref()? {
            Content::Session(session) => Inspected::Component(Box::new(session.inspect(id)?)),
            Content::Model(splats) => Inspected::Splat {
                id,
                splat: *splats.get(id as usize)?,
                appearance: splats.appearance_of(id as usize),
            },
        };
        Some(Arc::new(inspected))
    }
}

fn text_of(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<&str>().copied();
    text.or_else(|| panic.downcast_ref::<String>().map(String::as_str)).unwrap_or("unknown reason")
}
