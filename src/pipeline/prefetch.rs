//! Decoding and unprojection of the frames to come: on threads of their own, in order and boundedly far
//! ahead, where cores are left for them, else some frames at once between trainings. On a machine whose
//! cores all train, a decoding thread doubles the time of the trainings it runs beside (`pipeline.md`,
//! Prefetch).

use super::panic_text::{NO_WORDS, panic_text};
use super::plan::Plan;
use super::prepare::Prepare;
use crate::dataset::error::FrameError;
use crate::dataset::{Dataset, FrameEntry};
use crate::train::timing::Stopwatch;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;

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

/// The frames to come. Dropping it ends its threads, if it has any.
pub struct Prefetch<P: Prepare> {
    upcoming: VecDeque<PlannedFrame>,
    source: Source<P>,
}

enum Source<P: Prepare> {
    /// Threads that run ahead.
    Ahead {
        asked: Sender<Task<P>>,
        /// Where the frames asked for will be, in their order.
        coming: VecDeque<Receiver<Prepared<P::Observation>>>,
        /// Most of them.
        most: usize,
        recycle: SyncSender<P::Observation>,
    },
    /// Threads of the trainer, while it waits.
    Between { preparation: P, workers: Vec<Worker<P>>, ready: VecDeque<Prepared<P::Observation>> },
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
        let source = match decoders() {
            0 => Source::between(preparation, rayon::current_num_threads()),
            decoders => Source::ahead(preparation, decoders)?,
        };
        let upcoming = PlannedFrame::of(&dataset, plan, first).collect();
        let mut prefetch = Self { upcoming, source };
        prefetch.ask();
        Ok(prefetch)
    }

    /// Frames that come behind all others.
    pub fn append(&mut self, frames: impl Iterator<Item = PlannedFrame>) {
        self.upcoming.extend(frames);
        self.ask();
    }

    /// Keeps the threads busy.
    fn ask(&mut self) {
        let Source::Ahead { asked, coming, most, .. } = &mut self.source else { return };
        while coming.len() < *most
            && let Some(frame) = self.upcoming.pop_front()
        {
            let (slot, prepared) = sync_channel(1);
            // The threads end with the handle alone.
            drop(asked.send((frame, slot)));
            coming.push_back(prepared);
        }
    }

    /// The next frame, waiting for it; `None` after the last.
    pub fn next_frame(&mut self) -> Option<Prepared<P::Observation>> {
        self.ask();
        match &mut self.source {
            Source::Ahead { coming, .. } => coming.pop_front()?.recv().ok(),
            Source::Between { preparation, workers, ready } => {
                if ready.is_empty() {
                    let n = self.upcoming.len().min(workers.len());
                    let frames: Vec<PlannedFrame> = self.upcoming.drain(..n).collect();
                    let prepared = frames
                        .into_par_iter()
                        .zip(&mut *workers)
                        .map(|(frame, worker)| worker.prepare(preparation, &frame));
                    ready.extend(prepared.collect::<Vec<_>>());
                }
                ready.pop_front()
            }
        }
    }

    /// Gives a frame's memory back for another frame.
    pub fn recycle(&mut self, observation: P::Observation) {
        match &mut self.source {
            // The threads may have ended, or have memory enough: then this one is simply freed.
            Source::Ahead { recycle, .. } => drop(recycle.try_send(observation)),
            Source::Between { workers, .. } => {
                if let Some(worker) = workers.iter_mut().find(|worker| worker.recycled.is_none()) {
                    worker.recycled = Some(observation);
                }
            }
        }
    }
}

impl<P: Prepare> Source<P> {
    fn ahead(preparation: P, decoders: usize) -> Result<Self, SpawnError> {
        // One frame ready beside those in the making.
        let most = decoders + 1;
        let (asked, tasks) = channel();
        let (recycle, recycled) = sync_channel(most);
        let (tasks, recycled) = (Mutex::new(tasks), Mutex::new(recycled));
        let shared = Arc::new(Shared { preparation, tasks, recycled });
        for _ in 0..decoders {
            let shared = shared.clone();
            thread::Builder::new().name("prefetch".into()).spawn(move || shared.run())?;
        }
        Ok(Self::Ahead { asked, coming: VecDeque::new(), most, recycle })
    }

    fn between(preparation: P, threads: usize) -> Self {
        let mut workers = Vec::new();
        workers.resize_with(threads.clamp(1, MAX_AT_ONCE), Worker::default);
        Self::Between { preparation, workers, ready: VecDeque::new() }
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
        let name = entry.name.clone();
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
        Prepared { position: *position, is_repeat: *is_repeat, name, result }
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
            let source = Source::ahead(Slow { defect: None }, decoders).unwrap();
            let mut prefetch = Prefetch { upcoming, source };
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
        // Threads of their own where there is a core for one, and the trainer's threads.
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
