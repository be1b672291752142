//! Decoding and unprojection ahead of training, on their own thread, through a bounded queue.

use super::plan::Plan;
use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::points::{PointCounts, UnprojectSettings, Unprojector};
use crate::math::points::Points;
use crate::train::timing::Stopwatch;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender, channel, sync_channel};
use std::thread;

/// Prepared frames that may wait: one being trained, one ready, one in the making.
pub const QUEUE_LENGTH: usize = 2;

/// A frame ready to be trained on.
pub struct Prepared {
    /// Position in the plan.
    pub position: usize,
    /// Name within the split.
    pub name: String,
    /// Its points, or why it is skipped.
    pub result: Result<PreparedPoints, String>,
}

/// Points of a frame and what it took to get them.
pub struct PreparedPoints {
    /// Normalised points in tile order.
    pub points: Points<f32>,
    /// What became of the pixels.
    pub counts: PointCounts,
    /// Reading and decoding, milliseconds.
    pub load_ms: f64,
    /// Filtering, unprojecting and normalising, milliseconds.
    pub prepare_ms: f64,
}

/// Handle of the decoding thread; dropping it stops the thread.
pub struct Prefetch {
    frames: Receiver<Prepared>,
    recycle: std::sync::mpsc::Sender<Points<f32>>,
}

/// The decoding thread could not be started.
#[derive(Debug, thiserror::Error)]
#[error("starting the decoding thread failed: {0}; close other programs and try again")]
pub struct SpawnError(#[from] std::io::Error);

impl Prefetch {
    /// Starts decoding the frames of a plan, in order, from position `first`.
    pub fn start(
        dataset: Arc<Dataset>,
        plan: &Plan,
        first: usize,
        settings: UnprojectSettings,
    ) -> Result<Self, SpawnError> {
        let (split, frames) = (plan.split, plan.frames.clone());
        let (sender, receiver) = sync_channel(QUEUE_LENGTH - 1);
        let (recycle, recycled) = channel();
        let worker = Worker { dataset, split, settings, unprojector: Unprojector::new(), recycled };
        thread::Builder::new()
            .name("prefetch".into())
            .spawn(move || worker.run(&frames, first, &sender))?;
        Ok(Self { frames: receiver, recycle })
    }

    /// The next frame, waiting for it; `None` after the last.
    pub fn next(&self) -> Option<Prepared> {
        self.frames.recv().ok()
    }

    /// Gives a frame's memory back for another frame.
    pub fn recycle(&self, points: Points<f32>) {
        // The thread may have ended already: then the memory is simply freed.
        let _ = self.recycle.send(points);
    }
}

struct Worker {
    dataset: Arc<Dataset>,
    split: usize,
    settings: UnprojectSettings,
    unprojector: Unprojector,
    recycled: Receiver<Points<f32>>,
}

impl Worker {
    fn run(mut self, frames: &[usize], first: usize, sender: &SyncSender<Prepared>) {
        for (position, &index) in frames.iter().enumerate().skip(first) {
            let name = self.dataset.splits[self.split].frames[index].name.clone();
            // A decoder that panics on a damaged file costs that frame, not the scene.
            let result =
                catch_unwind(AssertUnwindSafe(|| self.prepare(index))).unwrap_or_else(|_| {
                    Err(format!("{name}: decoding this frame crashed; check or remove its files"))
                });
            if sender.send(Prepared { position, name, result }).is_err() {
                return; // the handle was dropped
            }
        }
    }

    fn prepare(&mut self, index: usize) -> Result<PreparedPoints, String> {
        let message = |e: FrameError| e.to_string();
        let mut clock = Stopwatch::start();
        let frame = self.dataset.load(self.split, index).map_err(message)?;
        let load_ms = clock.lap_ms();
        let mut points = self.recycled.try_recv().unwrap_or_default();
        let counts =
            self.unprojector.unproject(&frame, &self.settings, &mut points).map_err(message)?;
        let prepare_ms = clock.lap_ms();
        if points.is_empty() {
            return Err(format!(
                "{}: expected pixels with usable depth, found none ({} holes, {} at edges, {} out of range, {} transparent); check the depth unit and range",
                frame.name,
                counts.holes,
                counts.dropped_edge,
                counts.dropped_range,
                counts.dropped_alpha
            ));
        }
        Ok(PreparedPoints { points, counts, load_ms, prepare_ms })
    }
}
