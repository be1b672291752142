//! Sampling without replacement, in the rounds of the reference (`train.md`, Sampling without
//! replacement): the stored cases prescribe its uniforms. The trainer draws by a race of the same
//! law.

use vbgs_studio::math::rng::{Purpose, Rng};

/// Chooses `n` distinct indices with probabilities proportional to `weights` (finite, not
/// negative), drawing uniforms in `[0, 1)` from `uniform`.
///
/// Each round draws as many uniforms as are missing, takes for each the first index whose
/// normalised cumulative weight exceeds it, and drops repeats; chosen weights are then zero. Where
/// fewer than `n` weights are positive, those are taken and the rest is filled uniformly.
pub fn without_replacement(
    weights: &[f64],
    n: usize,
    mut uniform: impl FnMut() -> f64,
) -> Vec<usize> {
    let n = n.min(weights.len());
    let mut weights = weights.to_vec();
    let mut taken = vec![false; weights.len()];
    let mut chosen = Vec::with_capacity(n);
    let mut cumulative = Vec::with_capacity(weights.len());
    while chosen.len() < n {
        let total = cumulate(&weights, &mut cumulative);
        if total <= 0.0 {
            // Only zero weights are left: every index not yet taken is equally likely.
            weights.iter_mut().zip(&taken).for_each(|(w, &t)| *w = if t { 0.0 } else { 1.0 });
            continue;
        }
        for _ in chosen.len()..n {
            let draw = uniform();
            let index = cumulative.partition_point(|&c| c <= draw).min(weights.len() - 1);
            if !taken[index] && weights[index] > 0.0 {
                taken[index] = true;
                chosen.push(index);
            }
        }
        chosen.iter().for_each(|&index| weights[index] = 0.0);
    }
    chosen
}

/// Normalised cumulative sums; returns the total before normalisation.
fn cumulate(weights: &[f64], cumulative: &mut Vec<f64>) -> f64 {
    let total: f64 = weights.iter().sum();
    cumulative.clear();
    let mut sum = 0.0;
    cumulative.extend(weights.iter().map(|w| {
        sum += w;
        sum
    }));
    let last = sum;
    if last > 0.0 {
        cumulative.iter_mut().for_each(|c| *c /= last);
    }
    total
}

/// Sampling probabilities `p_i ∝ max_j ELBO_j − ELBO_i` of candidates, by their effective
/// distances; uniform if all are equal.
pub fn probabilities(candidate_q: &[f64]) -> Vec<f64> {
    let best = candidate_q.iter().copied().fold(f64::INFINITY, f64::min);
    let gaps: Vec<f64> = candidate_q.iter().map(|q| q - best).collect();
    let total: f64 = gaps.iter().sum();
    if total > 0.0 && total.is_finite() {
        gaps.iter().map(|g| g / total).collect()
    } else {
        vec![1.0 / gaps.len().max(1) as f64; gaps.len()]
    }
}

#[test]
fn chosen_indices_are_distinct_and_follow_the_weights() {
    let mut counts = [0usize; 4];
    for seed in 0..4000 {
        let mut rng = Rng::new(seed, Purpose::Reassign, 0);
        let chosen = without_replacement(&[0.0, 1.0, 2.0, 5.0], 1, || rng.uniform());
        counts[chosen[0]] += 1;
    }
    assert_eq!(counts[0], 0);
    for (count, p) in counts.iter().zip([0.0, 0.125, 0.25, 0.625]) {
        assert!((*count as f64 / 4000.0 - p).abs() < 0.03, "{counts:?}");
    }
}

#[test]
fn zero_weights_fill_the_rest() {
    let mut rng = Rng::new(1, Purpose::Reassign, 0);
    let mut chosen = without_replacement(&[0.0, 3.0, 0.0, 0.0], 4, || rng.uniform());
    assert_eq!(chosen[0], 1);
    chosen.sort_unstable();
    assert_eq!(chosen, [0, 1, 2, 3]);
    assert!(without_replacement(&[], 3, || 0.5).is_empty());
}
