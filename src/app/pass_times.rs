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
    /// Time on a core of this thread when the latest pass began.
    worked: Option<Duration>,
    /// Of the passes while training, milliseconds.
    ms: Vec<f64>,
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
            self.ms.push(1e3 * now.saturating_sub(before).as_secs_f64());
        }
        self.worked = now;
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
    }

    fn tell(&mut self) {
        let mut ms = std::mem::take(&mut self.ms);
        ms.sort_by(f64::total_cmp);
        let at = |share: f64| ms.get((share * ms.len() as f64) as usize).or(ms.last());
        if let (Some(median), Some(most)) = (at(0.5), at(0.99)) {
            tracing::debug!("passes {}: median_ms {median:.2} p99_ms {most:.2}", ms.len());
        }
    }
}
