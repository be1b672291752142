//! The program is asked to end from outside: a session that is logged out of, a machine that is shut
//! down, a terminal that is closed.

use super::worker::Worker;
use std::sync::Arc;
use std::time::Duration;

/// How long the watcher outlives the worker at most.
const LOOK: Duration = Duration::from_secs(10);

/// From the moment `is_asked`, which waits for that at most so long, says so: what is trained is kept where the
/// next window offers it, training stops and the window closes without asking. Watches as long as the worker
/// lives.
///
/// # Errors
/// There is no thread to watch.
pub fn watch(
    is_asked: impl Fn(Duration) -> bool + Send + 'static,
    worker: &Arc<Worker>,
) -> std::io::Result<()> {
    let worker = Arc::downgrade(worker);
    let watcher = std::thread::Builder::new().name("termination".into());
    watcher.spawn(move || {
        // Not held while nothing is asked: whoever drops the worker waits for its thread.
        while worker.strong_count() > 0 {
            if is_asked(LOOK) {
                if let Some(worker) = worker.upgrade() {
                    // What became of it is said by a notice, which is logged.
                    let _ = worker.leave_behind();
                }
                return;
            }
        }
    })?;
    Ok(())
}
