//! How often a recording that grows is looked at. Times are those since any beginning: whoever looks
//! has the clock.

use std::collections::VecDeque;
use std::time::Duration;

/// Least time between two questions whether a look is worth it: less than a frame of a camera.
const TICK: Duration = Duration::from_millis(20);
/// Time between two looks for what no folder or list tells of, such as a file that was half there.
const RETRY: Duration = Duration::from_millis(50);
/// After so long without a frame nothing is in a hurry.
const QUIET: Duration = Duration::from_secs(10);
const QUIET_TICK: Duration = Duration::from_millis(100);
const QUIET_RETRY: Duration = Duration::from_secs(1);
/// Looks that tell what the next one takes.
const LATEST: usize = 8;
/// A look may take so small a part of the time.
const SHARE: u32 = 20;

/// When a recording was looked at.
#[derive(Default)]
pub struct LookPace {
    asked: Option<Duration>,
    looked: Option<Duration>,
    /// Of the latest looks, as far as there were so many.
    costs: VecDeque<Duration>,
    grown: Duration,
}

impl LookPace {
    /// Time until the next question.
    pub fn rest(&self, now: Duration) -> Duration {
        let tick = if self.is_quiet(now) { QUIET_TICK } else { TICK };
        let left = |least: Duration, since: Option<Duration>| {
            since.map_or(Duration::ZERO, |since| (since + least).saturating_sub(now))
        };
        // Of the quickest: the others were interrupted by whatever else the machine does.
        let cost = self.costs.iter().min().copied().unwrap_or_default();
        left(tick, self.asked).max(left(SHARE * cost, self.looked))
    }

    /// The question is asked.
    pub fn ask(&mut self, now: Duration) {
        self.asked = Some(now);
    }

    /// Whether it is worth a look that something may have changed that no folder or list tells of.
    pub fn retries(&self, now: Duration) -> bool {
        let retry = if self.is_quiet(now) { QUIET_RETRY } else { RETRY };
        self.looked.is_none_or(|looked| now >= looked + retry)
    }

    /// A look was made, and whether it found frames.
    pub fn looked(&mut self, begun: Duration, now: Duration, has_grown: bool) {
        self.looked = Some(now);
        if self.costs.len() == LATEST {
            self.costs.pop_front();
        }
        self.costs.push_back(now.saturating_sub(begun));
        if has_grown {
            self.grown = now;
        }
    }

    fn is_quiet(&self, now: Duration) -> bool {
        now > self.grown + QUIET
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_take_a_twentieth_of_the_time_at_most() {
        let ms = Duration::from_millis;
        let mut pace = LookPace::default();
        assert_eq!(pace.rest(ms(0)), ms(0), "the first is at once");
        pace.ask(ms(0));
        assert!(pace.retries(ms(0)));
        pace.looked(ms(0), ms(1), true);
        assert_eq!(pace.rest(ms(1)), ms(20), "a quick one: the next tick");
        pace.looked(ms(60), ms(110), true);
        assert_eq!(pace.rest(ms(110)), ms(20), "it was interrupted");
        for _ in 0..LATEST {
            pace.looked(ms(100), ms(110), true);
        }
        assert_eq!(pace.rest(ms(110)), ms(200), "looks have become slow");
        assert!(!pace.retries(ms(159)) && pace.retries(ms(160)));
        // Nothing came for long.
        pace.ask(ms(20_000));
        assert_eq!(pace.rest(ms(20_000)), ms(100));
        pace.looked(ms(20_000), ms(20_000), false);
        assert!(!pace.retries(ms(20_500)) && pace.retries(ms(21_000)));
    }
}
