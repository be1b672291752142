//! Decoding and unprojection of the frames to come: on their own thread through a bounded queue
//! where a core is left for it, else some frames at once between trainings. On a machine whose cores
//! all train, a decoding thread doubles the time of the trainings it runs beside (`pipeline.md`,
//! Prefetch).

use super::plan::Plan;
use super::prepare::Prepare;
use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::train::timing::Stopwatch;
use rayon::prelude::*;
use std::collections::VecDeque;
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

/// The frames to come. Dropping it ends its thread, if it has one.
pub struct Prefetch<P: Prepare>(Source<P>);

enum Source<P: Prepare> {
    /// A thread that runs ahead.
    Ahead { frames: Receiver<Prepared<P::Observation>>, recycle: SyncSender<P::Observation> },
    /// Threads of the trainer, while it waits.
    Between {
        frames: Frames<P>,
        workers: Vec<Worker<P>>,
        ready: VecDeque<Prepared<P::Observation>>,
    },
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
        let frames = Frames { dataset, plan: plan.clone(), next: first, preparation };
        if threads < cores { Self::ahead(frames) } else { Ok(Self::between(frames, threads)) }
    }

    fn ahead(mut frames: Frames<P>) -> Result<Self, SpawnError> {
        let (sender, receiver) = sync_channel(QUEUE_LENGTH - 1);
        // No more goes back than there are frames in the making, ready and in training.
        let (recycle, recycled) = sync_channel(QUEUE_LENGTH + 1);
        thread::Builder::new()
            .name("prefetch".into())
            .spawn(move || run_ahead(&mut frames, &sender, &recycled))?;
        Ok(Self(Source::Ahead { frames: receiver, recycle }))
    }

    fn between(frames: Frames<P>, threads: usize) -> Self {
        let mut workers = Vec::new();
        workers.resize_with(threads.clamp(1, MAX_AT_ONCE), Worker::default);
        Self(Source::Between { frames, workers, ready: VecDeque::new() })
    }

    /// The next frame, waiting for it; `None` after the last.
    pub fn next_frame(&mut self) -> Option<Prepared<P::Observation>> {
        match &mut self.0 {
            Source::Ahead { frames, .. } => frames.recv().ok(),
            Source::Between { frames, workers, ready } => {
                if ready.is_empty() {
                    let first = frames.next;
                    frames.next = frames.plan.frames.len().min(first + workers.len());
                    let positions = (first..frames.next).into_par_iter();
                    let frames = &*frames;
                    let prepared =
                        positions.zip(&mut *workers).map(|(at, worker)| frames.prepare(at, worker));
                    ready.extend(prepared.collect::<Vec<_>>());
                }
                ready.pop_front()
            }
        }
    }

    /// Gives a frame's memory back for another frame.
    pub fn recycle(&mut self, observation: P::Observation) {
        match &mut self.0 {
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

fn run_ahead<P: Prepare>(
    frames: &mut Frames<P>,
    sender: &SyncSender<Prepared<P::Observation>>,
    recycled: &Receiver<P::Observation>,
) {
    let mut worker = Worker::default();
    for position in frames.next..frames.plan.frames.len() {
        worker.recycled = recycled.try_recv().ok();
        if sender.send(frames.prepare(position, &mut worker)).is_err() {
            return; // the handle was dropped
        }
    }
}

/// What is to be prepared.
struct Frames<P> {
    dataset: Arc<Dataset>,
    plan: Plan,
    /// Position in the plan.
    next: usize,
    preparation: P,
}

impl<P: Prepare> Frames<P> {
    fn prepare(&self, position: usize, worker: &mut Worker<P>) -> Prepared<P::Observation> {
        let index = self.plan.frames[position];
        let name = self.dataset.splits[self.plan.split].frames[index].name.clone();
        let result = self.frame(index, worker);
        Prepared { position, name, result }
    }

    fn frame(
        &self,
        index: usize,
        worker: &mut Worker<P>,
    ) -> Result<PreparedFrame<P::Observation>, String> {
        let message = |e: FrameError| e.to_string();
        let mut clock = Stopwatch::start();
        let frame = self.dataset.load(self.plan.split, index).map_err(message)?;
        let load_ms = clock.lap_ms();
        let mut observation = worker.recycled.take().unwrap_or_else(P::empty);
        let counts = self
            .preparation
            .prepare(&frame, &mut worker.memory, &mut observation)
            .map_err(message)?;
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
