//! Scores and responsibilities of one point (`training.md`, E-step).
//!
//! The score of a component for a point is a distance, `q = |Δs|² + λ|Δc|² − w`. `Δs` and `Δc` are the
//! differences in position and colour, `λ` is [`Scoring::color_ratio`] and `w` the component's log
//! weight. Only differences from the smallest score are multiplied by the precision, which avoids
//! cancellation in f32.

use crate::math::real::Real;
use crate::model::conjugate::prior::Hyper;
use crate::model::paper::state::InitialModel;

// Components that lose by this many nats receive nothing: e⁻⁴⁰ is below the rounding of a sum that
// starts with 1, in either precision.
const HARD_NATS: f64 = 40.0;

/// Constants of the log-score, which measures how well a component explains a point.
#[derive(Clone, Copy, Debug)]
pub struct Scoring {
    /// `λ = E[Λ^c] / E[Λ^s]`: weight of a squared colour distance relative to a squared distance of
    /// positions.
    pub color_ratio: f64,
    /// Nats per unit of squared distance in normalised coordinates, `½ E[Λ^s]`.
    pub half_precision: f64,
    /// Part of the log-score that is equal for all points and components.
    ln_constant: f64,
}

impl Scoring {
    /// Computes the constants from the hyperparameters of the initial model.
    pub fn new(hyper: &Hyper) -> Self {
        let precision = hyper.expected_precision_space();
        Self {
            color_ratio: hyper.expected_precision_color() / precision,
            half_precision: 0.5 * precision,
            ln_constant: hyper.ln_constant_space() + hyper.ln_constant_color(),
        }
    }

    /// Returns the hard gap: the score difference from the smallest `q` beyond which a component
    /// receives no part of a point.
    pub fn hard_gap(&self) -> f64 {
        HARD_NATS / self.half_precision
    }

    /// Computes the score `q` of a component for a point in precision `S`; a smaller score is better.
    #[inline(always)]
    pub fn distance<R: Real, S: Real>(
        &self,
        model: &InitialModel<R>,
        component: usize,
        space: [R; 3],
        color: [R; 3],
    ) -> S {
        let of = |v: R| S::of(v.to_f64());
        let square = |a: [R; 3], b: [R; 3]| squared_distance(a.map(of), b.map(of));
        square(space, model.space[component])
            + S::of(self.color_ratio) * square(color, model.color[component])
            - of(model.weight[component])
    }

    /// Converts the effective distance `q` of a point (see [`Self::responsibilities`]) to the point's
    /// ELBO in nats.
    #[inline(always)]
    pub fn elbo(&self, q: f64) -> f64 {
        self.ln_constant - self.half_precision * q
    }

    /// Converts a point's scores to responsibilities in place, in precision `S`.
    ///
    /// Returns the effective distance `q_min − (2/E_s) ln Σ exp(−½E_s(q − q_min))`, where `E_s` is the
    /// expected spatial precision. It encodes the point's ELBO, `logsumexp ln γ̂`, and is infinite if
    /// there are no candidates.
    #[inline(always)]
    pub fn responsibilities<S: Real>(&self, distances: &mut [f64]) -> f64 {
        // Scores are of the order of 1e9 nats, where f32 resolves only hundreds: only differences to the
        // minimum are meaningful. NaN never becomes the minimum, but propagates through the sum, and the
        // caller then drops the point.
        let min = distances.iter().fold(f64::INFINITY, |min, &q| if q < min { q } else { min });
        let (scale, min) = (S::of(self.half_precision), S::of(min));
        let mut sum = S::ZERO;
        for q in distances.iter_mut() {
            let e = (-(scale * (S::of(*q) - min))).exp();
            sum += e;
            *q = e.to_f64();
        }
        // One division per point instead of one per candidate.
        let total = S::ONE / sum;
        distances.iter_mut().for_each(|r| *r = (S::of(*r) * total).to_f64());
        (min - sum.ln() / scale).to_f64()
    }
}

/// Returns the squared distance `(dx² + dy²) + dz²` of two points.
#[inline(always)]
pub fn squared_distance<S: Real>(a: [S; 3], b: [S; 3]) -> S {
    // No closure: kernels would call it, compiled for the baseline instruction set.
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    (x * x + y * y) + z * z
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responsibilities_are_a_distribution_even_when_others_underflow() {
        let scoring = Scoring::new(&Hyper::paper(100_000, 1e5));
        let mut r = [0.25, 0.1, 0.3];
        assert_eq!(scoring.responsibilities::<f32>(&mut r), f64::from(0.1f32));
        assert_eq!(r, [0.0, 1.0, 0.0]);
        let mut equal = [0.5, 0.5];
        let q = scoring.responsibilities::<f64>(&mut equal);
        assert_eq!(equal, [0.5, 0.5]);
        assert!((scoring.elbo(q) - scoring.elbo(0.5) - 2f64.ln()).abs() <= 0.1);
        assert_eq!(scoring.responsibilities::<f64>(&mut []), f64::INFINITY);
    }
}
