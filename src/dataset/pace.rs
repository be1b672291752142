//! Poll rate for a growing recording. Times are relative to an arbitrary start; the caller provides the
//! clock.

use std::collections::VecDeque;
use std::time::Duration;

/// Least time between two checks for changes: less than a camera's frame.
const TICK: Duration = Duration::from_millis(20);
/// Time between polls for changes that no folder or list shows, such as a file that was incomplete.
const RETRY: Duration = Duration::from_millis(50);
/// After this time without a new frame, polling slows down.
const QUIET: Duration = Duration::from_secs(10);
const QUIET_TICK: Duration = Duration::from_millis(100);
const QUIET_RETRY: Duration = Duration::from_secs(1);
/// Recent polls from which the cost of the next is estimated.
const LATEST: usize = 8;
/// Polls take at most one part in `SHARE` of the time.
const SHARE: u32 = 20;

/// Schedule of the polls.
#[derive(Default)]
pub struct LookPace {
    asked: Option<Duration>,
    looked: Option<Duration>,
    /// Durations of the latest polls, at most `LATEST`.
    costs: VecDeque<Duration>,
    grown: Duration,
}

impl LookPace {
    /// Time until the next check for changes.
    pub fn rest(&self, now: Duration) -> Duration {
        let tick = if self.is_quiet(now) { QUIET_TICK } else { TICK };
        let left = |least: Duration, since: Option<Duration>| {
            since.map_or(Duration::ZERO, |since| (since + least).saturating_sub(now))
        };
        // The fastest recent poll: slower ones were delayed by other load.
        let cost = self.costs.iter().min().copied().unwrap_or_default();
        left(tick, self.asked).max(left(SHARE * cost, self.looked))
    }

    /// Records that a check for changes was made.
    pub fn ask(&mut self, now: Duration) {
        self.asked = Some(now);
    }

    /// True if a poll is due for changes that no folder or list shows.
    pub fn retries(&self, now: Duration) -> bool {
        let retry = if self.is_quiet(now) { QUIET_RETRY } else { RETRY };
        self.looked.is_none_or(|looked| now >= looked + retry)
    }

    /// Records a poll: its start and end, and whether it found frames.
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
        // A long time without new frames.
        pace.ask(ms(20_000));
        assert_eq!(pace.rest(ms(20_000)), ms(100));
        pace.looked(ms(20_000), ms(20_000), false);
        assert!(!pace.retries(ms(20_500)) && pace.retries(ms(21_000)));
    }
}
