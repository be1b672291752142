//! Decoding and unprojection of the frames to come, on threads of their own and in order: boundedly far
//! ahead where cores are left for them, else some frames at once between trainings. On a machine whose
//! cores all train, a decoding thread doubles the time of the trainings it runs beside (`pipeline.md`,
//! Prefetch).
//!
//! A drive that does not answer holds up the thread that asks it and nobody else: who wants the next frame
//! waits for it only as long as they say.

use super::panic_text::{NO_WORDS, panic_text};
use super::plan::Plan;
use super::prepare::Prepare;
use crate::dataset::error::FrameError;
use crate::dataset::{Dataset, FrameEntry, FrameMarks};
use crate::train::timing::Stopwatch;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Frames prepared at once, at most: ahead of training or between two trainings.
const MAX_AT_ONCE: usize = 4;
/// Of so many cores one decodes, where nobody says how many threads train.
const CORES_PER_DECODER: usize = 8;

/// Threads that train and render where nobody says how many: one per core, less those that decode beside
/// them on machines of many.
pub fn default_threads() -> usize {
    let cores = cores();
    cores - (cores / CORES_PER_DECODER).min(MAX_AT_ONCE)
}

/// Frames in memory at once in a run on the current threads: trained on, ready, in the making.
pub fn frames_at_once() -> usize {
    match decoders() {
        0 => rayon::current_num_threads().min(MAX_AT_ONCE) + 1,
        decoders => decoders + 2,
    }
}

/// Threads of their own that decode: one for each core that the current thread pool leaves free.
fn decoders() -> usize {
    cores().saturating_sub(rayon::current_num_threads()).min(MAX_AT_ONCE)
}

fn cores() -> usize {
    thread::available_parallelism().map_or(1, usize::from)
}

/// A frame ready to be trained on.
pub struct Prepared<O> {
    /// Position in the plan.
    pub position: usize,
    /// Whether it was there before in the plan.
    pub is_repeat: bool,
    /// Name within the split.
    pub name: String,
    /// What its files looked like before they were read: whoever trains asks no drive.
    pub marks: FrameMarks,
    /// What it holds, or why it is skipped.
    pub result: Result<PreparedFrame<O>, String>,
}

/// What a frame holds for a learner, and what it took to get it.
pub struct PreparedFrame<O> {
    /// What the learner learns from.
    pub observation: O,
    /// Measured pixels that made no point.
    pub dropped: usize,
    /// Reading and decoding, milliseconds.
    pub load_ms: f64,
    /// Filtering, unprojecting and normalising, milliseconds.
    pub prepare_ms: f64,
}

/// A frame of a run.
pub struct PlannedFrame {
    /// Position in the plan.
    pub position: usize,
    /// Whether it was there before in the plan.
    pub is_repeat: bool,
    /// The frame.
    pub entry: FrameEntry,
}

impl PlannedFrame {
    /// The frames of a plan from position `first` on.
    pub fn of(dataset: &Dataset, plan: &Plan, first: usize) -> impl Iterator<Item = Self> {
        let frames = &dataset.splits[plan.split].frames;
        let planned = plan.frames.iter().zip(plan.repeats()).enumerate().skip(first);
        planned.map(|(position, (&i, is_repeat))| Self {
            position,
            is_repeat,
            entry: frames[i].clone(),
        })
    }
}

/// The frames to come. Dropping it ends its threads, as soon as these are through with their frames.
pub struct Prefetch<P: Prepare> {
    upcoming: VecDeque<PlannedFrame>,
    pace: Pace,
    asked: Sender<Task<P>>,
    /// Where the frames asked for will be, in their order.
    coming: VecDeque<Receiver<Prepared<P::Observation>>>,
    /// Frames that came while the trainer waited for all of them.
    ready: VecDeque<Prepared<P::Observation>>,
    recycle: SyncSender<P::Observation>,
}

/// When frames are prepared.
enum Pace {
    /// All the time, so many ahead.
    Ahead(usize),
    /// While the trainer waits, so many at once.
    Between(usize),
}

/// What is had of the next frame.
pub enum NextFrame<O> {
    /// It is there.
    Ready(Prepared<O>),
    /// It is not read yet.
    Unread,
    /// There is none.
    None,
}

/// A frame to prepare, and where to.
type Task<P> = (PlannedFrame, SyncSender<Prepared<<P as Prepare>::Observation>>);

/// What the threads that run ahead share.
struct Shared<P: Prepare> {
    preparation: P,
    tasks: Mutex<Receiver<Task<P>>>,
    recycled: Mutex<Receiver<P::Observation>>,
}

/// Prepares frames one after the other; keeps memory between them.
struct Worker<P: Prepare> {
    memory: P::Memory,
    /// An observation whose memory the next frame may take.
    recycled: Option<P::Observation>,
}

