//! What is said of one number that was searched for.

use serde::Serialize;

/// Rise of a sum of squares, relative, that keeping a value must cost for the data to determine it.
/// Errors of poses shift the minimum: on the 7-Scenes Kinect to a roll that spares 0.8 % and makes
/// held-out views worse.
pub(super) const MIN_RISE: f64 = 0.02;

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
    /// Of the best, from how much the views differ among themselves; errors that they share, such as
    /// those of poses, come on top.
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
}
