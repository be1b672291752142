//! What is said of one number that was searched for.

use serde::Serialize;

/// A number before and after, and whether the data says what it is.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibratedValue {
    /// Name of the number, with its unit.
    pub name: &'static str,
    /// As it was.
    pub before: f64,
    /// As it is in the file: what it was, unless the data says better of it or of others with it.
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

    /// Takes the best for the others' sake, which the data says with it and not without.
    pub(super) fn lean(&mut self, reason: String) {
        self.determined = false;
        self.reason = Some(format!("{reason}; taken with the others, which lean on it"));
    }

    /// Where the best came to lie after others went back to what they were.
    pub(super) fn settle_at(&mut self, best: f64) {
        (self.after, self.best) = (best, best);
    }

    /// How far the best is from what it was.
    pub(super) fn apart(&self) -> f64 {
        (self.best - self.before).abs()
    }

    /// Keeps what it was because the data says so.
    pub(super) fn confirm(&mut self, reason: String) {
        self.keep(reason);
        self.determined = true;
    }
}
