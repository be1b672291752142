//! Decoding and unprojection of the frames to come: on their own thread through a bounded queue
//! where a core is left for it, else some frames at once between trainings. On a machine whose cores
//! all train, a decoding thread doubles the time of the trainings it runs beside (`engine.md` 10).

use super::plan::Plan;
use super::prepared::{Counts, Desk, Material, Preparation};
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
pub struct Prepared {
    /// Position in the plan.
    pub position: usize,
    /// Name within the split.
    pub name: String,
    /// Its points, or why it is skipped.
    pub result: Result<PreparedFrame, String>,
}

/// What a frame holds for the model, and what it took to get it.
pub struct PreparedFrame {
    /// What the model learns from.
    pub material: Material,
    /// What became of the pixels.
    pub counts: Counts,
    /// Reading and decoding, milliseconds.
    pub load_ms: f64,
    /// Filtering, unprojecting and normalising, milliseconds.
    pub prepare_ms: f64,
}

/// The frames to come. Dropping it ends its thread, if it has one.
pub struct Prefetch(Source);

enum Source {
    /// A thread that runs ahead. No more material goes back than there are frames in the making,
    /// ready and in training.
    Ahead { frames: Receiver<Prepared>, recycle: SyncSender<Material> },
    /// Threads of the trainer, while it waits.
    Between { frames: Frames, desks: Vec<Desk>, ready: VecDeque<Prepared> },
}

/// The decoding thread could not be started.
#[derive(Debug, thiserror::Error)]
#[error("starting the decoding thread failed: {0}; close other programs and try again")]
pub struct SpawnError(#[from] std::io::Error);

impl Prefetch {
    /// Prepares the frames of a plan, in order, from position `first`: ahead if this machine has a
    /// core that the current thread pool leaves free.
    pub fn start(
        dataset: Arc<Dataset>,
        plan: &Plan,
        first: usize,
        preparation: Preparation,
    ) -> Result<Self, SpawnError> {
        let threads = rayon::current_num_threads();
        let cores = thread::available_parallelism().map_or(1, usize::from);
        let frames = Frames { dataset, plan: plan.clone(), next: first, preparation };
        if threads < cores { Self::ahead(frames) } else { Ok(Self::between(frames, threads)) }
    }

    fn ahead(mut frames: Frames) -> Result<Self, SpawnError> {
        let (sender, receiver) = sync_channel(QUEUE_LENGTH - 1);
        let (recycle, recycled) = sync_channel(QUEUE_LENGTH + 1);
        thread::Builder::new()
            .name("prefetch".into())
            .spawn(move || run_ahead(&mut frames, &sender, &recycled))?;
        Ok(Self(Source::Ahead { frames: receiver, recycle }))
    }

    fn between(frames: Frames, threads: usize) -> Self {
        let mut desks = Vec::new();
        desks.resize_with(threads.clamp(1, MAX_AT_ONCE), Desk::default);
        Self(Source::Between { frames, desks, ready: VecDeque::new() })
    }

    /// The next frame, waiting for it; `None` after the last.
    pub fn next_frame(&mut self) -> Option<Prepared> {
        match &mut self.0 {
            Source::Ahead { frames, .. } => frames.recv().ok(),
            Source::Between { frames, desks, ready } => {
                if ready.is_empty() {
                    let first = frames.next;
                    frames.next = frames.plan.frames.len().min(first + desks.len());
                    let positions = (first..frames.next).into_par_iter();
                    let frames = &*frames;
                    let prepared =
                        positions.zip(&mut *desks).map(|(at, desk)| frames.prepare(at, desk));
                    ready.extend(prepared.collect::<Vec<_>>());
                }
                ready.pop_front()
            }
        }
    }

    /// Gives a frame's memory back for another frame.
    pub fn recycle(&mut self, material: Material) {
        match &mut self.0 {
            // Where the thread has ended or has memory enough waiting, this is simply freed: whoever
            // trains never waits to give something back.
            Source::Ahead { recycle, .. } => drop(recycle.try_send(material)),
            Source::Between { desks, .. } => {
                if let Some(desk) = desks.iter_mut().find(|desk| desk.memory.is_none()) {
                    desk.memory = Some(material);
                }
            }
        }
    }
}

fn run_ahead(frames: &mut Frames, sender: &SyncSender<Prepared>, recycled: &Receiver<Material>) {
    let mut desk = Desk::default();
    for position in frames.next..frames.plan.frames.len() {
        desk.memory = recycled.try_recv().ok();
        if sender.send(frames.prepare(position, &mut desk)).is_err() {
            return; // the handle was dropped
        }
    }
}

/// What is to be prepared.
struct Frames {
    dataset: Arc<Dataset>,
    plan: Plan,
    /// Position in the plan.
    next: usize,
    preparation: Preparation,
}

impl Frames {
    fn prepare(&self, position: usize, desk: &mut Desk) -> Prepared {
        let index = self.plan.frames[position];
        let name = self.dataset.splits[self.plan.split].frames[index].name.clone();
        let result = self.frame(index, desk);
        Prepared { position, name, result }
    }

    fn frame(&self, index: usize, desk: &mut Desk) -> Result<PreparedFrame, String> {
        let message = |e: FrameError| e.to_string();
        let mut clock = Stopwatch::start();
        let frame = self.dataset.load(self.plan.split, index).map_err(message)?;
        let load_ms = clock.lap_ms();
        let (material, counts) = desk.prepare(&frame, &self.preparation).map_err(message)?;
        let prepare_ms = clock.lap_ms();
        if material.is_empty() {
            return Err(format!(
                "{}: expected pixels with usable depth, found none ({counts}); check the depth unit and range",
                frame.name
            ));
        }
        Ok(PreparedFrame { material, counts, load_ms, prepare_ms })
    }
}