impl<P: Prepare> Default for Worker<P> {
    fn default() -> Self {
        Self { memory: P::Memory::default(), recycled: None }
    }
}

/// A decoding thread could not be started.
#[derive(Debug, thiserror::Error)]
#[error("starting a decoding thread failed: {0}; close other programs and try again")]
pub struct SpawnError(#[from] std::io::Error);

impl<P: Prepare> Prefetch<P> {
    /// Prepares the frames of a plan, in order, from position `first`: ahead if this machine has a
    /// core that the current thread pool leaves free.
    pub fn start(
        dataset: Arc<Dataset>,
        plan: &Plan,
        first: usize,
        preparation: P,
    ) -> Result<Self, SpawnError> {
        let upcoming = PlannedFrame::of(&dataset, plan, first).collect();
        match decoders() {
            0 => {
                let at_once = rayon::current_num_threads().clamp(1, MAX_AT_ONCE);
                Self::with_threads(upcoming, preparation, at_once, Pace::Between(at_once))
            }
            // One frame ready beside those in the making.
            n => Self::with_threads(upcoming, preparation, n, Pace::Ahead(n + 1)),
        }
    }

    fn with_threads(
        upcoming: VecDeque<PlannedFrame>,
        preparation: P,
        n_threads: usize,
        pace: Pace,
    ) -> Result<Self, SpawnError> {
        let (asked, tasks) = channel();
        let (recycle, recycled) = sync_channel(n_threads + 1);
        let (tasks, recycled) = (Mutex::new(tasks), Mutex::new(recycled));
        let shared = Arc::new(Shared { preparation, tasks, recycled });
        for _ in 0..n_threads {
            let shared = shared.clone();
            thread::Builder::new().name("prefetch".into()).spawn(move || shared.run())?;
        }
        let (coming, ready) = (VecDeque::new(), VecDeque::new());
        let mut prefetch = Self { upcoming, pace, asked, coming, ready, recycle };
        prefetch.run_ahead();
        Ok(prefetch)
    }

    /// Frames that come behind all others.
    pub fn append(&mut self, frames: impl Iterator<Item = PlannedFrame>) {
        self.upcoming.extend(frames);
        self.run_ahead();
    }

    /// Keeps the threads busy, where they work all the time.
    fn run_ahead(&mut self) {
        if let Pace::Ahead(most) = self.pace {
            self.ask(most);
        }
    }

    /// Asks for frames until so many are asked for.
    fn ask(&mut self, most: usize) {
        while self.coming.len() < most
            && let Some(frame) = self.upcoming.pop_front()
        {
            let (slot, prepared) = sync_channel(1);
            // The threads end with the handle alone.
            drop(self.asked.send((frame, slot)));
            self.coming.push_back(prepared);
        }
    }

    /// The next frame, waiting for it; `None` after the last.
    pub fn next_frame(&mut self) -> Option<Prepared<P::Observation>> {
        match self.next_within(Duration::MAX) {
            NextFrame::Ready(frame) => Some(frame),
            NextFrame::Unread | NextFrame::None => None,
        }
    }

    /// The next frame, waiting no longer for it than that.
    pub fn next_within(&mut self, patience: Duration) -> NextFrame<P::Observation> {
        self.run_ahead();
        if let Pace::Between(at_once) = self.pace
            && self.ready.is_empty()
            && self.coming.is_empty()
        {
            self.ask(at_once);
        }
        let begun = Instant::now();
        while let Some(first) = self.coming.front() {
            match first.recv_timeout(patience.saturating_sub(begun.elapsed())) {
                Ok(frame) => self.ready.push_back(frame),
                Err(RecvTimeoutError::Timeout) => break,
                // Its thread is gone, and nothing more comes of it.
                Err(RecvTimeoutError::Disconnected) => {}
            }
            self.coming.pop_front();
            if matches!(self.pace, Pace::Ahead(_)) {
                break;
            }
        }
        match self.ready.pop_front() {
            Some(frame) => NextFrame::Ready(frame),
            None if self.coming.is_empty() => NextFrame::None,
            None => NextFrame::Unread,
        }
    }

    /// Gives a frame's memory back for another frame; after the last one it is free for whoever writes
    /// what was learnt.
    pub fn recycle(&mut self, observation: P::Observation) {
        if self.upcoming.is_empty() && self.coming.is_empty() {
            return;
        }
        // The threads may have memory enough: then this one is simply freed.
        drop(self.recycle.try_send(observation));
    }
}

impl<P: Prepare> Shared<P> {
    /// Prepares frames until the handle is dropped.
    fn run(&self) {
        let mut worker = Worker::<P>::default();
        while let Some((frame, slot)) = received(&self.tasks, |tasks| tasks.recv().ok()) {
            worker.recycled = received(&self.recycled, |recycled| recycled.try_recv().ok());
            // Nobody waits for it once the handle was dropped.
            drop(slot.send(worker.prepare(&self.preparation, &frame)));
        }
    }
}

/// What comes next out of a channel that several threads read.
fn received<T>(
    channel: &Mutex<Receiver<T>>,
    next: impl FnOnce(&Receiver<T>) -> Option<T>,
) -> Option<T> {
    next(&channel.lock().unwrap_or_else(PoisonError::into_inner))
}

impl<P: Prepare> Worker<P> {
    fn prepare(
        &mut self,
        preparation: &P,
        PlannedFrame { position, is_repeat, entry }: &PlannedFrame,
    ) -> Prepared<P::Observation> {
        let (name, marks) = (entry.name.clone(), entry.marks());
        // A defect costs this frame, by name: were the thread to end, the run would end with the frames so
        // far as if there were no more.
        let prepared = catch_unwind(AssertUnwindSafe(|| self.frame(preparation, entry)));
        let result = prepared.unwrap_or_else(|panic| {
            // Its buffers may be half done.
            *self = Self::default();
            Err(format!(
                "{name}: left out by a defect of this program, please report it: {}",
                panic_text(&*panic).unwrap_or(NO_WORDS)
            ))
        });
        Prepared { position: *position, is_repeat: *is_repeat, name, marks, result }
    }

    fn frame(
        &mut self,
        preparation: &P,
        entry: &FrameEntry,
    ) -> Result<PreparedFrame<P::Observation>, String> {
        let message = |e: FrameError| e.to_string();
        let mut clock = Stopwatch::start();
        let frame = entry.load().map_err(message)?;
        let load_ms = clock.lap_ms();
        let mut observation = self.recycled.take().unwrap_or_else(P::empty);
        let counts =
            preparation.prepare(&frame, &mut self.memory, &mut observation).map_err(message)?;
        let prepare_ms = clock.lap_ms();
        if P::n_points(&observation) == 0 {
            return Err(format!(
                "{}: expected pixels with usable depth, found none ({counts}); check the depth unit and range",
                frame.name
            ));
        }
        Ok(PreparedFrame { observation, dropped: P::dropped(&counts), load_ms, prepare_ms })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::frame::Frame;
    use crate::dataset::synthetic::{SyntheticParams, dataset};
    use crate::pipeline::plan::Selection;
    use std::time::Duration;

    /// Takes the longer the earlier a frame is, and panics where one has this name.
    struct Slow {
        defect: Option<String>,
    }

    impl Prepare for Slow {
        type Observation = String;
        type Memory = usize;
        type Counts = usize;

        fn empty() -> String {
            String::new()
        }

        fn prepare(
            &self,
            frame: &Frame,
            calls: &mut usize,
            name: &mut String,
        ) -> Result<usize, FrameError> {
            assert!(Some(&frame.name) != self.defect.as_ref(), "a defect of {}", frame.name);
            let number = frame.name.chars().filter_map(|c| c.to_digit(10)).next_back().unwrap();
            thread::sleep(Duration::from_millis(10 * u64::from(9 - number)));
            name.clone_from(&frame.name);
            *calls += 1;
            Ok(*calls)
        }

        fn n_points(name: &String) -> usize {
            name.len()
        }

        fn dropped(calls: &usize) -> usize {
            *calls
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
        let plan = Plan::new(&room, &Selection::everything(), 0).unwrap();
        (room, plan)
    }

    #[test]
    fn frames_come_in_their_order_however_many_threads_prepare_them() {
        let (room, plan) = room();
        for decoders in [1, 4] {
            let upcoming = PlannedFrame::of(&room, &plan, 0).collect();
            let slow = Slow { defect: None };
            let pace = Pace::Ahead(decoders + 1);
            let mut prefetch = Prefetch::with_threads(upcoming, slow, decoders, pace).unwrap();
            let mut calls = 0;
            for position in 0..plan.frames.len() {
                let prepared = prefetch.next_frame().unwrap();
                let frame = prepared.result.unwrap();
                assert_eq!((prepared.position, &prepared.name), (position, &frame.observation));
                calls = calls.max(frame.dropped);
                prefetch.recycle(frame.observation);
            }
            assert!(prefetch.next_frame().is_none());
            let by_one = calls == plan.frames.len();
            assert_eq!(by_one, decoders == 1, "{calls} frames by one of {decoders} threads");
        }
    }

    #[test]
    fn a_defect_costs_one_frame_and_not_those_behind_it() {
        let (room, plan) = room();
        let names = || plan.frames.iter().map(|&i| room.splits[plan.split].frames[i].name.clone());
        let defect: String = names().nth(2).unwrap();
        // Ahead where there is a core for it, and between trainings.
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
                let expected = format!("{defect}: left out by a defect of this program");
                assert_eq!(name == defect, said.starts_with(&expected), "{name}: {said}");
                assert_eq!(name == defect, said.contains("a defect of "), "{name}: {said}");
            }
        }
    }
}
