//! CPU time of the window's thread per egui pass, as measured by the operating system; logged for tests.

use super::state::RunState;
use std::time::{Duration, Instant};

/// Returns the CPU time of the calling thread since its start; `None` except on Linux.
fn thread_time() -> Option<Duration> {
    // The first number of `schedstat` is in nanoseconds.
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    text.split_whitespace().next()?.parse().ok().map(Duration::from_nanos)
}

#[derive(Default)]
pub struct PassTimes {
    is_drawn: bool,
    state: RunState,
    /// CPU time of this thread at the start of the latest egui pass, and at the end of the pass's layout.
    worked: Option<Duration>,
    laid_out: Option<Duration>,
    /// CPU time of each egui pass during training, milliseconds. The first number covers the whole pass,
    /// the second only the layout, without tessellation and the graphics driver.
    passes: Vec<[f64; 2]>,
}

impl PassTimes {
    pub fn begin(&mut self, state: RunState) {
        // Reading `schedstat` costs a system call in every pass.
        if !tracing::enabled!(tracing::Level::DEBUG) {
            return;
        }
        let now = thread_time();
        if let (RunState::Training, Some(before), Some(now)) = (self.state, self.worked, now) {
            let ms = |end: Duration| 1e3 * end.saturating_sub(before).as_secs_f64();
            let layout = self.laid_out.take().map_or(0.0, ms);
            self.passes.push([ms(now), layout]);
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

    /// Records the end of the layout of an egui pass. `started` is the start time of the program.
    pub fn end(&mut self, started: Instant) {
        if !self.is_drawn {
            self.is_drawn = true;
            tracing::info!("window after {} ms", started.elapsed().as_millis());
        }
        if tracing::enabled!(tracing::Level::DEBUG) {
            self.laid_out = thread_time();
        }
    }

    fn log_times(&mut self) {
        let passes = std::mem::take(&mut self.passes);
        let [all, layout] = [0, 1].map(|part| passes.iter().map(|pass| pass[part]).collect());
        if let (Some((median, most)), Some((_, layout))) = (figures(all), figures(layout)) {
            tracing::debug!(
                "passes {}: median_ms {median:.2} p99_ms {most:.2} layout_p99_ms {layout:.2}",
                passes.len()
            );
        }
    }
}

/// Returns the median and the 99th percentile of `ms`; `None` if it is empty.
fn figures(mut ms: Vec<f64>) -> Option<(f64, f64)> {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms.get((share * ms.len() as f64) as usize).or(ms.last()).copied();
    at(0.5).zip(at(0.99))
}
