//! Result for one estimated value.

use serde::Serialize;

/// An estimated value before and after, and whether the data determines it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibratedValue {
    /// Name of the value, with its unit.
    pub name: &'static str,
    /// Initial value.
    pub before: f64,
    /// Value in the resulting calibration: the initial one, unless the data determines this value or
    /// correlated ones.
    pub after: f64,
    /// Value that explains the data best.
    pub best: f64,
    /// Standard error of `best`, from the scatter of the views and the sensor prior. Errors common to all
    /// views, e.g. of a map to which the poses were fitted, are not included.
    pub standard_error: f64,
    /// True if the data determines the value.
    pub determined: bool,
    /// Why the value was not changed, or not by itself.
    pub reason: Option<String>,
}

impl CalibratedValue {
    /// Creates a determined value that takes the best.
    pub(super) fn determined(name: &'static str, before: f64, best: f64, error: f64) -> Self {
        let (after, standard_error) = (best, error);
        Self { name, before, after, best, standard_error, determined: true, reason: None }
    }

    /// Reverts to the initial value.
    pub(super) fn revert(&mut self, reason: String) {
        // `best` is retained, so that the report shows what was rejected and why.
        self.after = self.before;
        self.determined = false;
        self.reason = Some(reason);
    }

    /// Takes the best although it is not determined by itself, because other values depend on it.
    pub(super) fn accept_as_correlated(&mut self, reason: String) {
        self.determined = false;
        self.reason = Some(format!("{reason}; taken with the others, which depend on it"));
    }

    /// Updates the best value after others reverted to their initial values.
    pub(super) fn set_best(&mut self, best: f64) {
        (self.after, self.best) = (best, best);
    }

    /// Absolute difference between the best and the initial value.
    pub(super) fn change(&self) -> f64 {
        (self.best - self.before).abs()
    }

    /// Keeps the initial value because the data confirms it.
    pub(super) fn confirm_initial(&mut self, reason: String) {
        self.revert(reason);
        self.determined = true;
    }
}
