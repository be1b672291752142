//! Processor time of the threads that draw, as the system counts it.
//!
//! A window that a software adapter draws is drawn by threads of the driver, which no clock of ours sees.
//! Linux counts the time of every thread, and drivers name theirs.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// Names of threads that draw begin so: the driver's, the window's own and those of pictures.
const DRAWING: [&str; 3] = ["llvmpipe", "drawing", "WSI"];

/// Tells how long threads that draw have worked.
#[derive(Debug)]
pub struct ThreadTimes {
    /// Whether a thread of this number draws.
    known: BTreeMap<u32, bool>,
    process: u32,
}

impl Default for ThreadTimes {
    fn default() -> Self {
        Self { known: BTreeMap::new(), process: std::process::id() }
    }
}

impl ThreadTimes {
    /// The processor time of all threads that draw, since they began; `None` where the system does not
    /// tell it.
    pub fn drawing(&mut self) -> Option<Duration> {
        let tasks = std::fs::read_dir("/proc/self/task").ok()?;
        let mut sum = Duration::ZERO;
        for task in tasks.flatten() {
            let Some(number) = task.file_name().to_str().and_then(|name| name.parse().ok()) else {
                continue;
            };
            let is_window = number == self.process;
            let draws =
                self.known.entry(number).or_insert_with(|| is_window || draws(&task.path()));
            if *draws {
                // A thread may end between being listed and being read.
                sum += worked(&task.path()).unwrap_or_default();
            }
        }
        (!sum.is_zero()).then_some(sum)
    }
}

/// The processor time of the thread that asks, since it began; `None` where the system does not tell it.
pub fn own() -> Option<Duration> {
    worked(Path::new("/proc/thread-self"))
}

fn draws(task: &Path) -> bool {
    let name = std::fs::read_to_string(task.join("comm")).unwrap_or_default();
    DRAWING.iter().any(|start| name.starts_with(start))
}

/// Time on a core, the first number of `schedstat`, ns.
fn worked(task: &Path) -> Option<Duration> {
    let text = std::fs::read_to_string(task.join("schedstat")).ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}

#[cfg(all(test, target_os = "linux"))]
mod tests {
    use super::*;
    use std::hint::black_box;
    use std::time::Instant;

    #[test]
    fn work_of_drawing_threads_is_counted_and_that_of_others_is_not() {
        let work = || {
            let begun = Instant::now();
            while begun.elapsed() < Duration::from_millis(60) {
                black_box(begun);
            }
        };
        let named = |name: &str| std::thread::Builder::new().name(name.into()).spawn(work).unwrap();
        let mut times = ThreadTimes::default();
        let before = times.drawing();
        named("trainer").join().unwrap();
        let (sender, ended) = std::sync::mpsc::channel::<()>();
        let drawing = std::thread::Builder::new().name("drawing".into());
        let thread = drawing.spawn(move || {
            work();
            let _ = ended.recv();
        });
        // The thread is counted while it lives.
        let begun = Instant::now();
        let least = Duration::from_millis(5);
        let spent = |times: &mut ThreadTimes| {
            times.drawing().unwrap_or_default().saturating_sub(before.unwrap_or_default())
        };
        while spent(&mut times) < least {
            assert!(begun.elapsed() < Duration::from_secs(60), "nothing is counted");
            std::thread::sleep(Duration::from_millis(5));
        }
        drop(sender);
        thread.unwrap().join().unwrap();
    }
}
