//! Termination of the program from outside: logout, shutdown, or a closed terminal.

use super::worker::Worker;
use std::sync::Arc;
use std::time::Duration;

/// Longest time for which the watcher outlives the worker.
const POLL_INTERVAL: Duration = Duration::from_secs(10);

/// Watches for a termination while the worker lives. `is_asked` waits for at most the given time and
/// returns true once the program is to end. Training is then stopped and stored for the next window,
/// and the window closes without a prompt.
///
/// # Errors
/// If no thread can be started.
pub fn watch(
    is_asked: impl Fn(Duration) -> bool + Send + 'static,
    worker: &Arc<Worker>,
) -> std::io::Result<()> {
    let worker = Arc::downgrade(worker);
    let watcher = std::thread::Builder::new().name("termination".into());
    watcher.spawn(move || {
        // The worker is not held meanwhile, because dropping it joins its thread.
        while worker.strong_count() > 0 {
            if is_asked(POLL_INTERVAL) {
                if let Some(worker) = worker.upgrade() {
                    // A notice, which is logged, states the outcome.
                    let _ = worker.store_for_next_window();
                }
                return;
            }
        }
    })?;
    Ok(())
}
