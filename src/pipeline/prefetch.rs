//! Decoding and unprojection of the frames to come: on their own thread through a bounded queue
//! where a core is left for it, else some frames at once between trainings. On a machine whose cores
//! all train, a decoding thread doubles the time of the trainings it runs beside (`pipeline.md`,
//! Prefetch).

use super::plan::Plan;
use super::prepare::Prepare;
use crate::dataset::error::FrameError;
use crate::dataset::{Dataset, FrameEntry};
use crate::train::timing::Stopwatch;
use rayon::prelude::*;
use std::any::Any;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::thread;

/// Prepared frames that may wait: one being trained, one ready, one in the making.
pub const QUEUE_LENGTH: usize = 2;
/// Frames prepared at once between trainings, at most.
const MAX_AT_ONCE: usize = 4;

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

/// The frames to come. Dropping it ends its thread, if it has one.
pub struct Prefetch<P: Prepare> {
    upcoming: VecDeque<PlannedFrame>,
    source: Source<P>,
}

enum Source<P: Prepare> {
    /// A thread that runs ahead.
    Ahead {
        asked: SyncSender<PlannedFrame>,
        /// Frames asked for that did not come yet.
        n_asked: usize,
        frames: Receiver<Prepared<P::Observation>>,
        recycle: SyncSender<P::Observation>,
    },
    /// Threads of the trainer, while it waits.
    Between { preparation: P, workers: Vec<Worker<P>>, ready: VecDeque<Prepared<P::Observation>> },
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

/// The decoding thread could not be started.
#[derive(Debug, thiserror::Error)]
#[error("starting the decoding thread failed: {0}; close other programs and try again")]
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
        let threads = rayon::current_num_threads();
        let cores = thread::available_parallelism().map_or(1, usize::from);
        let source = match threads < cores {
            true => Source::ahead(preparation)?,
            false => Source::between(preparation, threads),
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

    /// Keeps the thread busy.
    fn ask(&mut self) {
        let Source::Ahead { asked, n_asked, .. } = &mut self.source else { return };
        while *n_asked <= QUEUE_LENGTH
            && let Some(frame) = self.upcoming.pop_front()
        {
            // The thread ends with the handle alone.
            drop(asked.send(frame));
            *n_asked += 1;
        }
    }

    /// The next frame, waiting for it; `None` after the last.
    pub fn next_frame(&mut self) -> Option<Prepared<P::Observation>> {
        self.ask();
        match &mut self.source {
            Source::Ahead { n_asked, frames, .. } => {
                *n_asked = n_asked.checked_sub(1)?;
                frames.recv().ok()
            }
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
            // The thread may have ended, or have memory enough: then this one is simply freed.
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
    fn ahead(preparation: P) -> Result<Self, SpawnError> {
        // No more is asked for than there are frames in training, ready and in the making.
        let (asked, inbox) = sync_channel(QUEUE_LENGTH + 1);
        let (sender, frames) = sync_channel(QUEUE_LENGTH - 1);
        let (recycle, recycled) = sync_channel(QUEUE_LENGTH + 1);
        thread::Builder::new().name("prefetch".into()).spawn(move || {
            let mut worker = Worker::<P>::default();
            for frame in inbox {
                worker.recycled = recycled.try_recv().ok();
                if sender.send(worker.prepare(&preparation, &frame)).is_err() {
                    return; // the handle was dropped
                }
            }
        })?;
        Ok(Self::Ahead { asked, n_asked: 0, frames, recycle })
    }

    fn between(preparation: P, threads: usize) -> Self {
        let mut workers = Vec::new();
        workers.resize_with(threads.clamp(1, MAX_AT_ONCE), Worker::default);
        Self::Between { preparation, workers, ready: VecDeque::new() }
    }
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
                said(&*panic)
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

/// What a panic said.
fn said(panic: &(dyn Any + Send)) -> &str {
    let text = panic.downcast_ref::<String>().map(String::as_str);
    text.or_else(|| panic.downcast_ref::<&str>().copied()).unwrap_or("a panic without words")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::frame::Frame;
    use crate::dataset::synthetic::{SyntheticParams, dataset};
    use crate::pipeline::plan::Selection;

    /// Panics where a frame says so.
    struct Defect(String);

    impl Prepare for Defect {
        type Observation = usize;
        type Memory = ();
        type Counts = usize;

        fn empty() -> usize {
            0
        }

        fn prepare(&self, frame: &Frame, _: &mut (), n: &mut usize) -> Result<usize, FrameError> {
            assert!(frame.name != self.0, "a defect of {}", frame.name);
            *n = 1;
            Ok(0)
        }

        fn n_points(observation: &usize) -> usize {
            *observation
        }

        fn dropped(counts: &usize) -> usize {
            *counts
        }
    }

    #[test]
    fn a_defect_costs_one_frame_and_not_those_behind_it() {
        let small = SyntheticParams {
            width: 12,
            height: 9,
            n_train: 7,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        let room = Arc::new(dataset(&small).unwrap());
        let plan = Plan::new(&room, &Selection::everything(), 0).unwrap();
        let names = || plan.frames.iter().map(|&i| room.splits[plan.split].frames[i].name.clone());
        let defect: String = names().nth(2).unwrap();
        // A thread of its own where there is a core for it, and the trainer's threads.
        for n_threads in [1, 64] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let results = pool.install(|| {
                let mut prefetch =
                    Prefetch::start(Arc::clone(&room), &plan, 0, Defect(defect.clone())).unwrap();
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
