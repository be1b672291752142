//! The thread that owns the trainer. It takes orders between frames, publishes snapshots and
//! changed splats, and never waits for the window.

mod autosave;
mod awaited;
mod calibrate;
mod crash;
mod dirty;
mod file_progress;
mod files;
mod first_look;
mod following;
mod opening_wish;
mod opening_work;
mod order;
mod publishing;
mod reading;
mod run_autosave;
mod shared;
mod step_clock;
mod subject;
mod thread;
mod training;

pub use file_progress::FileProgress;
pub use order::WorkerOrder;
pub use shared::Waker;

use super::panic_report::PanicReport;
use super::rescue::{Crash, Rescue, fallback_folders};
use super::splat_updates::SplatUpdates;
use super::state::{RunState, Snapshot};
use shared::Shared;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;
use thread::WorkerThread;

/// Least time between two snapshots where a GPU draws them.
const INTERVAL: Duration = Duration::from_millis(33);

/// A frame that takes so long is spoken of. A step that takes so much longer (frames are not waited for in it, but
/// the folder of a recording is read) is not waited for where the program ends, as what was not saved ends with it.
const SLOW_FRAME: Duration = Duration::from_secs(5);
const STUCK_FRAME: Duration = Duration::from_secs(30);
/// How often it is looked for the end of the thread.
const LOOK: Duration = Duration::from_millis(5);

/// Orders that wait at most. Nobody gives so many while a dataset is opened; a window that did would
/// wait for the trainer rather than fill the memory.
const MAX_ORDERS: usize = 1024;

/// Handle of the trainer's thread; dropping it stops the thread after the current frame.
pub struct Worker {
    orders: Option<SyncSender<WorkerOrder>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

impl Worker {
    /// Starts the thread. See [`Self::set_interval`].
    pub fn start(waker: Waker) -> std::io::Result<Self> {
        Self::start_with(waker, fallback_folders())
    }

    /// Starts the thread; after a panic, scenes that cannot be saved beside their dataset go to the
    /// first of the folders that takes them.
    pub fn start_with(waker: Waker, rescue_folders: Vec<PathBuf>) -> std::io::Result<Self> {
        PanicReport::listen();
        let (orders, inbox) = sync_channel(MAX_ORDERS);
        let shared = Arc::new(Shared::default());
        shared.set_interval(INTERVAL);
        let state = WorkerThread::new(inbox, shared.clone(), waker, rescue_folders);
        let thread =
            std::thread::Builder::new().name("trainer".into()).spawn(move || state.run())?;
        Ok(Self { orders: Some(orders), shared, thread: Some(thread) })
    }

    /// Changes the least time between two snapshots, with the splats that changed meanwhile; 33 ms
    /// at first.
    pub fn set_interval(&self, interval: Duration) {
        self.shared.set_interval(interval);
    }

    /// Hands an order over; returns at once.
    pub fn send(&self, order: WorkerOrder) {
        let opens = matches!(order, WorkerOrder::Open(_) | WorkerOrder::OpenFirst(_));
        if opens && self.snapshot().state == RunState::Loading {
            // The newest wish counts, and what is being opened may never be.
            self.cancel_opening();
        }
        if let Some(orders) = &self.orders {
            // A thread that a second panic has ended takes none, which [`Self::is_alive`] tells.
            let _ = orders.send(order);
        }
    }

    /// Whether the thread still takes orders; only a panic while a panic is dealt with ends it.
    pub fn is_alive(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    /// The newest snapshot.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.shared.snapshot()
    }

    /// Changed splats on their way to the viewport.
    pub fn splat_updates(&self) -> &SplatUpdates {
        &self.shared.updates
    }

    /// A number for the next file, by which the snapshot tells its outcome. No two windows on the same
    /// run are given the same.
    pub fn new_number(&self) -> u64 {
        self.shared.new_number()
    }

    /// The share of the file being exported that is written; `None` while none is.
    pub fn file_progress(&self) -> Option<f32> {
        self.shared.file.share()
    }

    /// Gives up the file being exported; an older one of its name stays.
    pub fn cancel_file(&self) {
        self.shared.file.cancel();
    }

    /// Gives up what is being opened; what was open before stays.
    pub fn cancel_opening(&self) {
        self.shared.opening.cancel();
    }

    /// The thread's latest panic and what became of the scene.
    pub fn crash(&self) -> Option<Crash> {
        self.shared.crash()
    }

    /// Saves what no checkpoint holds yet, after the orders before; waits for it.
    pub fn rescue(&self) -> Rescue {
        self.saved_by(WorkerOrder::Rescue)
    }

    /// Stops training and keeps what no checkpoint holds where the next window offers to go on, after the
    /// orders before; waits for it. The snapshot then has windows close.
    pub fn leave_behind(&self) -> Rescue {
        self.saved_by(WorkerOrder::LeaveBehind)
    }

    fn saved_by(&self, order: impl FnOnce(SyncSender<Rescue>) -> WorkerOrder) -> Rescue {
        // What is being opened is no more wanted, and may be on a drive that never answers.
        self.shared.opening.end();
        let (sender, receiver) = sync_channel(1);
        self.send(order(sender));
        // Without a limit of time but at a drive that never answers: the program ends
        // afterwards, and with it what is not saved. If the thread has ended, the sender
        // has too, and the panic that ended it tells what was saved.
        let lost = |problem: &str| Rescue::Lost {
            frames: self.snapshot().unsaved_frames,
            problems: vec![problem.to_owned()],
        };
        loop {
            match (receiver.recv_timeout(LOOK), self.crash()) {
                (Ok(rescue), _) => return rescue,
                (Err(RecvTimeoutError::Disconnected), Some(crash)) => return crash.rescue,
                (Err(RecvTimeoutError::Disconnected), None) => {
                    return lost("the training thread has ended");
                }
                (Err(RecvTimeoutError::Timeout), _) if self.is_stuck() => {
                    return lost("the training thread waits for a drive that does not answer");
                }
                (Err(RecvTimeoutError::Timeout), _) => {}
            }
        }
    }

    /// For how long the trainer has been at one frame, where that is long: its drive may not answer.
    pub fn slow_frame(&self) -> Option<Duration> {
        let clocks = [&self.shared.step, &self.shared.unread];
        let longest = clocks.into_iter().filter_map(|clock| clock.at_frame()).max();
        longest.filter(|time| *time >= SLOW_FRAME)
    }

    /// Whether the thread is at something that nobody need wait for.
    fn is_stuck(&self) -> bool {
        self.shared.step.at_frame().is_some_and(|time| time >= STUCK_FRAME)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // Hanging up is what ends the loop of the thread, so it comes before the join.
        self.orders = None;
        self.shared.opening.end();
        if let Some(thread) = self.thread.take() {
            while !thread.is_finished() {
                if self.is_stuck() {
                    // Left behind with what it waits for; the program ends without it.
                    return;
                }
                std::thread::sleep(LOOK);
            }
            // A panic of the thread was reported when it happened.
            let _ = thread.join();
        }
    }
}
