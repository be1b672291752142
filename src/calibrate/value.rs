//! What is said of one number that was searched for.

use serde::Serialize;

/// A number before and after, and whether the data says what it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibratedValue {
    /// Name of the number, with its unit.
    pub name: &'static str,
    /// As it was.
    pub before: f64,
    /// As it is in the file: what it was, unless the data says better.
    pub after: f64,
    /// Where the data is explained best.
    pub best: f64,
    /// Of the best, from how much the views differ among themselves and from what is known of such
    /// sensors; errors that all views share, such as those of a map that poses were fitted to, come on top.
    pub standard_error: f64,
    /// Whether the data says what it is.
    pub determined: bool,
    /// Why it keeps its value.
    pub reason: Option<String>,
}

impl CalibratedValue {
    /// Takes the best.
    pub(super) fn determined(name: &'static str, before: f64, best: f64, error: f64) -> Self {
        let (after, standard_error) = (best, error);
        Self { name, before, after, best, standard_error, determined: true, reason: None }
    }

    /// Keeps what it was.
    pub(super) fn keep(&mut self, reason: String) {
        // `best` stays: people see what was not taken, and why.
        self.after = self.before;
        self.determined = false;
        self.reason = Some(reason);
    }

    /// Keeps what it was because the data says so.
    pub(super) fn confirm(&mut self, reason: String) {
        self.keep(reason);
        self.determined = true;
    }
}
