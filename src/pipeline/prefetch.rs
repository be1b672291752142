//! Prefetch of frames: decoding and unprojection on other threads, delivered in order. With spare cores,
//! a bounded number of frames is prepared ahead. Otherwise several are prepared at once between two
//! training steps. A decoding thread that competes with training for the cores would double the training
//! time (`pipeline.md`, Prefetch).
//!
//! A drive that does not respond only blocks a prefetch thread; the consumer waits with a timeout.

use super::panic_report::PanicReport;
use super::plan::Plan;
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{Preparer, SurfaceSettings};
use crate::dataset::unproject::{UnprojectSettings, Unprojector};
use crate::dataset::{Dataset, FrameEntry, FrameMarks, PHOTOGRAPHS_AT_ONCE};
use crate::observation::points::Points;
use crate::observation::surface::Observation;
use crate::train::timing::Stopwatch;
use std::collections::VecDeque;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Maximum number of frames prepared at the same time.
// Every one of them is held in memory.
const MAX_AT_ONCE: usize = 4;
/// Number of cores per decoding thread, unless the number of training threads is set explicitly.
// On 16 cores, two decoding threads kept up with training and one did not (`lab/pipeline.md`, Prefetch).
const CORES_PER_DECODER: usize = 8;

/// Default number of threads for training and rendering: all cores except those for decoding threads.
pub fn default_threads() -> usize {
    let cores = cores();
    cores - (cores / CORES_PER_DECODER).min(MAX_AT_ONCE)
}

/// Number of frames in memory at once: in training, ready, or in preparation. Depends on the current
/// thread pool.
pub fn frames_at_once() -> usize {
    match decoder_count() {
        // A batch, and the frame in training.
        0 => rayon::current_num_threads().min(MAX_AT_ONCE) + 1,
        // One frame per decoder, one ready, and one in training.
        decoders => decoders + 2,
    }
}

/// Number of decoding threads: one for each core that the current thread pool leaves free, up to
/// `MAX_AT_ONCE`.
fn decoder_count() -> usize {
    cores().saturating_sub(rayon::current_num_threads()).min(MAX_AT_ONCE)
}

fn cores() -> usize {
    // The system may not report the number.
    thread::available_parallelism().map_or(1, usize::from)
}

/// Frame prepared for training.
pub struct Prepared<O> {
    /// Position in the plan.
    pub position: usize,
    /// True if the same frame also occurs earlier in the plan.
    pub is_repeat: bool,
    /// Name of the frame in its split.
    pub name: String,
    /// Modification times and sizes of the frame's files before they were read.
    // Taken by the decoding thread, so that the training thread never accesses the drive.
    pub marks: FrameMarks,
    /// Observation of the frame, or the reason to skip it.
    pub result: Result<PreparedFrame<O>, String>,
}

/// Observation of a frame, with statistics of its preparation.
pub struct PreparedFrame<O> {
    /// Observation for the learner.
    pub observation: O,
    /// Number of pixels with measured depth that gave no point.
    pub dropped: usize,
    /// Time for reading and decoding, in milliseconds.
    pub load_ms: f64,
    /// Time for filtering, unprojecting and normalising, in milliseconds.
    pub prepare_ms: f64,
}

/// Frame of a plan.
pub struct PlannedFrame {
    /// Position in the plan.
    pub position: usize,
    /// True if the same frame also occurs earlier in the plan.
    pub is_repeat: bool,
    /// Dataset entry of the frame.
    pub entry: FrameEntry,
}

impl PlannedFrame {
    /// Iterates over the frames of a plan, starting at position `first`.
    pub fn of(dataset: &Dataset, plan: &Plan, first: usize) -> impl Iterator<Item = Self> {
        let frames = &dataset.splits[plan.split].frames;
        let planned = plan.frames.iter().zip(plan.repeat_flags()).enumerate().skip(first);
        planned.map(|(position, (&i, is_repeat))| Self {
            position,
            is_repeat,
            entry: frames[i].clone(),
        })
    }
}

/// Queue of frames that are prepared on other threads. When dropped, its threads end after their current
/// frame.
pub struct Prefetch<P: Prepare> {
    upcoming: VecDeque<PlannedFrame>,
    /// True if frames are prepared during training, false if only while training waits.
    is_ahead: bool,
    /// Maximum number of frames requested at once.
    most: usize,
    asked: Sender<Task<P>>,
    /// Receivers of the requested frames, in order, and the sizes of their photographs in bytes.
    coming: VecDeque<(u64, Receiver<Prepared<P::Observation>>)>,
    /// Frames of a batch that were received and not yet returned.
    ready: VecDeque<Prepared<P::Observation>>,
    recycle: SyncSender<P::Observation>,
    watcher: Arc<OnceLock<FrameWatcher>>,
}

