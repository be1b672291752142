//! A measured value and how far its repetitions lie apart.

use crate::eval::report::quantile;

/// Median and quartiles of repeated measurements.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Spread {
    /// Half of the measurements lie below.
    pub median: f64,
    /// A quarter of the measurements lies below the first, a quarter above the second.
    pub quartiles: [f64; 2],
}

impl Spread {
    /// Of at least one measurement; zero for none.
    pub fn of(mut values: Vec<f64>) -> Self {
        // A total order: a NaN among timings must not make the sort depend on where it stood.
        values.sort_by(f64::total_cmp);
        let [low, median, high] = [0.25, 0.5, 0.75].map(|q| quantile(&values, q));
        Self { median, quartiles: [low, high] }
    }

    /// A value that was not repeated.
    pub fn exact(value: f64) -> Self {
        Self { median: value, quartiles: [value; 2] }
    }

    /// All measurements times a factor.
    pub fn scaled(self, factor: f64) -> Self {
        Self { median: factor * self.median, quartiles: self.quartiles.map(|q| factor * q) }
    }
}

impl std::fmt::Display for Spread {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [low, high] = self.quartiles;
        // Three digits say as much as the spread allows.
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
