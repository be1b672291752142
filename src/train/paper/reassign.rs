//! Moves unused components to badly explained points (`training.md`, Reassignment).
//!
//! Points are sampled without replacement by an exponential race, which has the same distribution as
//! the reference's successive draws. Every point gets a time, computed from its own random number; the
//! points with the earliest times are selected. The race runs on all threads; its result does not
//! depend on their number.

use super::config::{PaperConfig, ReassignPolicy};
use crate::math::rng::Rng;
use rayon::prelude::*;

const BITS: usize = u64::BITS as usize;
/// Approximate number of points sampled to estimate a bound on the lowest ELBO values.
const SCORES: usize = 1 << 11;
/// Approximate number of points sampled to estimate a bound on the earliest times of the race.
const DRAWS: usize = 1 << 9;
// Relative margin for rounding when comparing a time with its bound.
const ROUNDING: f64 = 1e-9;

/// Limits of reassignment in one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quota {
    /// Maximum number of components to move.
    pub moves: usize,
    /// Maximum number of points considered as new positions, those of lowest ELBO; unlimited for
    /// `dense`.
    pub low_elbo: usize,
}

impl Quota {
    /// Computes the limits if `unused` components are unused. `moves` is the minimum of `⌊K f⌋` and
    /// `⌊unused f⌋` for K components and the configured fraction f; `None` if it is 0.
    pub fn new(config: &PaperConfig, unused: usize) -> Option<Self> {
        let fraction = config.reassign_fraction;
        // f64 products are truncated as in the reference: one more or less would move other components.
        let share = |n: usize| (n as f64 * fraction) as usize;
        let moves = share(config.components).min(share(unused));
        let low_elbo = match config.reassign {
            ReassignPolicy::Off => return None,
            ReassignPolicy::Dense => usize::MAX,
            ReassignPolicy::Padded | ReassignPolicy::Forwarded => {
                config.low_elbo_floor.max((config.components as f64 * fraction * 4.0) as usize)
            }
        };
        (moves > 0).then_some(Self { moves, low_elbo })
    }
}

/// Chooses the points to which unused components move; buffers are reused.
#[derive(Default)]
pub struct DestinationChooser {
    /// Selects the points of lowest ELBO. Sort keys are in reverse order of effective distances.
    lowest: Smallest,
    draws: Smallest,
    marks: Vec<u64>,
    points: Vec<u32>,
}

impl DestinationChooser {
    /// Creates a chooser with enough memory for any frame under this configuration.
    pub fn reserved(config: &PaperConfig) -> Self {
        // All components unused is the largest quota.
        let Some(Quota { moves, low_elbo }) = Quota::new(config, config.components) else {
            return Self::default();
        };
        Self {
            lowest: Smallest::with_capacity(low_elbo, SCORES),
            draws: Smallest::with_capacity(moves, DRAWS),
            marks: Vec::new(),
            points: Vec::with_capacity(moves),
        }
    }

    /// Selects the points to which components move, and returns them in ascending order. They are a
    /// D²-weighted sample without replacement from the points of lowest ELBO (largest effective
    /// distance `q`).
    ///
    /// Points with a NaN `q` are never selected. `stream` gives every point its random number.
    pub fn choose_destinations(&mut self, q: &[f64], quota: Quota, stream: &Rng) -> &[u32] {
        let Self { lowest, draws, marks, points } = self;
        let mut chosen = find_lowest(lowest, q, quota.low_elbo);
        if chosen.len() > quota.moves {
            chosen = draw_by_race(draws, chosen, quota.moves, stream);
        }
        // In point order, so that neighbouring points get components close in memory. Reading the marks in
        // order avoids sorting.
        marks.clear();
        marks.resize(q.len().div_ceil(BITS), 0);
        for chosen in chosen {
            let point = chosen.point() as usize;
            marks[point / BITS] |= 1 << (point % BITS);
        }
        points.clear();
        for (first, &word) in (0..).step_by(BITS).zip(&*marks) {
            let mut rest = word;
            while rest != 0 {
                points.push(first + rest.trailing_zeros());
                rest &= rest - 1;
            }
        }
        points
    }

    /// Selects the `n` points of lowest ELBO, or all points if there are fewer, in any order. At equal
    /// ELBO, points of lower index are preferred.
    pub fn lowest_elbo(&mut self, q: &[f64], n: usize) -> impl Iterator<Item = u32> {
        find_lowest(&mut self.lowest, q, n).iter().map(|chosen| chosen.point())
    }
}

