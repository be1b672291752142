//! Moving unused components onto badly explained points (`model.md` 10).

use super::config::ReassignPolicy;
use super::sampler;

/// How many components may move and among how many points destinations are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quota {
    /// Components to move at most.
    pub moves: usize,
    /// Points with the lowest ELBO that may become destinations; the dense policy takes all.
    pub low_elbo: usize,
}

impl Quota {
    /// `n_max = ⌊K f⌋` and `n_req = ⌊unused f⌋` capped by each other; `None` if nothing may move.
    pub fn new(
        policy: ReassignPolicy,
        components: usize,
        unused: usize,
        fraction: f64,
        low_elbo_floor: usize,
    ) -> Option<Self> {
        let share = |n: usize| (n as f64 * fraction) as usize;
        let moves = share(components).min(share(unused));
        let low_elbo = match policy {
            ReassignPolicy::Off => return None,
            ReassignPolicy::Dense => usize::MAX,
            ReassignPolicy::Truncated | ReassignPolicy::Padded | ReassignPolicy::Forwarded => {
                low_elbo_floor.max((components as f64 * fraction * 4.0) as usize)
            }
        };
        (moves > 0).then_some(Self { moves, low_elbo })
    }
}

/// The `n` points of lowest ELBO (all, if there are fewer), in point order; ties by lowest index.
pub fn lowest_elbo(elbo: &[f64], n: usize) -> Vec<u32> {
    let mut points: Vec<u32> = (0..elbo.len() as u32).collect();
    if n < points.len() {
        let key = |&p: &u32| (elbo[p as usize], p);
        points.select_nth_unstable_by(n, |a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))
        });
        points.truncate(n);
        points.sort_unstable();
    }
    points
}

/// Sampling probabilities `p_i ∝ max_j ELBO_j − ELBO_i` of the candidates, uniform if all equal.
pub fn probabilities(candidate_elbo: &[f64]) -> Vec<f64> {
    let max = candidate_elbo.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let gaps: Vec<f64> = candidate_elbo.iter().map(|e| max - e).collect();
    let total: f64 = gaps.iter().sum();
    if total > 0.0 && total.is_finite() {
        gaps.iter().map(|g| g / total).collect()
    } else {
        vec![1.0 / gaps.len().max(1) as f64; gaps.len()]
    }
}

/// Points that receive a component, in ascending order: a D²-weighted sample among the points of
/// lowest ELBO.
pub fn destinations(elbo: &[f64], quota: Quota, uniform: impl FnMut() -> f64) -> Vec<u32> {
    let candidates = lowest_elbo(elbo, quota.low_elbo);
    if candidates.len() <= quota.moves {
        return candidates;
    }
    let candidate_elbo: Vec<f64> = candidates.iter().map(|&p| elbo[p as usize]).collect();
    let chosen =
        sampler::without_replacement(&probabilities(&candidate_elbo), quota.moves, uniform);
    let mut points: Vec<u32> = chosen.into_iter().map(|i| candidates[i]).collect();
    points.sort_unstable();
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quota_follows_the_smaller_share() {
        let quota = |unused, f| Quota::new(ReassignPolicy::Truncated, 1000, unused, f, 64);
        assert_eq!(quota(1000, 0.05).unwrap(), Quota { moves: 50, low_elbo: 200 });
        assert_eq!(quota(100, 0.05).unwrap().moves, 5);
        assert_eq!(quota(19, 0.05), None);
        assert_eq!(quota(0, 1.0), None);
        assert_eq!(Quota::new(ReassignPolicy::Off, 1000, 1000, 0.5, 64), None);
    }

    #[test]
    fn destinations_prefer_badly_explained_points() {
        let elbo = [-1.0, -50.0, -2.0, -60.0, -70.0, 0.0];
        assert_eq!(lowest_elbo(&elbo, 3), [1, 3, 4]);
        assert_eq!(lowest_elbo(&elbo, 10), [0, 1, 2, 3, 4, 5]);
        let quota = Quota { moves: 2, low_elbo: 3 };
        let points = destinations(&elbo, quota, || 0.5);
        assert_eq!(points.len(), 2);
        assert!(!points.contains(&1), "the best explained candidate has probability zero");
        assert_eq!(destinations(&elbo, Quota { moves: 6, low_elbo: 3 }, || 0.5), [1, 3, 4]);
        assert_eq!(probabilities(&[2.0, 2.0]), [0.5, 0.5]);
    }
}