/// Function that receives each decoded frame with its position in the plan, before the frame is prepared. It
/// runs on a decoding thread, and not again for repeated frames.
pub type FrameWatcher = Arc<dyn Fn(usize, &Frame) + Send + Sync>;

/// State of the next frame.
pub enum Next<T> {
    /// The frame is available.
    Ready(T),
    /// The frame is not decoded yet.
    Unread,
    /// There are no more frames.
    End,
}

/// Preparation of frames for a learner. The preparing threads share one value, which holds the settings.
pub trait Prepare: Send + Sync + 'static {
    /// Input of a learner.
    type Observation: Send + 'static;
    /// Buffers that are reused between frames, one value per thread.
    type Memory: Default + Send + 'static;

    /// Returns an observation without points; its memory is later reused for frames.
    fn empty() -> Self::Observation;

    /// Replaces `observation` by that of `frame`. Returns the number of pixels with measured depth that
    /// gave no point.
    ///
    /// # Errors
    /// Reason to skip a frame that lacks required data, such as depth.
    fn prepare(
        &self,
        frame: &Frame,
        memory: &mut Self::Memory,
        observation: &mut Self::Observation,
    ) -> Result<usize, String>;
}

/// Prepares coloured points for the published algorithm.
impl Prepare for UnprojectSettings {
    type Observation = Points<f32>;
    type Memory = Unprojector;

    fn empty() -> Points<f32> {
        Points::new()
    }

    fn prepare(
        &self,
        frame: &Frame,
        unprojector: &mut Unprojector,
        points: &mut Points<f32>,
    ) -> Result<usize, String> {
        let counts = unprojector.unproject(frame, self, points).map_err(message)?;
        check_points(frame, points.len(), &counts)?;
        Ok(counts.dropped())
    }
}

/// Prepares surface points and measured distances for the scene preset.
impl Prepare for SurfaceSettings {
    type Observation = Observation;
    type Memory = Preparer;

    fn empty() -> Observation {
        Observation::empty()
    }

    fn prepare(
        &self,
        frame: &Frame,
        preparer: &mut Preparer,
        surfaces: &mut Observation,
    ) -> Result<usize, String> {
        let counts = preparer.prepare(frame, self, surfaces).map_err(message)?;
        check_points(frame, surfaces.points.len(), &counts)?;
        Ok(counts.dropped())
    }
}

fn message(error: FrameError) -> String {
    error.to_string()
}

fn check_points(frame: &Frame, n_points: usize, counts: &impl Display) -> Result<(), String> {
    if n_points > 0 {
        return Ok(());
    }
    Err(format!(
        "{}: expected pixels with usable depth, found none ({counts}); check the depth unit and range",
        frame.name
    ))
}

type Task<P> = (PlannedFrame, SyncSender<Prepared<<P as Prepare>::Observation>>);

struct Shared<P: Prepare> {
    preparation: P,
    tasks: Mutex<Receiver<Task<P>>>,
    recycled: Mutex<Receiver<P::Observation>>,
    watcher: Arc<OnceLock<FrameWatcher>>,
}

