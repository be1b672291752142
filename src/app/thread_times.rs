//! CPU time of the drawing threads, as counted by the operating system.
//!
//! A software adapter draws the window on threads of the driver, which the program cannot time itself.
//! Linux counts the CPU time of every thread, and drivers name their threads.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

/// Name prefixes of the driver's threads, of those that render pictures, and of the window system's.
const DRAWING: [&str; 3] = ["llvmpipe", "drawing", "WSI"];

/// Sums the CPU time of drawing threads.
#[derive(Debug)]
pub struct ThreadTimes {
    /// Thread IDs, and whether each thread draws.
    known: BTreeMap<u32, bool>,
    process: u32,
}

impl Default for ThreadTimes {
    fn default() -> Self {
        Self { known: BTreeMap::new(), process: std::process::id() }
    }
}

impl ThreadTimes {
    /// CPU time of all drawing threads since their start; `None` if the system does not provide it.
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
                // A thread may end between listing and reading.
                sum += thread_time(&task.path()).unwrap_or_default();
            }
        }
        (!sum.is_zero()).then_some(sum)
    }
}

/// CPU time of the calling thread since its start; `None` if the system does not provide it.
pub fn current_thread_time() -> Option<Duration> {
    thread_time(Path::new("/proc/thread-self"))
}

fn draws(task: &Path) -> bool {
    let name = std::fs::read_to_string(task.join("comm")).unwrap_or_default();
    DRAWING.iter().any(|start| name.starts_with(start))
}

/// CPU time: the first number of `schedstat`, ns.
fn thread_time(task: &Path) -> Option<Duration> {
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
        // A thread is counted only while it lives.
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
