//! CPU time of the drawing threads, as counted by the operating system.
//!
//! A software adapter draws the window on threads of the driver, which the program cannot time itself.
//! Linux counts the CPU time of every thread, and drivers name their threads.

use super::state::RunState;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

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

/// Measures the passes of a window.
#[derive(Default)]
pub struct PassTimes {
    is_drawn: bool,
    state: RunState,
    /// CPU time of this thread at the start of the latest pass, and at the end of its layout.
    worked: Option<Duration>,
    laid_out: Option<Duration>,
    passes: Vec<PassMs>,
}

/// CPU time of a pass during training, milliseconds.
#[derive(Clone, Copy)]
struct PassMs {
    all: f64,
    /// Part of `all` until the end of the layout: without tessellation and the driver.
    layout: f64,
}

impl PassTimes {
    /// Starts a pass that shows `state`.
    pub fn begin(&mut self, state: RunState) {
        // The CPU time is queried only if the log records it.
        if !tracing::enabled!(tracing::Level::DEBUG) {
            return;
        }
        let now = current_thread_time();
        if let (RunState::Training, Some(before), Some(now)) = (self.state, self.worked, now) {
            let ms = |end: Duration| 1e3 * end.saturating_sub(before).as_secs_f64();
            let layout = self.laid_out.take().map_or(0.0, ms);
            self.passes.push(PassMs { all: ms(now), layout });
        }
        (self.worked, self.laid_out) = (now, None);
        if state == self.state {
            return;
        }
        tracing::debug!("shown: {}", state.label());
        if self.state == RunState::Training {
            self.log_times();
        }
        self.state = state;
    }

    /// Ends the layout of a pass; `started` is the start of the program.
    pub fn end(&mut self, started: Instant) {
        if !self.is_drawn {
            self.is_drawn = true;
            tracing::info!("window after {} ms", started.elapsed().as_millis());
        }
        if tracing::enabled!(tracing::Level::DEBUG) {
            self.laid_out = current_thread_time();
        }
    }

    fn log_times(&mut self) {
        let passes = std::mem::take(&mut self.passes);
        let [all, layout] = [|pass: &PassMs| pass.all, |pass: &PassMs| pass.layout]
            .map(|part| passes.iter().map(part).collect::<Vec<_>>());
        if let (Some((median, most)), Some((_, layout))) = (figures(all), figures(layout)) {
            tracing::debug!(
                "passes {}: median_ms {median:.2} p99_ms {most:.2} layout_p99_ms {layout:.2}",
                passes.len()
            );
        }
    }
}

/// Median and 99th percentile.
fn figures(mut ms: Vec<f64>) -> Option<(f64, f64)> {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms.get((share * ms.len() as f64) as usize).or(ms.last()).copied();
    at(0.5).zip(at(0.99))
}