fn find_lowest<'a>(lowest: &'a mut Smallest, q: &[f64], n: usize) -> &'a [Ranked] {
    lowest.find(q.len(), n, SCORES, |point, bound| {
        let order = descending_key(q[point]);
        // The bits of NaN have a place in the order of keys, so it is excluded here.
        (order <= bound && !q[point].is_nan()).then(|| Ranked::new(order, point as u32))
    })
}

/// Selects `n` candidates by an exponential race (`training.md`, Sampling without replacement). The
/// smallest times `−ln u_i / p_i` have the distribution of successive draws with probabilities `p_i`.
/// Candidates of probability zero come last, in uniform order.
fn draw_by_race<'a>(
    draws: &'a mut Smallest,
    candidates: &[Ranked],
    n: usize,
    stream: &Rng,
) -> &'a [Ranked] {
    // The candidate of highest ELBO has probability zero.
    let last = candidates.iter().map(|candidate| candidate.order()).max();
    let best = last.map_or(f64::INFINITY, distance);
    draws.find(candidates.len(), n, DRAWS, |i, bound| {
        let candidate = candidates[i];
        let order = arrival_key(candidate, best, bound, stream)?;
        (order <= bound).then(|| Ranked::new(order, candidate.point()))
    })
}

/// Returns the sort key of a candidate's time in the race. `None` only if the key exceeds `bound`.
fn arrival_key(candidate: Ranked, best: f64, bound: u64, stream: &Rng) -> Option<u64> {
    // Times are not negative, so their sign bit is free to sort probability zero last.
    const LAST: u64 = 1 << 63;
    let uniform = stream.uniform_at(candidate.point().into());
    // Differences of `q` replace those of the ELBO: a common factor does not change the race.
    let gap = distance(candidate.order()) - best;
    // NaN is the difference of two infinite distances.
    if gap <= 0.0 || gap.is_nan() {
        return Some(LAST | uniform.to_bits());
    }
    // Since `−ln u ≥ 1 − u`, most late candidates are rejected without a logarithm.
    let is_late = bound < LAST && 1.0 - uniform > f64::from_bits(bound) * gap * (1.0 + ROUNDING);
    // `libm::log` has equal bits on every platform. Times are not negative, so their bits sort like
    // their values.
    (!is_late).then(|| (-libm::log(uniform) / gap).to_bits())
}

/// Returns a sort key that orders distances from largest to smallest.
fn descending_key(distance: f64) -> u64 {
    let bits = distance.to_bits();
    // Bits of negative floats already grow as the value falls; those of the others are inverted.
    if bits >> 63 == 1 { bits } else { !(bits | 1 << 63) }
}

fn distance(order: u64) -> f64 {
    f64::from_bits(if order >> 63 == 1 { order } else { !(order | 1 << 63) })
}

// Number of parts searched in parallel. Fixed rather than one per thread, so that the joined list does not
// depend on the number of threads.
const PARTS: usize = 16;
// Safety margin of the bound in standard deviations of the sample's count. About one frame in 30,000 needs a
// second search.
const BOUND_MARGIN_SIGMAS: f64 = 4.0;

/// A point with its sort key in the upper bits. One comparison of integers orders by key, then by point.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Ranked(u128);

impl Ranked {
    fn new(order: u64, point: u32) -> Self {
        Self(u128::from(order) << 32 | u128::from(point))
    }

    fn order(self) -> u64 {
        (self.0 >> 32) as u64
    }

    fn point(self) -> u32 {
        self.0 as u32
    }
}

/// Selects the items of smallest rank (sort key, then point); buffers are reused.
#[derive(Default)]
struct Smallest {
    parts: [Vec<Ranked>; PARTS],
    sample: Vec<u64>,
    found: Vec<Ranked>,
}

impl Smallest {
    fn with_capacity(n: usize, sampled: usize) -> Self {
        Self {
            // The estimated bound admits more than `n` items.
            parts: std::array::from_fn(|_| Vec::with_capacity(2 * n)),
            sample: Vec::with_capacity(sampled),
            found: Vec::with_capacity(2 * n),
        }
    }

