//! How uncertain unknowns are together.

use crate::math::cholesky::Cholesky;

/// A covariance of several numbers, in their order.
#[derive(Clone, Debug)]
pub(super) struct Covariance {
    n: usize,
    /// Row by row.
    values: Vec<f64>,
    /// Variances that come on top and have nothing to do with one another.
    own: Vec<f64>,
}

impl Covariance {
    /// Of numbers that are known.
    pub fn zero(n: usize) -> Self {
        Self { n, values: vec![0.0; n * n], own: vec![0.0; n] }
    }

    /// Of numbers that may be anything.
    pub fn open(n: usize) -> Self {
        let mut open = Self::zero(n);
        (0..n).for_each(|i| open.values[i * n + i] = f64::INFINITY);
        open
    }

    /// Adds a move of all numbers together that may go either way.
    pub fn add(&mut self, step: &[f64], weight: f64) {
        for (row, by) in self.values.chunks_exact_mut(self.n.max(1)).zip(step) {
            row.iter_mut().zip(step).for_each(|(value, other)| *value += weight * by * other);
        }
    }

    /// Raises a number's variance to a least one; correlations stay.
    pub fn widen(&mut self, place: usize, least: f64) {
        let factor = (least / self.variance(place)).max(1.0).sqrt();
        for other in 0..self.n {
            self.values[place * self.n + other] *= factor;
            self.values[other * self.n + place] *= factor;
        }
    }

    /// Adds to a number's variance by itself.
    pub fn blur(&mut self, place: usize, variance: f64) {
        self.own[place] += variance;
    }

    fn variance(&self, place: usize) -> f64 {
        self.values[place * self.n + place]
    }

    /// Standard error of a number.
    pub fn error(&self, place: usize) -> f64 {
        (self.variance(place) + self.own[place]).sqrt()
    }

    /// Standard errors that the number moves by which leans most on another, where that one moves by so much.
    pub fn leaning(&self, place: usize, apart: f64) -> f64 {
        (0..self.n)
            .filter(|&other| other != place)
            .map(|other| {
                let follows = self.values[place * self.n + other] / self.variance(place);
                (follows * apart).abs() / self.error(other)
            })
            .fold(0.0, f64::max)
    }

    /// Length of a difference of the first numbers, in standard errors (Mahalanobis' distance).
    pub fn distance(&self, apart: &[f64]) -> f64 {
        let m = apart.len();
        let mut block: Vec<f64> =
            self.values.chunks_exact(self.n).take(m).flat_map(|row| row[..m].to_vec()).collect();
        (0..m).for_each(|i| block[i * m + i] += self.own[i]);
        Cholesky::new(m, &block).map_or(0.0, |factor| {
            let solved = factor.solve(apart);
            solved.iter().zip(apart).map(|(a, b)| a * b).sum::<f64>().sqrt()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_that_make_up_for_one_another_are_certain_together() {
        let mut covariance = Covariance::zero(2);
        covariance.add(&[1.0, -1.0], 4.0);
        covariance.add(&[1.0, 1.0], 0.01);
        assert!((covariance.error(0) - 4.01_f64.sqrt()).abs() < 1e-12);
        assert!((covariance.leaning(0, 1.0) - 0.5).abs() < 0.01);
        // Alone half a standard error away, together seven.
        assert!((covariance.distance(&[0.7, 0.7]) - 7.0).abs() < 1e-9);
        assert!(covariance.distance(&[0.7, -0.7]) < 0.4);
    }

    #[test]
    fn variances_grow_with_and_without_their_correlations() {
        let mut covariance = Covariance::zero(2);
        covariance.add(&[1.0, 1.0], 1.0);
        covariance.widen(0, 0.5);
        assert_eq!(covariance.error(0), 1.0, "no less than it was");
        covariance.widen(0, 4.0);
        assert_eq!((covariance.error(0), covariance.error(1)), (2.0, 1.0));
        assert!((covariance.leaning(0, 1.0) - 0.5).abs() < 1e-12);
        covariance.blur(0, 12.0);
        assert_eq!(covariance.error(0), 4.0);
        assert!((covariance.leaning(0, 1.0) - 0.5).abs() < 1e-12, "others follow as before");
        assert_eq!(Covariance::open(2).distance(&[1.0, 1.0]), 0.0);
    }
}
