//! Scores and responsibilities of one point (`model.md` 6), in the distance form that f32 survives:
//! differences first, then `q = |Δs|² + λ|Δc|² − w`, scaled by the precision only after the point's
//! minimum is taken off.

use crate::math::real::Real;
use crate::model::mixture::InitialModel;
use crate::model::prior::Hyper;

/// Constants of the score.
#[derive(Clone, Copy, Debug)]
pub struct Scoring<R> {
    /// `λ = E[Λ^c] / E[Λ^s]`.
    color_ratio: R,
    /// `½ E[Λ^s]`.
    half_precision: R,
    /// Point- and component-independent part of the log-score.
    ln_constant: f64,
}

impl<R: Real> Scoring<R> {
    /// From the hyper-parameters of the initial model.
    pub fn new(hyper: &Hyper) -> Self {
        let precision = hyper.expected_precision_space();
        Self {
            color_ratio: R::of(hyper.expected_precision_color() / precision),
            half_precision: R::of(0.5 * precision),
            ln_constant: hyper.ln_constant_space() + hyper.ln_constant_color(),
        }
    }

    /// Scaled distance `q` of a point to a component, smaller is better.
    #[inline(always)]
    pub fn distance(
        &self,
        model: &InitialModel<R>,
        component: usize,
        space: [R; 3],
        color: [R; 3],
    ) -> R {
        let square = |a: [R; 3], b: [R; 3]| {
            let d: [R; 3] = std::array::from_fn(|i| a[i] - b[i]);
            d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
        };
        square(space, model.space[component])
            + self.color_ratio * square(color, model.color[component])
            - model.weight[component]
    }

    /// The log-score `ln γ̂ = const − ½ E_s q` a distance stands for.
    pub fn ln_score(&self, distance: R) -> f64 {
        self.ln_constant - self.half_precision.to_f64() * distance.to_f64()
    }

    /// Turns distances into responsibilities in place and returns the point's ELBO,
    /// `logsumexp ln γ̂`. Negative infinity for no candidates.
    #[inline(always)]
    pub fn responsibilities(&self, distances: &mut [R]) -> f64 {
        let min = distances.iter().fold(R::INFINITY, |min, &q| if q < min { q } else { min });
        let mut sum = R::ZERO;
        for q in distances.iter_mut() {
            *q = (-(self.half_precision * (*q - min))).exp();
            sum += *q;
        }
        let scale = R::ONE / sum;
        for r in distances.iter_mut() {
            *r = *r * scale;
        }
        self.ln_score(min) + sum.ln().to_f64()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn responsibilities_are_a_distribution_even_when_others_underflow() {
        let scoring = Scoring::<f32>::new(&Hyper::paper(100_000, 1e5));
        let mut q = [0.25f32, 0.1, 0.3];
        let elbo = scoring.responsibilities(&mut q);
        assert_eq!(q, [0.0, 1.0, 0.0]);
        assert!((elbo - scoring.ln_score(0.1)).abs() <= elbo.abs() * 1e-6);
        let mut equal = [0.5f32, 0.5];
        scoring.responsibilities(&mut equal);
        assert_eq!(equal, [0.5, 0.5]);
        assert_eq!(scoring.responsibilities(&mut []), f64::NEG_INFINITY);
    }
}
