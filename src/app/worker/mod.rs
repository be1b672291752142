//! Training thread. It executes orders between frames, publishes snapshots and changed splats, and never
//! waits for the window.

mod autosave;
mod files;
mod following;
mod outbox;
mod run;
mod subject;
mod thread;
mod training;

use super::rescue::{Crash, Rescue, default_folders};
use super::splat_updates::{Mailbox, SplatUpdates};
use super::state::{RunState, Snapshot};
use super::viewer::thumbnails::TrainedThumbnails;
use crate::pipeline::job::Progress;
use crate::pipeline::panic_report::PanicReport;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;
use thread::WorkerThread;

pub use crate::pipeline::job::Waker;
pub use files::Export;
pub use thread::WorkerOrder;

/// Minimum time between two snapshots if a GPU draws the scene.
const INTERVAL: Duration = Duration::from_millis(33);

/// Time spent waiting for a frame after which the window reports the delay, because the drive may not
/// respond.
const SLOW_FRAME: Duration = Duration::from_secs(5);

/// Maximum number of queued orders, more than a user gives while a dataset is opened. If the queue is
/// full, the window waits for the trainer, so that memory stays bounded.
const MAX_ORDERS: usize = 1024;

/// Handle of the training thread; dropping it stops the thread after the current frame.
pub struct Worker {
    orders: Option<SyncSender<WorkerOrder>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    folders: Arc<[PathBuf]>,
}

impl Worker {
    /// Starts the training thread with the default folders for autosaves.
    pub fn start(waker: Waker) -> std::io::Result<Self> {
        Self::start_with(waker, default_folders())
    }

    /// Starts the training thread. Autosaves go to the first folder. The other folders are used if the
    /// program ends unexpectedly and the first cannot be written.
    pub fn start_with(waker: Waker, folders: Vec<PathBuf>) -> std::io::Result<Self> {
        // The hook records the place of a panic, which its payload lacks.
        PanicReport::install_hook();
        let (orders, inbox) = sync_channel(MAX_ORDERS);
        let shared = Arc::new(Shared::default());
        shared.set_interval(INTERVAL);
        let state = WorkerThread::new(inbox, shared.clone(), waker, folders.clone());
        let thread =
            std::thread::Builder::new().name("trainer".into()).spawn(move || state.run())?;
        let folders = folders.into();
        Ok(Self { orders: Some(orders), shared, thread: Some(thread), folders })
    }

    /// Folders for files that the program writes without a prompt, in order of preference.
    pub fn folders(&self) -> &Arc<[PathBuf]> {
        &self.folders
    }

    /// Sets the minimum time between two snapshots, and between updates of the splats; initially 33 ms.
    pub fn set_interval(&self, interval: Duration) {
        self.shared.set_interval(interval);
    }

    pub fn send(&self, order: WorkerOrder) {
        let opens = matches!(order, WorkerOrder::Open(_));
        if opens && self.snapshot().state == RunState::Loading {
            // The newest request counts, and the current opening may never end.
            self.cancel_opening();
        }
        if let Some(orders) = &self.orders {
            // Fails only if a second panic has ended the thread, see [`Self::is_alive`].
            let _ = orders.send(order);
        }
    }

    /// True while the thread accepts orders. The thread ends early only if a panic occurs while an
    /// earlier panic is handled.
    pub fn is_alive(&self) -> bool {
        self.thread.as_ref().is_some_and(|thread| !thread.is_finished())
    }

    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.shared.snapshot.get()
    }

    pub fn splat_updates(&self) -> &SplatUpdates {
        &self.shared.updates
    }

    /// Pictures of the frames that training has decoded, for the frame strip.
    pub fn trained_thumbnails(&self) -> &TrainedThumbnails {
        &self.shared.thumbnails
    }

    /// Returns a number that identifies the next file to be written, unique among all windows of a run. The
    /// snapshot reports the file's outcome with this number.
    pub fn new_number(&self) -> u64 {
        self.shared.new_number()
    }

    /// Returns the written fraction of the file being exported; `None` if no export is in progress.
    pub fn file_progress(&self) -> Option<f32> {
        self.shared.file.share()
    }

    pub fn cancel_file(&self) {
        self.shared.file.cancel();
    }

    /// Cancels the opening of a dataset or model; the previous one remains open.
    pub fn cancel_opening(&self) {
        self.shared.opening.cancel();
    }

    /// Returns the latest panic of the thread, with the outcome of storing its run.
    pub fn crash(&self) -> Option<Crash> {
        self.shared.crash.get()
    }

    /// Stops training and stores frames that no checkpoint contains. The program offers to resume them
    /// at its next startup. Blocks until all earlier orders are executed. Windows then close.
    pub fn store(&self) -> Rescue {
        // An opening is no longer wanted, and its drive may never respond.
        self.shared.close();
        // Room for the answer, so that the thread need not wait for this one.
        let (sender, receiver) = sync_channel(1);
        self.send(WorkerOrder::Store(sender));
        // Without a time limit, because the program ends afterwards and loses what is unsaved. If the
        // thread has ended, the sender is gone too, and the crash states what was saved.
        match (receiver.recv(), self.crash()) {
            (Ok(rescue), _) => rescue,
            (Err(_), Some(crash)) => crash.rescue,
            (Err(_), None) => Rescue::Lost {
                frames: self.snapshot().files.unsaved_frames,
                problems: vec!["the training thread has ended".to_owned()],
            },
        }
    }

    /// Returns the time spent waiting for the current frame; `None` below 5 s.
    pub fn slow_frame(&self) -> Option<Duration> {
        let waited = self.snapshot().pace.unread_since?.elapsed();
        (waited >= SLOW_FRAME).then_some(waited)
    }
}

impl Drop for Worker {
    fn drop(&mut self) {
        // Closing the channel ends the loop of the thread, so it precedes the join.
        self.orders = None;
        self.shared.close();
        if let Some(thread) = self.thread.take() {
            // A panic of the thread was reported when it occurred.
            let _ = thread.join();
        }
    }
}

/// State shared by the training thread and the window.
#[derive(Default)]
pub struct Shared {
    pub snapshot: Mailbox<Arc<Snapshot>>,
    pub updates: SplatUpdates,
    pub thumbnails: TrainedThumbnails,
    pub crash: Mailbox<Option<Crash>>,
    /// Progress of the file being exported.
    pub file: Progress,
    pub opening: Progress,
    is_closing: AtomicBool,
    interval_us: AtomicU64,
    n_numbered: AtomicU64,
}

// Relaxed throughout: no other memory depends on the values.
impl Shared {
    /// Returns the minimum time between two snapshots.
    pub fn interval(&self) -> Duration {
        Duration::from_micros(self.interval_us.load(Ordering::Relaxed))
    }

    pub fn set_interval(&self, interval: Duration) {
        // 64 bits hold any interval in microseconds.
        self.interval_us.store(interval.as_micros() as u64, Ordering::Relaxed);
    }

    /// Returns an unused file number. The first number is 1.
    pub fn new_number(&self) -> u64 {
        self.n_numbered.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// Cancels the opening in progress and all later ones, because the program ends.
    pub fn close(&self) {
        self.is_closing.store(true, Ordering::Relaxed);
    }

    pub fn is_opening_wanted(&self) -> bool {
        self.opening.is_wanted() && !self.is_closing.load(Ordering::Relaxed)
    }
}