    /// Selects the `n` items of smallest rank, or all if there are fewer, in any order. At equal sort
    /// key, the lower point is preferred.
    ///
    /// `ranked(item, bound)` returns the rank of an item, or `None` if the item has no rank or its sort
    /// key exceeds `bound`. The bound is estimated from about `sampled` items.
    fn find(
        &mut self,
        items: usize,
        n: usize,
        sampled: usize,
        ranked: impl Fn(usize, u64) -> Option<Ranked> + Sync,
    ) -> &[Ranked] {
        // If all items may be selected, no bound is needed.
        let bound =
            if n < items { self.estimate_bound(items, n, sampled, &ranked) } else { u64::MAX };
        self.collect(items, bound, &ranked);
        if self.found.len() < n && bound < u64::MAX {
            // The sample was not representative of the frame.
            self.collect(items, u64::MAX, &ranked);
        }
        let Self { found, .. } = self;
        if n < found.len() {
            found.select_nth_unstable(n);
            found.truncate(n);
        }
        found
    }

    /// Estimates a bound on the sort keys, such that at least `n` items do not exceed it, but not many
    /// more.
    fn estimate_bound(
        &mut self,
        items: usize,
        n: usize,
        sampled: usize,
        ranked: &(impl Fn(usize, u64) -> Option<Ranked> + Sync),
    ) -> u64 {
        let Self { sample, .. } = self;
        // A regular stride instead of random items: repeated runs select the same.
        let step = items.div_ceil(sampled).max(1);
        let any = |item| ranked(item, u64::MAX);
        sample.clear();
        sample.extend((0..items).step_by(step).filter_map(any).map(Ranked::order));
        let expected = n as f64 / step as f64;
        let rank = (expected + BOUND_MARGIN_SIGMAS * (expected.sqrt() + 1.0)) as usize;
        if rank < sample.len() { *sample.select_nth_unstable(rank).1 } else { u64::MAX }
    }

