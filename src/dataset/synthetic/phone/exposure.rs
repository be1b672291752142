//! Automatic exposure: the gain of photographs changes in steps.

use crate::math::rng::{Purpose, Rng};

/// Random stream of the gains.
const STREAM: u64 = u64::MAX - 4;
/// Minimum and maximum gain.
const GAINS: [f64; 2] = [0.8, 1.25];
/// Minimum relative difference between consecutive gains.
const LEAST_STEP: f64 = 0.08;
/// Approximate number of frames per gain step.
const FRAMES_PER_STEP: usize = 14;

/// Gain of each frame; the first is 1.
pub(super) fn gains(n: usize, seed: u64) -> Vec<f32> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, STREAM);
    // Gives short recordings a few steps too.
    let length = FRAMES_PER_STEP.min(n.div_ceil(3)).max(1);
    let mut gains = Vec::with_capacity(n);
    let (mut gain, mut left) = (1.0, length);
    while gains.len() < n {
        if left == 0 {
            gain = next(gain, &mut rng);
            left = length / 2 + rng.below(length) + 1;
        }
        gains.push(gain as f32);
        left -= 1;
    }
    gains
}

fn next(gain: f64, rng: &mut Rng) -> f64 {
    let [low, high] = GAINS.map(f64::ln);
    loop {
        // Terminates quickly: at most a quarter of the draws are rejected.
        let drawn = rng.range(low, high).exp();
        if (drawn / gain - 1.0).abs() > LEAST_STEP {
            return drawn;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gains_change_in_a_few_steps() {
        for (seed, n) in [(0, 70), (1, 70), (2, 24), (3, 2), (4, 1), (5, 0)] {
            let gains = gains(n, seed);
            assert_eq!(gains.len(), n);
            assert!(gains.first().is_none_or(|first| *first == 1.0));
            assert!(gains.iter().all(|gain| (0.8..=1.25).contains(gain)), "{gains:?}");
            let n_steps = gains.array_windows().filter(|[a, b]| a != b).count();
            assert!(n_steps <= n.div_ceil(3) && n_steps >= n / 24, "{n_steps} of {n}");
        }
    }
}
