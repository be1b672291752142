//! Message and location of a panic.
//!
//! A caught panic carries its message but not its location, which only the panic hook receives. The
//! hook therefore records both, and the catcher finds the location by the message. Records cannot be
//! found by thread, because rayon passes panics from its threads to the caller.

use std::any::Any;
use std::collections::VecDeque;
use std::fmt;
use std::panic::PanicHookInfo;
use std::sync::{Mutex, Once, PoisonError};

/// Maximum number of recorded panics.
// More than one, because image decoders also panic and are caught, on several threads at once.
const MAX_NOTED: usize = 8;

/// Latest panics, oldest first.
static NOTED: Mutex<VecDeque<PanicReport>> = Mutex::new(VecDeque::new());

/// Message and location of a panic.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub struct PanicReport {
    /// Message of the panic.
    pub message: String,
    /// `file:line:column`, if known.
    pub place: Option<String>,
}

impl fmt::Display for PanicReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.place {
            Some(place) => write!(f, "{} ({place})", self.message),
            None => write!(f, "{}", self.message),
        }
    }
}

impl PanicReport {
    /// Installs a panic hook that records panics and then calls the previous hook.
    pub fn install_hook() {
        static ONCE: Once = Once::new();
        // Every window's worker calls this, and each further hook would record every panic again.
        ONCE.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |panic| {
                note(panic);
                before(panic);
            }));
        });
    }

    /// Returns a notice for the user that a panic ended the task `what`, which runs beside training.
    pub fn failure_notice(&self, what: &str) -> String {
        format!(
            "{what} failed because of a bug in this program, please report it: {self}; nothing else is affected"
        )
    }

    /// Finds the recorded report of a panic from its caught payload. Without a record, the location is
    /// unknown.
    pub fn of(payload: &(dyn Any + Send)) -> Self {
        let message = message(payload);
        let noted = NOTED.lock().unwrap_or_else(PoisonError::into_inner);
        // Newest first, because an earlier panic elsewhere may have the same message.
        let known = noted.iter().rev().find(|report| report.message == message);
        known.cloned().unwrap_or(Self { message, place: None })
    }
}

fn note(panic: &PanicHookInfo<'_>) {
    let place = panic.location().map(ToString::to_string);
    let report = PanicReport { message: message(panic.payload()), place };
    // A poisoned lock is accepted: a panic in the hook would abort the program before anything is saved.
    let mut noted = NOTED.lock().unwrap_or_else(PoisonError::into_inner);
    if noted.len() == MAX_NOTED {
        noted.pop_front();
    }
    noted.push_back(report);
}

fn message(payload: &(dyn Any + Send)) -> String {
    // `panic!` carries a `&str` for a literal message, else a `String`.
    let text = payload.downcast_ref::<&str>().copied();
    let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
    text.unwrap_or("no message").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::catch_unwind;

    #[test]
    fn message_and_place_are_known_even_of_another_threads_panic() {
        PanicReport::install_hook();
        let here = catch_unwind(|| panic!("report test: {}", 7)).unwrap_err();
        let report = PanicReport::of(&*here);
        assert_eq!(report.message, "report test: 7");
        assert!(report.place.unwrap().contains("panic_report.rs:"), "where");
        let there = std::thread::spawn(|| panic!("report test: thread")).join().unwrap_err();
        let report = PanicReport::of(&*there);
        assert!(report.to_string().starts_with("report test: thread (src"), "{report}");
        let odd = catch_unwind(|| std::panic::panic_any(7_u8)).unwrap_err();
        assert_eq!(PanicReport::of(&*odd).message, "no message");
    }
}