    fn collect(
        &mut self,
        items: usize,
        bound: u64,
        ranked: &(impl Fn(usize, u64) -> Option<Ranked> + Sync),
    ) {
        let Self { parts, found, .. } = self;
        let size = items.div_ceil(PARTS).max(1);
        parts.par_iter_mut().enumerate().for_each(|(i, part)| {
            // Taken out of the array while growing: adjacent lengths would share a cache line.
            let mut these = std::mem::take(part);
            let all = (i * size).min(items)..((i + 1) * size).min(items);
            these.clear();
            these.extend(all.filter_map(|item| ranked(item, bound)));
            *part = these;
        });
        found.clear();
        parts.iter().for_each(|part| found.extend_from_slice(part));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Purpose;
    use crate::train::paper::config::PaperOverrides;

    fn quota(unused: usize, fraction: f64) -> Option<Quota> {
        let overrides = PaperOverrides {
            components: Some(1000),
            reassign_fraction: Some(fraction),
            ..PaperOverrides::default()
        };
        let config = PaperConfig::paper().with(&overrides).unwrap();
        Quota::new(&PaperConfig { low_elbo_floor: 64, ..config }, unused)
    }

    #[test]
    fn quota_follows_the_smaller_share() {
        assert_eq!(quota(1000, 0.05).unwrap(), Quota { moves: 50, low_elbo: 200 });
        assert_eq!(quota(100, 0.05).unwrap().moves, 5);
        assert_eq!(quota(19, 0.05), None);
        assert_eq!(quota(0, 1.0), None);
    }

    #[test]
    fn the_lowest_are_found_among_all_orders_of_magnitude() {
        let mut rng = Rng::new(5, Purpose::Synthetic, 0);
        let mut q: Vec<f64> =
            (0..5000).map(|_| rng.normal() * 10f64.powi(rng.below(30) as i32 - 15)).collect();
        q[17] = f64::NAN;
        q[4000] = q[3000];
        let mut expected: Vec<u32> = (0..5000).filter(|&i| i != 17).collect();
        expected.sort_by(|&a, &b| q[b as usize].total_cmp(&q[a as usize]).then(a.cmp(&b)));
        for n in [0, 1, 100, 4998, 4999, 5000] {
            let mut found: Vec<u32> = DestinationChooser::default().lowest_elbo(&q, n).collect();
            found.sort_unstable();
            let mut first = expected[..n.min(4999)].to_vec();
            first.sort_unstable();
            assert_eq!(found, first, "{n}");
        }
    }

    #[test]
    fn destinations_prefer_badly_explained_points() {
        let q = [1.0, 50.0, 2.0, 60.0, 70.0, 0.0];
        let stream = Rng::new(1, Purpose::Reassign, 0);
        let mut chooser = DestinationChooser::default();
        let points = chooser.choose_destinations(&q, Quota { moves: 2, low_elbo: 3 }, &stream);
        assert_eq!(points, [3, 4], "the best explained candidate has probability zero");
        assert_eq!(
            chooser.choose_destinations(&q, Quota { moves: 6, low_elbo: 3 }, &stream),
            [1, 3, 4]
        );
    }

    #[test]
    fn the_bound_leaves_the_winners_of_the_whole_race() {
        let mut rng = Rng::new(9, Purpose::Synthetic, 0);
        let q: Vec<f64> = (0..30_000).map(|_| rng.normal().powi(4)).collect();
        let quota = Quota { moves: 800, low_elbo: 6000 };
        for frame in 0..20 {
            let stream = Rng::new(1, Purpose::Reassign, frame);
            let mut chooser = DestinationChooser::default();
            let candidates = find_lowest(&mut chooser.lowest, &q, quota.low_elbo).to_vec();
            let best = distance(candidates.iter().map(|c| c.order()).max().unwrap());
            let mut race: Vec<(u64, u32)> = candidates
                .iter()
                .map(|&c| (arrival_key(c, best, u64::MAX, &stream).unwrap(), c.point()))
                .collect();
            race.sort_unstable();
            let mut expected: Vec<u32> = race[..quota.moves].iter().map(|draw| draw.1).collect();
            expected.sort_unstable();
            assert_eq!(chooser.choose_destinations(&q, quota, &stream), expected, "{frame}");
        }
    }

    #[test]
    fn the_race_follows_the_probabilities() {
        let (q, quota) = ([0.0, 1.0, 2.0, 5.0], Quota { moves: 1, low_elbo: 4 });
        let mut counts = [0usize; 4];
        for seed in 0..4000 {
            let stream = Rng::new(seed, Purpose::Reassign, 0);
            let mut chooser = DestinationChooser::default();
            counts[chooser.choose_destinations(&q, quota, &stream)[0] as usize] += 1;
        }
        assert_eq!(counts[0], 0);
        for (count, p) in counts.iter().zip([0.0, 0.125, 0.25, 0.625]) {
            assert!((*count as f64 / 4000.0 - p).abs() < 0.03, "{counts:?}");
        }
    }
}

#[cfg(test)]
mod smallest_tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    fn smallest(orders: &[u64], n: usize, sampled: usize) -> Vec<u32> {
        let ranked = |i: usize, bound| {
            let is_wanted = orders[i] <= bound && !i.is_multiple_of(7);
            is_wanted.then(|| Ranked::new(orders[i], i as u32))
        };
        let mut finder = Smallest::default();
        let mut found: Vec<u32> =
            finder.find(orders.len(), n, sampled, ranked).iter().map(|r| r.point()).collect();
        found.sort_unstable();
        found
    }

    #[test]
    fn the_smallest_are_those_that_sorting_finds() {
        let mut rng = Rng::new(3, Purpose::Synthetic, 0);
        for spread in [1, 3, 1000, usize::MAX] {
            let mut orders: Vec<u64> = (0..5000).map(|_| rng.below(spread) as u64).collect();
            // First with a sample that is representative, then with one that is not.
            for sampled in [500, 5000] {
                for n in [0, 1, 40, 1000, 4285, 4286, 6000] {
                    let mut sorted: Vec<u32> = (0..5000).filter(|i| i % 7 != 0).collect();
                    sorted.sort_by_key(|&i| (orders[i as usize], i));
                    sorted.truncate(n);
                    sorted.sort_unstable();
                    assert_eq!(smallest(&orders, n, sampled), sorted, "{spread} {sampled} {n}");
                }
                orders.iter_mut().step_by(10).for_each(|order| *order = u64::MAX / 2);
            }
            orders.iter_mut().step_by(10).for_each(|order| *order = 0);
            let found = smallest(&orders, 300, 500);
            assert!(found.len() == 300 && found.iter().all(|i| orders[*i as usize] == 0));
        }
    }
}
