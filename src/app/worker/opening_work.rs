//! Work that opens a subject, on a separate thread.

use crate::app::panic_report::PanicReport;
use crate::pipeline::drive_work::DriveWork;
use std::thread;

/// Starts work that opens a subject.
///
/// # Errors
/// If no thread can be started.
pub(super) fn start_opening<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<DriveWork<T>, String> {
    let n_threads = rayon::current_num_threads();
    let reads = move || {
        // In its own pool: a thread of the global pool that never returns would be missing for training
        // and drawing.
        match rayon::ThreadPoolBuilder::new().num_threads(n_threads).build() {
            Ok(pool) => pool.install(work),
            Err(_) => work(),
        }
    };
    DriveWork::start("opening", reads)
        .map_err(|error| format!("{name}: starting the thread that opens it failed: {error}"))
}

/// Result of the work, or the notice about its panic.
pub(super) fn join_opening<T>(name: &str, ended: thread::Result<T>) -> Result<T, String> {
    ended.map_err(|panic| {
        format!("{name}: {}", PanicReport::of(&*panic).failure_notice("opening it"))
    })
}
