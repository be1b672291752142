//! Limits the CPU time for drawing during training when no GPU draws.
//!
//! The cost of a pass is the CPU time of all drawing threads until the next pass: egui, the software driver
//! of the window, and the renderer of the scene. The mean of recent passes determines the interval between
//! passes that keeps drawing within its share, and the size of the picture.

use super::thread_times::ThreadTimes;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

/// Shares of all cores that the user can choose.
pub const SHARES: RangeInclusive<f32> = 0.05..=0.5;
pub const DEFAULT_SHARE: f32 = 0.2;
/// Resolution range during training, as a fraction of the viewport's width and height.
const SCALES: RangeInclusive<f64> = 0.25..=0.5;
/// Target rate of pictures while the camera moves, per second. The resolution is reduced to reach it.
const TARGET_PICTURES_PER_S: f64 = 10.0;
/// Weight of the newest pass in the running mean.
const NEWEST_WEIGHT: f64 = 0.2;
/// Least cost assumed for a pass, core seconds. It covers work not measured here (display server, driver
/// queue) and limits two cores to about a dozen pictures a second, so that training keeps its time.
const LEAST_PASS_S: f64 = 0.036;
/// Longest pause before a pass while the camera moves. Longer pauses would make every control sluggish, so
/// beyond it the budget is exceeded instead.
const LONGEST_PAUSE: Duration = Duration::from_millis(200);

/// Measured cost of passes and pictures, with the resulting interval and resolution.
#[derive(Debug)]
pub struct DrawBudget {
    /// Share of all cores allowed for drawing (a setting).
    pub share: f32,
    cores: f64,
    times: ThreadTimes,
    /// Start of the last pass, and the drawing threads' CPU time at that moment.
    last: Option<(Instant, Option<Duration>)>,
    /// Running mean of the cost of a pass, core seconds.
    pass_s: f64,
    /// Running mean of the cost of a picture at the current scale while the camera moves, core seconds.
    picture_s: f64,
    /// Running mean of the time between passes, seconds.
    interval_s: f64,
    scale: f64,
}

impl Default for DrawBudget {
    fn default() -> Self {
        let cores = std::thread::available_parallelism().map_or(1.0, |n| n.get() as f64);
        Self {
            share: DEFAULT_SHARE,
            cores,
            times: ThreadTimes::default(),
            last: None,
            pass_s: 0.0,
            picture_s: 0.0,
            interval_s: 0.0,
            scale: *SCALES.end(),
        }
    }
}

impl DrawBudget {
    /// Records the start of a pass that begins after `pause`.
    pub fn begin_pass(&mut self, pause: Duration) {
        let (now, worked) = (Instant::now() + pause, self.times.drawing());
        if let Some((before, worked_before)) = self.last.replace((now, worked)) {
            let apart = now - before;
            // If the system reports no thread times, only the cost of the pictures is known.
            let work = worked.zip(worked_before).map(|(now, before)| now.saturating_sub(before));
            let work_s = work.map_or(self.picture_s, |work| work.as_secs_f64());
            update_mean(&mut self.pass_s, work_s);
            update_mean(&mut self.interval_s, apart.as_secs_f64());
        }
    }

    /// Records the CPU time of a picture at `scale`; adapts the scale.
    pub fn note_picture(&mut self, ms: f64, scale: f64) {
        update_mean(&mut self.picture_s, 1e-3 * ms * (self.scale / scale).powi(2));
        // Half of the budget belongs to the window. The cost of a picture grows with the squared scale.
        let wanted_s = 0.5 * self.allowed_cores() / TARGET_PICTURES_PER_S;
        let fitting = self.scale * (wanted_s / self.picture_s.max(1e-6)).sqrt();
        let fitting = fitting.clamp(*SCALES.start(), *SCALES.end());
        // Small changes of the resolution would be visible as flicker.
        if (fitting / self.scale - 1.0).abs() > 0.2 || fitting == *SCALES.end() {
            self.picture_s *= (fitting / self.scale).powi(2);
            self.scale = fitting;
        }
    }

    /// Resolution of a picture during training, as a fraction of the viewport's. A camera at rest gets the
    /// largest, since its pictures are rare.
    pub fn scale(&self, moving: bool) -> f64 {
        if moving { self.scale } else { *SCALES.end() }
    }

    /// Interval between passes that keeps drawing within its share.
    pub fn interval(&self) -> Duration {
        if self.pass_s == 0.0 {
            return Duration::ZERO; // nothing is measured yet
        }
        Duration::from_secs_f64((self.pass_s.max(LEAST_PASS_S) / self.allowed_cores()).min(10.0))
    }

    /// Time to wait before the next pass while the camera moves.
    pub fn pause_before_pass(&self) -> Duration {
        let since = self.last.map_or(Duration::MAX, |(begun, _)| begun.elapsed());
        self.interval().min(LONGEST_PAUSE).saturating_sub(since)
    }

    /// Share of all cores recently used for drawing.
    pub fn used_share(&self) -> f64 {
        if self.interval_s > 0.0 { self.pass_s / self.interval_s / self.cores } else { 0.0 }
    }

    /// Number of cores allowed for drawing.
    fn allowed_cores(&self) -> f64 {
        f64::from(self.share.clamp(*SHARES.start(), *SHARES.end())) * self.cores
    }
}

fn update_mean(of: &mut f64, newest: f64) {
    *of = if *of == 0.0 { newest } else { *of + NEWEST_WEIGHT * (newest - *of) };
}

#[cfg(test)]
mod tests {
    use super::*;

    fn budget(share: f32) -> DrawBudget {
        DrawBudget { share, cores: 2.0, ..DrawBudget::default() }
    }

    #[test]
    fn passes_are_as_far_apart_as_their_work_asks_for() {
        let mut budget = budget(0.25);
        assert_eq!(budget.interval(), Duration::ZERO, "nothing is measured yet");
        (budget.pass_s, budget.interval_s) = (0.05, 0.25);
        assert_eq!(budget.interval(), Duration::from_millis(100));
        assert!((budget.used_share() - 0.1).abs() < 1e-9);
        budget.share = 0.5;
        assert_eq!(budget.interval(), Duration::from_millis(50));
        budget.pass_s = 0.001;
        assert_eq!(budget.interval(), Duration::from_millis(36), "the least cost applies");
        budget.share = f32::NAN;
        assert!(budget.interval() <= Duration::from_secs(10));
    }

    #[test]
    fn pictures_shrink_until_they_fit_and_grow_again() {
        let mut budget = budget(0.2);
        let draw = |budget: &mut DrawBudget, ms_at_full: f64| {
            for _ in 0..60 {
                let scale = budget.scale(true);
                budget.note_picture(ms_at_full * scale * scale, scale);
            }
            budget.scale(true)
        };
        assert_eq!(draw(&mut budget, 40.0), 0.5);
        let small = draw(&mut budget, 200.0);
        assert!((0.25..0.4).contains(&small), "{small}");
        assert_eq!(draw(&mut budget, 5000.0), 0.25, "the smallest scale applies");
        assert_eq!(draw(&mut budget, 10.0), 0.5);
    }
}
