//! What drawing may take of the cores while frames are trained, where no GPU draws.
//!
//! A pass of the window costs what the threads that draw worked from its beginning to the next one's: egui,
//! the driver that draws the window on the cores, and the picture of the scene. From the mean of the latest
//! passes follows how long passes must be apart for drawing to stay within its share, and how large the
//! picture may be.

use super::thread_times::ThreadTimes;
use std::ops::RangeInclusive;
use std::time::{Duration, Instant};

/// Shares of all cores that can be chosen.
pub const SHARES: RangeInclusive<f32> = 0.05..=0.5;
/// Share unless another is chosen.
pub const DEFAULT_SHARE: f32 = 0.2;
/// Sizes of pictures beside training, of the viewport's in each direction.
const SCALES: RangeInclusive<f64> = 0.25..=0.5;
/// Pictures a second that a moving camera should have; their size gives way to that.
const WANTED_PER_S: f64 = 10.0;
/// Weight of the newest pass in the mean.
const NEWEST: f64 = 0.2;
/// Least that a pass counts as, s of a core: the display server and the driver's queue work for it too, which
/// nothing here sees, and more than a dozen pictures a second of two cores are not worth training's time.
const LEAST_PASS_S: f64 = 0.036;
/// Longest pause before a pass of a moving camera: longer ones would be felt in every control, so beyond
/// it a budget is exceeded.
const LONGEST_PAUSE: Duration = Duration::from_millis(200);

/// What a pass and a picture cost, and what follows.
#[derive(Debug)]
pub struct DrawBudget {
    /// Share of all cores, a setting.
    pub share: f32,
    cores: f64,
    times: ThreadTimes,
    /// When the last pass began, and what had been worked then.
    last: Option<(Instant, Option<Duration>)>,
    /// Mean work of a pass, s of a core.
    pass_s: f64,
    /// Mean work of a picture of a moving camera, at the scale of now, s of a core.
    picture_s: f64,
    /// Mean time between passes, s.
    apart_s: f64,
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
            apart_s: 0.0,
            scale: *SCALES.end(),
        }
    }
}

impl DrawBudget {
    /// Notes that a pass begins after a pause.
    pub fn begin_pass(&mut self, pause: Duration) {
        let (now, worked) = (Instant::now() + pause, self.times.drawing());
        if let Some((before, worked_before)) = self.last.replace((now, worked)) {
            let apart = now - before;
            // Where the system does not tell, the pictures alone are known.
            let work = worked.zip(worked_before).map(|(now, before)| now.saturating_sub(before));
            let work_s = work.map_or(self.picture_s, |work| work.as_secs_f64());
            mean(&mut self.pass_s, work_s);
            mean(&mut self.apart_s, apart.as_secs_f64());
        }
    }

    /// Notes what a picture of a scale has taken of one core.
    pub fn note_picture(&mut self, ms: f64, scale: f64) {
        mean(&mut self.picture_s, 1e-3 * ms * (self.scale / scale).powi(2));
        // Half of what there is for a pass is the window's. Pixels grow with the square of the scale.
        let wanted_s = 0.5 * self.allowed() / WANTED_PER_S;
        let fitting = self.scale * (wanted_s / self.picture_s.max(1e-6)).sqrt();
        let fitting = fitting.clamp(*SCALES.start(), *SCALES.end());
        // Small changes would be seen as flicker.
        if (fitting / self.scale - 1.0).abs() > 0.2 || fitting == *SCALES.end() {
            self.picture_s *= (fitting / self.scale).powi(2);
            self.scale = fitting;
        }
    }

    /// Scale of a picture beside training, of the viewport's size in each direction: the largest for a
    /// camera that rests, of which pictures come seldom.
    pub fn scale(&self, moving: bool) -> f64 {
        if moving { self.scale } else { *SCALES.end() }
    }

    /// How long passes must be apart for drawing to stay within its share.
    pub fn interval(&self) -> Duration {
        if self.pass_s == 0.0 {
            return Duration::ZERO; // nothing is known yet
        }
        Duration::from_secs_f64((self.pass_s.max(LEAST_PASS_S) / self.allowed()).min(10.0))
    }

    /// What to wait before a pass for a camera that moves.
    pub fn pause(&self) -> Duration {
        let since = self.last.map_or(Duration::MAX, |(begun, _)| begun.elapsed());
        self.interval().min(LONGEST_PAUSE).saturating_sub(since)
    }

    /// The share of all cores that drawing took of late.
    pub fn taken(&self) -> f64 {
        if self.apart_s > 0.0 { self.pass_s / self.apart_s / self.cores } else { 0.0 }
    }

    /// Cores that drawing may keep busy.
    fn allowed(&self) -> f64 {
        f64::from(self.share.clamp(*SHARES.start(), *SHARES.end())) * self.cores
    }
}

fn mean(of: &mut f64, newest: f64) {
    *of = if *of == 0.0 { newest } else { *of + NEWEST * (newest - *of) };
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
        assert_eq!(budget.interval(), Duration::ZERO, "nothing is known yet");
        (budget.pass_s, budget.apart_s) = (0.05, 0.25);
        assert_eq!(budget.interval(), Duration::from_millis(100));
        assert!((budget.taken() - 0.1).abs() < 1e-9);
        budget.share = 0.5;
        assert_eq!(budget.interval(), Duration::from_millis(50));
        budget.pass_s = 0.001;
        assert_eq!(budget.interval(), Duration::from_millis(36), "as if it took more");
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
        assert_eq!(draw(&mut budget, 5000.0), 0.25, "never too small to see anything");
        assert_eq!(draw(&mut budget, 10.0), 0.5);
    }
}
