//! What a panic said and where it happened.
//!
//! Whoever catches a panic gets its message but not its place, which only the panic hook is told. The
//! hook therefore notes both, and the catcher looks the place up by the message: rayon carries panics
//! from its threads to the caller, so the thread is no key.

use crate::pipeline::panic_text::panic_text;
use std::any::Any;
use std::collections::VecDeque;
use std::fmt;
use std::panic::PanicHookInfo;
use std::sync::{Mutex, Once, PoisonError};

/// Panics noted. More than one, since decoders of images panic too, are caught and go on.
const MAX_NOTED: usize = 8;

/// The latest panics, oldest first.
static NOTED: Mutex<VecDeque<PanicReport>> = Mutex::new(VecDeque::new());

/// A panic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PanicReport {
    /// Its message.
    pub message: String,
    /// `file:line:column`, where known.
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
    /// Notes panics from now on, beside what the hook before does about them.
    pub fn listen() {
        static ONCE: Once = Once::new();
        // Every worker asks to listen; each further hook would note every panic once more.
        ONCE.call_once(|| {
            let before = std::panic::take_hook();
            std::panic::set_hook(Box::new(move |panic| {
                note(panic);
                before(panic);
            }));
        });
    }

    /// What the user reads where this ended `what`, a piece of work beside training.
    pub fn ended(&self, what: &str) -> String {
        format!(
            "{what} was ended by a defect of this program, please report it: {self}; nothing else was"
        )
    }

    /// The panic whose payload was caught.
    pub fn of(payload: &(dyn Any + Send)) -> Self {
        let message = message(payload);
        let noted = NOTED.lock().unwrap_or_else(PoisonError::into_inner);
        // From the latest on: the same words may have been said before, somewhere else.
        let known = noted.iter().rev().find(|report| report.message == message);
        known.cloned().unwrap_or(Self { message, place: None })
    }
}

fn note(panic: &PanicHookInfo<'_>) {
    let place = panic.location().map(ToString::to_string);
    let report = PanicReport { message: message(panic.payload()), place };
    // Poisoned or not: a panic inside the hook would abort the program before anything is saved.
    let mut noted = NOTED.lock().unwrap_or_else(PoisonError::into_inner);
    if noted.len() == MAX_NOTED {
        noted.pop_front();
    }
    noted.push_back(report);
}

fn message(payload: &(dyn Any + Send)) -> String {
    panic_text(payload).unwrap_or("no message").to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::catch_unwind;

    #[test]
    fn message_and_place_are_known_even_of_another_threads_panic() {
        PanicReport::listen();
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
