//! Actions that wait until unsaved training is handled: opening another subject, restarting, closing.

use super::state::WriteOutcome;
use super::worker::WorkerOrder;

/// Action that waits.
#[derive(Clone, Debug)]
pub enum Continuation {
    Send(WorkerOrder),
    Close,
}

/// Stage of a waiting action.
#[derive(Clone, Debug)]
pub enum Pending {
    /// The user is prompted about unsaved training.
    Asking(Continuation),
    /// The user is prompted for a file name.
    Naming(Continuation),
    /// The file with this number is being written.
    Writing(Continuation, u64),
}

/// Result of checking for a written file.
#[derive(Debug)]
pub enum AfterWrite {
    Wait(Pending),
    /// The action proceeds.
    GoAhead(Continuation),
    /// The action is dropped, because the file was not written.
    GiveUp,
}

impl Pending {
    /// Replaces the action; the stage remains.
    pub fn instead(self, next: Continuation) -> Self {
        match self {
            Self::Asking(_) => Self::Asking(next),
            Self::Naming(_) => Self::Naming(next),
            Self::Writing(_, number) => Self::Writing(next, number),
        }
    }

    /// Records that the user has named the file, whose number is `number`.
    pub fn named(self, number: u64) -> Self {
        match self {
            Self::Naming(next) => Self::Writing(next, number),
            other => other,
        }
    }

    /// Checks whether the awaited file was written.
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