/// Error of starting a decoding thread.
#[derive(Debug, thiserror::Error)]
#[error("starting a decoding thread failed: {0}; close other programs and try again")]
pub struct SpawnError(#[from] std::io::Error);

impl<P: Prepare> Prefetch<P> {
    /// Starts to prepare the frames of a plan, in order, from position `first`. Prepares frames during
    /// training if the current thread pool leaves a core free, otherwise between frames.
    pub fn start(
        dataset: Arc<Dataset>,
        plan: &Plan,
        first: usize,
        preparation: P,
    ) -> Result<Self, SpawnError> {
        let upcoming = PlannedFrame::of(&dataset, plan, first).collect();
        match decoder_count() {
            0 => {
                let at_once = rayon::current_num_threads().clamp(1, MAX_AT_ONCE);
                Self::with_threads(upcoming, preparation, at_once, false)
            }
            n => Self::with_threads(upcoming, preparation, n, true),
        }
    }

    fn with_threads(
        upcoming: VecDeque<PlannedFrame>,
        preparation: P,
        n_threads: usize,
        is_ahead: bool,
    ) -> Result<Self, SpawnError> {
        let (asked, tasks) = channel();
        // As many buffers as frames are requested ahead; further ones are freed.
        let (recycle, recycled) = sync_channel(n_threads + 1);
        let (tasks, recycled) = (Mutex::new(tasks), Mutex::new(recycled));
        let watcher = Arc::new(OnceLock::new());
        let shared = Arc::new(Shared { preparation, tasks, recycled, watcher: watcher.clone() });
        for _ in 0..n_threads {
            let shared = shared.clone();
            thread::Builder::new().name("prefetch".into()).spawn(move || shared.run())?;
        }
        let (coming, ready) = (VecDeque::new(), VecDeque::new());
        // Ahead, one frame is ready besides those in preparation.
        let most = n_threads + usize::from(is_ahead);
        let mut prefetch =
            Self { upcoming, is_ahead, most, asked, coming, ready, recycle, watcher };
        prefetch.request_ahead();
        Ok(prefetch)
    }

    /// Appends frames to the end of the queue.
    pub fn append(&mut self, frames: impl Iterator<Item = PlannedFrame>) {
        self.upcoming.extend(frames);
        self.request_ahead();
    }

    /// Calls `watcher` with every frame that is decoded from now on. Only the first watcher counts.
    pub fn watch(&self, watcher: FrameWatcher) {
        // Fails if there is one already.
        let _ = self.watcher.set(watcher);
    }

    fn request_ahead(&mut self) {
        if self.is_ahead {
            self.request();
        }
    }

    fn request(&mut self) {
        while self.coming.len() < self.most
            && let Some(frame) = self.upcoming.pop_front()
        {
            let bytes = frame.entry.photograph_bytes();
            let others: u64 = self.coming.iter().map(|(bytes, _)| bytes).sum();
            // One large photograph at a time.
            if others > 0 && others.saturating_add(bytes) > PHOTOGRAPHS_AT_ONCE {
                self.upcoming.push_front(frame);
                break;
            }
            let (slot, prepared) = sync_channel(1);
            // Sending cannot fail: the threads outlive this handle.
            drop(self.asked.send((frame, slot)));
            self.coming.push_back((bytes, prepared));
        }
    }

    /// Waits for the next frame; `None` after the last one.
    pub fn next_frame(&mut self) -> Option<Prepared<P::Observation>> {
        match self.next_within(Duration::MAX) {
            Next::Ready(frame) => Some(frame),
            Next::Unread | Next::End => None,
        }
    }

    /// Returns the next frame, waiting at most `patience`.
    pub fn next_within(&mut self, patience: Duration) -> Next<Prepared<P::Observation>> {
        // Without spare cores a batch is requested at once, while the training threads are idle.
        if self.is_ahead || self.ready.is_empty() && self.coming.is_empty() {
            self.request();
        }
        let begun = Instant::now();
        while let Some((_, first)) = self.coming.front() {
            match first.recv_timeout(patience.saturating_sub(begun.elapsed())) {
                Ok(frame) => self.ready.push_back(frame),
                Err(RecvTimeoutError::Timeout) => break,
                // The thread ended without a result.
                Err(RecvTimeoutError::Disconnected) => {}
            }
            self.coming.pop_front();
            // Later frames are still in preparation, and waiting for them would delay training.
            if self.is_ahead {
                break;
            }
        }
        match self.ready.pop_front() {
            Some(frame) => Next::Ready(frame),
            None if self.coming.is_empty() => Next::End,
            None => Next::Unread,
        }
    }

    /// Takes back an observation to reuse its memory for later frames. After the last frame, frees the
    /// memory instead, so that saving can use it.
    pub fn recycle(&mut self, observation: P::Observation) {
        if self.upcoming.is_empty() && self.coming.is_empty() {
            return;
        }
        // If the queue is full, the memory is simply freed.
        drop(self.recycle.try_send(observation));
    }
}

impl<P: Prepare> Shared<P> {
    /// Prepares requested frames until the [`Prefetch`] is dropped.
    fn run(&self) {
        let mut memory = P::Memory::default();
        while let Some((frame, slot)) = receive_shared(&self.tasks, |tasks| tasks.recv().ok()) {
            // Without waiting: the first frames have no memory to reuse.
            let recycled = receive_shared(&self.recycled, |recycled| recycled.try_recv().ok());
            // Fails if the handle was dropped.
            drop(slot.send(self.prepare(frame, &mut memory, recycled)));
        }
    }

    /// Loads and prepares a frame. Reuses the memory of a `recycled` observation, if there is one.
    fn prepare(
        &self,
        PlannedFrame { position, is_repeat, entry }: PlannedFrame,
        memory: &mut P::Memory,
        recycled: Option<P::Observation>,
    ) -> Prepared<P::Observation> {
        let (name, marks) = (entry.name.clone(), entry.marks());
        // A panic only skips this frame. If the thread ended, the run would silently end after the frames
        // so far.
        let prepared = catch_unwind(AssertUnwindSafe(|| {
            let mut clock = Stopwatch::start();
            let frame = entry.load().map_err(message)?;
            let load_ms = clock.lap_ms();
            if let Some(watcher) = self.watcher.get().filter(|_| !is_repeat) {
                watcher(position, &frame);
            }
            let mut observation = recycled.unwrap_or_else(P::empty);
            let dropped = self.preparation.prepare(&frame, memory, &mut observation)?;
            Ok(PreparedFrame { observation, dropped, load_ms, prepare_ms: clock.lap_ms() })
        }));
        let result = prepared.unwrap_or_else(|panic| {
            // The buffers may be inconsistent.
            *memory = P::Memory::default();
            Err(format!(
                "{name}: skipped because of a defect of this program, please report it: {}",
                PanicReport::of(&*panic)
            ))
        });
        Prepared { position, is_repeat, name, marks, result }
    }
}

/// Receives a value with the function `next` from a channel that several threads share.
fn receive_shared<T>(
    channel: &Mutex<Receiver<T>>,
    next: impl FnOnce(&Receiver<T>) -> Option<T>,
) -> Option<T> {
    // A panic of another thread leaves the channel intact.
    next(&channel.lock().unwrap_or_else(PoisonError::into_inner))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{SyntheticParams, dataset};
    use crate::pipeline::plan::Selection;

    /// Preparation that takes longer for earlier frames, and panics for the frame named in `defect`.
    struct Slow {
        defect: Option<String>,
    }

    impl Prepare for Slow {
        type Observation = String;
        type Memory = usize;

        fn empty() -> String {
            String::new()
        }

        fn prepare(
            &self,
            frame: &Frame,
            calls: &mut usize,
            name: &mut String,
        ) -> Result<usize, String> {
            assert!(Some(&frame.name) != self.defect.as_ref(), "a defect of {}", frame.name);
            let number = frame.name.chars().filter_map(|c| c.to_digit(10)).next_back().unwrap();
            thread::sleep(Duration::from_millis(10 * u64::from(9 - number)));
            name.clone_from(&frame.name);
            *calls += 1;
            Ok(*calls)
        }
    }

    fn room() -> (Arc<Dataset>, Plan) {
        let small = SyntheticParams {
            width: 12,
            height: 9,
            n_train: 9,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        let room = Arc::new(dataset(&small).unwrap());
        let plan = Plan::new(&room, &Selection::all_frames(), 0).unwrap();
        (room, plan)
    }

    #[test]
    fn frames_come_in_their_order_however_many_threads_prepare_them() {
        let (room, plan) = room();
        for decoders in [1, 4] {
            let upcoming = PlannedFrame::of(&room, &plan, 0).collect();
            let slow = Slow { defect: None };
            let mut prefetch = Prefetch::with_threads(upcoming, slow, decoders, true).unwrap();
            let seen = Arc::new(Mutex::new(Vec::new()));
            let log = seen.clone();
            prefetch.watch(Arc::new(move |position, frame: &Frame| {
                log.lock().unwrap().push((position, frame.name.clone()));
            }));
            let mut calls = 0;
            for position in 0..plan.frames.len() {
                let prepared = prefetch.next_frame().unwrap();
                let frame = prepared.result.unwrap();
                assert_eq!((prepared.position, &prepared.name), (position, &frame.observation));
                calls = calls.max(frame.dropped);
                prefetch.recycle(frame.observation);
            }
            assert!(prefetch.next_frame().is_none());
            // Those decoded ahead before the watcher was set are missing.
            let seen = seen.lock().unwrap();
            assert!(seen.len() + decoders + 1 >= plan.frames.len(), "{seen:?}");
            let name = |i: usize| &room.splits[plan.split].frames[plan.frames[i]].name;
            assert!(seen.iter().all(|(position, found)| found == name(*position)), "{seen:?}");
            let by_one = calls == plan.frames.len();
            assert_eq!(by_one, decoders == 1, "{calls} frames by one of {decoders} threads");
        }
    }

    #[test]
    fn a_defect_costs_one_frame_and_not_those_behind_it() {
        let (room, plan) = room();
        let names = || plan.frames.iter().map(|&i| room.splits[plan.split].frames[i].name.clone());
        let defect: String = names().nth(2).unwrap();
        // In ahead mode, if a core is free, and between trainings.
        for n_threads in [1, 64] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let results = pool.install(|| {
                let slow = Slow { defect: Some(defect.clone()) };
                let mut prefetch = Prefetch::start(Arc::clone(&room), &plan, 0, slow).unwrap();
                std::iter::from_fn(|| prefetch.next_frame())
                    .map(|frame| (frame.name, frame.result.map(drop)))
                    .collect::<Vec<_>>()
            });
            assert!(results.iter().map(|(name, _)| name.clone()).eq(names()), "{results:?}");
            for (name, result) in results {
                let said = result.err().unwrap_or_default();
                let expected = format!("{defect}: skipped because of a defect of this program");
                assert_eq!(name == defect, said.starts_with(&expected), "{name}: {said}");
                assert_eq!(name == defect, said.contains("a defect of "), "{name}: {said}");
            }
        }
    }
}
