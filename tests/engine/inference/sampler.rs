//! Sampling without replacement in the rounds of the reference (`training.md`, Sampling
//! without replacement), because the stored cases prescribe its uniforms. The trainer samples from the
//! same distribution by an exponential race.

/// Chooses `n` distinct indices with probabilities proportional to `weights` (finite, not
/// negative), drawing uniforms in `[0, 1)` from `uniform`.
///
/// Each round draws one uniform per missing index, takes the first index whose normalised
/// cumulative weight exceeds it, and drops repeats. The weights of chosen indices become zero. If
/// fewer than `n` weights are positive, all of them are chosen and the rest is drawn uniformly.
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
            // Only zero weights remain: every index not yet chosen is equally likely.
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

/// Computes the normalised cumulative sums; returns the total before normalisation.
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

/// Sampling probabilities `p_i ∝ max_j ELBO_j − ELBO_i` of candidates from their effective
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
