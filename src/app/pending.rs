//! What waits until unsaved training is dealt with: opening something else, starting over, closing.

use super::state::WriteOutcome;
use super::worker::WorkerOrder;

/// What goes ahead then.
#[derive(Clone, Debug)]
pub enum Continuation {
    /// The worker is given an order.
    Send(WorkerOrder),
    /// The window closes.
    Close,
}

/// How far the user and the files are with what waits.
#[derive(Clone, Debug)]
pub enum Pending {
    /// The user is asked what shall become of the training.
    Asking(Continuation),
    /// The user is asked for a file's name.
    Naming(Continuation),
    /// The file with this number is being written.
    Writing(Continuation, u64),
}

/// What follows from the news of a file.
#[derive(Debug)]
pub enum AfterWrite {
    /// Nothing yet.
    Wait(Pending),
    /// What waited goes ahead.
    GoAhead(Continuation),
    /// What waited is given up, since the file was not written.
    GiveUp,
}

impl Pending {
    /// Something else waits now, as far along as this is.
    pub fn instead(self, next: Continuation) -> Self {
        match self {
            Self::Asking(_) => Self::Asking(next),
            Self::Naming(_) => Self::Naming(next),
            Self::Writing(_, number) => Self::Writing(next, number),
        }
    }

    /// The user has named the file, which gets this number.
    pub fn named(self, number: u64) -> Self {
        match self {
            Self::Naming(next) => Self::Writing(next, number),
            other => other,
        }
    }

    /// Looks whether the file that is waited for was written.
    pub fn after(self, latest: Option<WriteOutcome>) -> AfterWrite {
        match (self, latest) {
            (Self::Writing(next, number), Some(outcome)) if outcome.number == number => {
                if outcome.is_written { AfterWrite::GoAhead(next) } else { AfterWrite::GiveUp }
            }
            (waiting, _) => AfterWrite::Wait(waiting),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(number: u64, is_written: bool) -> Option<WriteOutcome> {
        Some(WriteOutcome { number, is_written })
    }

    #[test]
    fn only_the_file_that_is_waited_for_decides() {
        let waiting = Pending::Naming(Continuation::Close).named(7);
        for other in [None, outcome(6, true), outcome(6, false)] {
            assert!(matches!(
                waiting.clone().after(other),
                AfterWrite::Wait(Pending::Writing(_, 7))
            ));
        }
        let done = waiting.clone().after(outcome(7, true));
        assert!(matches!(done, AfterWrite::GoAhead(Continuation::Close)));
        assert!(matches!(waiting.after(outcome(7, false)), AfterWrite::GiveUp));
        let asking = Pending::Asking(Continuation::Close).named(7);
        assert!(matches!(asking.after(outcome(7, true)), AfterWrite::Wait(Pending::Asking(_))));
    }

    #[test]
    fn closing_takes_the_place_of_what_waited() {
        let waiting = Pending::Writing(Continuation::Send(WorkerOrder::Reset), 3);
        let closing = waiting.instead(Continuation::Close).after(outcome(3, true));
        assert!(matches!(closing, AfterWrite::GoAhead(Continuation::Close)));
    }
}
