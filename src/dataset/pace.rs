//! Poll rate for a growing recording. Times are relative to an arbitrary start; the caller provides the
//! clock.

use std::collections::VecDeque;
use std::time::Duration;

/// Minimum time between two checks for changes; shorter than the interval between two camera frames.
const TICK: Duration = Duration::from_millis(20);
/// Minimum time between polls while folders and lists do not change. Such polls may find a file that
/// became complete.
const RETRY: Duration = Duration::from_millis(50);
/// Time without a new frame after which polling slows down.
const QUIET: Duration = Duration::from_secs(10);
const QUIET_TICK: Duration = Duration::from_millis(100);
const QUIET_RETRY: Duration = Duration::from_secs(1);
/// Number of recent polls from which the duration of the next one is estimated.
const LATEST: usize = 8;
/// Polls take at most the fraction 1/`SHARE` of the time.
const SHARE: u32 = 20;

/// Schedule of the polls of a growing recording.
#[derive(Default)]
pub struct PollSchedule {
    last_check: Option<Duration>,
    last_poll: Option<Duration>,
    costs: VecDeque<Duration>,
    last_growth: Duration,
}

impl PollSchedule {
    /// Returns the time until the next check for changes is due.
    pub fn time_to_next_check(&self, now: Duration) -> Duration {
        let tick = if self.is_quiet(now) { QUIET_TICK } else { TICK };
        let left = |least: Duration, since: Option<Duration>| {
            // Saturates once the time has passed: the check is due at once.
            since.map_or(Duration::ZERO, |since| (since + least).saturating_sub(now))
        };
        // The fastest recent poll: slower ones were delayed by other load.
        let cost = self.costs.iter().min().copied().unwrap_or_default();
        left(tick, self.last_check).max(left(SHARE * cost, self.last_poll))
    }

    /// Records that a check for changes was made.
    pub fn record_check(&mut self, now: Duration) {
        self.last_check = Some(now);
    }

    /// True if a poll is due although no folder or list has changed. The poll may find a file that
    /// became complete.
    pub fn is_retry_due(&self, now: Duration) -> bool {
        let retry = if self.is_quiet(now) { QUIET_RETRY } else { RETRY };
        self.last_poll.is_none_or(|polled| now >= polled + retry)
    }

    /// Records the start and end of a poll, and whether it found frames.
    pub fn record_poll(&mut self, begun: Duration, now: Duration, has_grown: bool) {
        self.last_poll = Some(now);
        if self.costs.len() == LATEST {
            self.costs.pop_front();
        }
        self.costs.push_back(now.saturating_sub(begun));
        if has_grown {
            self.last_growth = now;
        }
    }

    fn is_quiet(&self, now: Duration) -> bool {
        now > self.last_growth + QUIET
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_take_a_twentieth_of_the_time_at_most() {
        let ms = Duration::from_millis;
        let mut pace = PollSchedule::default();
        assert_eq!(pace.time_to_next_check(ms(0)), ms(0), "the first is at once");
        pace.record_check(ms(0));
        assert!(pace.is_retry_due(ms(0)));
        pace.record_poll(ms(0), ms(1), true);
        assert_eq!(pace.time_to_next_check(ms(1)), ms(20), "a quick one: the next tick");
        pace.record_poll(ms(60), ms(110), true);
        assert_eq!(pace.time_to_next_check(ms(110)), ms(20), "it was interrupted");
        for _ in 0..LATEST {
            pace.record_poll(ms(100), ms(110), true);
        }
        assert_eq!(pace.time_to_next_check(ms(110)), ms(200), "looks have become slow");
        assert!(!pace.is_retry_due(ms(159)) && pace.is_retry_due(ms(160)));
        // A long time without new frames.
        pace.record_check(ms(20_000));
        assert_eq!(pace.time_to_next_check(ms(20_000)), ms(100));
        pace.record_poll(ms(20_000), ms(20_000), false);
        assert!(!pace.is_retry_due(ms(20_500)) && pace.is_retry_due(ms(21_000)));
    }
}
