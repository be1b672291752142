//! When the window is there, what it is told, and what its passes take of its thread. Told by the log, which
//! the tests of the figures read (`tests/app/window.rs`, `journey.rs`).

use super::state::RunState;
use super::thread_times;
use std::time::{Duration, Instant};

/// Follows the passes of a window.
#[derive(Default)]
pub struct PassTimes {
    is_drawn: bool,
    state: RunState,
    /// Time on a core of this thread when the latest pass began, and when it was laid out.
    worked: Option<Duration>,
    laid_out: Option<Duration>,
    passes: Vec<PassMs>,
}

/// What a pass took of its thread while training, milliseconds of a core.
#[derive(Clone, Copy)]
struct PassMs {
    all: f64,
    /// Of that, until everything was laid out: the window's own work, without egui's triangles and the driver.
    layout: f64,
}

impl PassTimes {
    /// A pass begins, which shows this state.
    pub fn begin(&mut self, state: RunState) {
        // The system is asked for the time of the thread only where somebody reads it.
        if !tracing::enabled!(tracing::Level::DEBUG) {
            return;
        }
        let now = thread_times::own();
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
            self.tell();
        }
        self.state = state;
    }

    /// A pass of a program that began at `started` is laid out.
    pub fn end(&mut self, started: Instant) {
        if !self.is_drawn {
            self.is_drawn = true;
            tracing::info!("window after {} ms", started.elapsed().as_millis());
        }
        if tracing::enabled!(tracing::Level::DEBUG) {
            self.laid_out = thread_times::own();
        }
    }

    fn tell(&mut self) {
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

/// The median, and below what 99 % lie.
fn figures(mut ms: Vec<f64>) -> Option<(f64, f64)> {
    ms.sort_by(f64::total_cmp);
    let at = |share: f64| ms.get((share * ms.len() as f64) as usize).or(ms.last()).copied();
    at(0.5).zip(at(0.99))
}
