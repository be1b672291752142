//! Median and quartiles of repeated measurements.

use crate::eval::report::quantile;

/// Median and quartiles of repeated measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Median.
    pub median: f64,
    /// First and third quartile.
    pub quartiles: [f64; 2],
}

impl Spread {
    /// Computes median and quartiles; zero without values.
    pub fn of(mut values: Vec<f64>) -> Self {
        // Total order: with NaN, the result must not depend on the input order.
        values.sort_by(f64::total_cmp);
        let [low, median, high] = [0.25, 0.5, 0.75].map(|q| quantile(&values, q));
        Self { median, quartiles: [low, high] }
    }

    /// Spread of a value that was not repeated.
    pub fn exact(value: f64) -> Self {
        Self { median: value, quartiles: [value; 2] }
    }

    /// Scales all measurements by a factor.
    pub fn scaled(self, factor: f64) -> Self {
        Self { median: factor * self.median, quartiles: self.quartiles.map(|q| factor * q) }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.quartiles;
        // More digits would exceed the precision of the measurement.
        let digits = if self.median >= 100.0 {
            0
        } else if self.median >= 1.0 {
            1
        } else {
            3
        };
        write!(f, "{:.digits$} [{low:.digits$}, {high:.digits$}]", self.median)
    }
}
