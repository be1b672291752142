//! Initial means and weights (`training.md`, Initial means).

use crate::math::real::Real;
use crate::math::rng::{Purpose, Rng};
use crate::observation::points::Points;

/// Half-width of the cube in which random means are drawn, in normalised units. For a world range of
/// [−1, 1], this is 0.98 world units.
const HALF_WIDTH: f64 = 1.7;
/// Standard deviation of the noise added to all six coordinates (position and colour) of a mean.
const NOISE: f64 = 0.025;

/// Means and Dirichlet parameters of the initial model.
///
/// ```
/// use vbgs_studio::train::paper::init::InitialDraw;
///
/// let draw = InitialDraw::random(10, 3);
/// assert_eq!((draw.means.len(), draw.alpha.len()), (10, 10));
/// assert_eq!(draw.means, InitialDraw::random(10, 3).means);
/// ```
#[derive(Clone, Debug)]
pub struct InitialDraw {
    /// Mean position and mean colour of each component, normalised.
    pub means: Vec<[f64; 6]>,
    /// Dirichlet parameter `α_init` of each component.
    pub alpha: Vec<f64>,
}

impl InitialDraw {
    /// Draws the paper's initial model: positions uniform in a cube, and mid-grey colours, both with
    /// noise. Dirichlet parameters are `(1 + u)/K`, with `u` uniform in `[0, 1)`.
    pub fn random(components: usize, seed: u64) -> Self {
        let mut rng = Rng::new(seed, Purpose::Init, 0);
        let mean = |rng: &mut Rng| {
            let mut row = [0.0; 6];
            row[..3].fill_with(|| rng.range(-HALF_WIDTH, HALF_WIDTH));
            // Colours are noise alone: grey is 0 in normalised units.
            row.map(|v| v + NOISE * rng.normal())
        };
        let means = (0..components).map(|_| mean(&mut rng)).collect();
        Self { means, alpha: random_alpha(components, seed) }
    }

    /// Draws means from the points of the first frame, with replacement. If there are at least as many
    /// components as points, the first means are the points in order.
    ///
    /// Uses [`InitialDraw::random`] if there are no points.
    pub fn from_points<R: Real>(points: &Points<R>, components: usize, seed: u64) -> Self {
        if points.is_empty() {
            return Self::random(components, seed);
        }
        let mut rng = Rng::new(seed, Purpose::Init, 0);
        // As in the reference: with enough components, every point gets a mean.
        let in_order = if components >= points.len() { points.len() } else { 0 };
        let row = |i: usize| {
            let (s, c) = (points.position(i), points.color(i));
            [s[0], s[1], s[2], c[0], c[1], c[2]].map(R::to_f64)
        };
        let means = (0..components)
            .map(|k| row(if k < in_order { k } else { rng.below(points.len()) }))
            .collect();
        Self { means, alpha: random_alpha(components, seed) }
    }
}

fn random_alpha(components: usize, seed: u64) -> Vec<f64> {
    // A separate stream, so that weights do not depend on how many numbers the means consume.
    let mut rng = Rng::new(seed, Purpose::Init, 1);
    // A quirk of the reference that hardly affects assignments (`model.md`, Quirks of the
    // reference).
    (0..components).map(|_| (1.0 + rng.uniform()) / components as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_means_fill_the_cube() {
        let draw = InitialDraw::random(20_000, 3);
        let inside = draw.means.iter().filter(|m| m[..3].iter().all(|v| v.abs() < 1.85)).count();
        assert_eq!(inside, 20_000);
        let spread = draw.means.iter().map(|m| m[0] * m[0]).sum::<f64>() / 20_000.0;
        assert!((spread - HALF_WIDTH * HALF_WIDTH / 3.0).abs() < 0.02, "{spread}");
        let gray = draw.means.iter().map(|m| m[4] * m[4]).sum::<f64>() / 20_000.0;
        assert!((gray.sqrt() - NOISE).abs() < 1e-3);
        assert!(draw.alpha.iter().all(|a| (5e-5..1e-4).contains(a)));
    }

    #[test]
    fn data_means_are_points() {
        let points = Points::<f32>::from_rows(&[[1.0; 6], [2.0; 6], [3.0; 6]]);
        let draw = InitialDraw::from_points(&points, 5, 0);
        assert_eq!(draw.means[..3], [[1.0; 6], [2.0; 6], [3.0; 6]]);
        assert!(draw.means[3..].iter().all(|m| [1.0, 2.0, 3.0].contains(&m[0])));
        assert_eq!(InitialDraw::from_points(&Points::<f32>::new(), 5, 0).means.len(), 5);
    }
}
