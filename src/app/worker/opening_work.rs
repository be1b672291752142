//! Work that opens something, on a thread of its own.

use crate::app::panic_report::PanicReport;
use crate::pipeline::drive_work::DriveWork;
use std::thread;

/// Begins work that opens something.
///
/// # Errors
/// There is no thread for it.
pub(super) fn start_opening<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<DriveWork<T>, String> {
    let n_threads = rayon::current_num_threads();
    let reads = move || {
        // A pool of its own: one thread of the common one that never came back would be missing for
        // training and drawing ever after.
        match rayon::ThreadPoolBuilder::new().num_threads(n_threads).build() {
            Ok(pool) => pool.install(work),
            Err(_) => work(),
        }
    };
    DriveWork::start("opening", reads)
        .map_err(|error| format!("{name}: no thread to open it on could be started: {error}"))
}

/// What opening something found, or what the user is told of its panic.
pub(super) fn opened<T>(name: &str, ended: thread::Result<T>) -> Result<T, String> {
    ended.map_err(|panic| format!("{name}: {}", PanicReport::of(&*panic).ended("opening it")))
}
