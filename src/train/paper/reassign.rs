//! Moving unused components onto badly explained points (`train.md`, Reassignment).
//!
//! The worst points are found by a sample's bound and one selection among what it lets through, not by
//! sorting a frame. Drawing without replacement in rounds, as the reference does, has the law of an
//! exponential race: every point gets a time from its own random number, and the first ones win. The race
//! has no rounds, runs on all threads and gives equal points for any number of them.

use super::config::{PaperConfig, ReassignPolicy};
use crate::math::rng::Rng;
use rayon::prelude::*;

/// Draws one task takes at least.
const PART: usize = 1 << 10;

/// Parts of a frame that are looked through at once.
// A fixed number, not one a thread: joined, they are the same list for any number of threads.
const PARTS: usize = 16;
/// Marks in a word.
const BITS: usize = u64::BITS as usize;
/// Points by which the bound of the lowest is guessed, about.
const SAMPLED: usize = 1 << 12;
/// Deviations of a sample's count by which the bound is farther than it tells: then one frame of 30,000 or
/// so is looked through twice.
const SURE: f64 = 4.0;

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
    pub fn new(config: &PaperConfig, unused: usize) -> Option<Self> {
        let fraction = config.reassign_fraction;
        // Products in f64, cut off, as in the reference: one more or less moves other components.
        let share = |n: usize| (n as f64 * fraction) as usize;
        let moves = share(config.components).min(share(unused));
        let low_elbo = match config.reassign {
            ReassignPolicy::Off => return None,
            ReassignPolicy::Dense => usize::MAX,
            ReassignPolicy::Truncated | ReassignPolicy::Padded | ReassignPolicy::Forwarded => {
                config.low_elbo_floor.max((config.components as f64 * fraction * 4.0) as usize)
            }
        };
        (moves > 0).then_some(Self { moves, low_elbo })
    }
}

/// A point and what it is ordered by, which takes the upper bits: one number compares faster than two.
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

/// Chooses destinations, in memory kept from frame to frame.
#[derive(Default)]
pub struct DestinationChooser {
    /// Points of each part of a frame.
    parts: [Vec<Ranked>; PARTS],
    sample: Vec<u64>,
    /// By the order of the score, reversed so that the lowest ELBO comes first.
    lowest: Vec<Ranked>,
    /// By the order of the draw.
    draws: Vec<Ranked>,
    /// A bit for each point.
    marks: Vec<u64>,
    points: Vec<u32>,
}

impl DestinationChooser {
    /// With all memory that this configuration can need, whatever the frames hold.
    pub fn padded(config: &PaperConfig) -> Self {
        let Some(Quota { moves, low_elbo }) = Quota::new(config, config.components) else {
            return Self::default();
        };
        Self {
            parts: std::array::from_fn(|_| Vec::with_capacity(2 * low_elbo)),
            sample: Vec::with_capacity(SAMPLED),
            lowest: Vec::with_capacity(2 * low_elbo),
            draws: Vec::with_capacity(low_elbo),
            marks: Vec::new(),
            points: Vec::with_capacity(moves),
        }
    }

    /// Points that receive a component, in ascending order: a D²-weighted sample without
    /// replacement among the points of lowest ELBO, that is of largest effective distance `q`.
    /// Points whose `q` is NaN are never chosen. `stream` gives every point its random number.
    pub fn destinations(&mut self, q: &[f64], quota: Quota, stream: &Rng) -> &[u32] {
        self.find_lowest(q, quota.low_elbo);
        let is_drawn = self.lowest.len() > quota.moves;
        if is_drawn {
            self.draw(quota.moves, stream);
        }
        let Self { lowest, draws, marks, points, .. } = self;
        // In the order of points: neighbours then get neighbouring components, which lie close in
        // memory. Marks are read off in that order, so nothing is sorted.
        marks.clear();
        marks.resize(q.len().div_ceil(BITS), 0);
        for chosen in &*(if is_drawn { draws } else { lowest }) {
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

    /// The `n` points of lowest ELBO (all, if there are fewer), ties by lowest index; in no order.
    pub fn lowest_elbo(&mut self, q: &[f64], n: usize) -> impl Iterator<Item = u32> {
        self.find_lowest(q, n);
        self.lowest.iter().map(|chosen| chosen.point())
    }

    fn find_lowest(&mut self, q: &[f64], n: usize) {
        // Where all points may be chosen no bound has to be found.
        let bound = if n < q.len() { likely_bound(&mut self.sample, q, n) } else { u64::MAX };
        self.collect(q, bound);
        if self.lowest.len() < n && bound < u64::MAX {
            // The sample was not like the frame.
            self.collect(q, u64::MAX);
        }
        if n < self.lowest.len() {
            self.lowest.select_nth_unstable(n);
            self.lowest.truncate(n);
        }
    }

    /// Takes the points up to an order.
    fn collect(&mut self, q: &[f64], bound: u64) {
        let Self { parts, lowest, .. } = self;
        let size = q.len().div_ceil(PARTS).max(1);
        parts.par_iter_mut().enumerate().for_each(|(i, part)| {
            part.clear();
            let first = (i * size).min(q.len());
            let scores = &q[first..(first + size).min(q.len())];
            for (&q, point) in scores.iter().zip(first as u32..) {
                let order = largest_first(q);
                if order <= bound && !q.is_nan() {
                    part.push(Ranked::new(order, point));
                }
            }
        });
        lowest.clear();
        parts.iter().for_each(|part| lowest.extend_from_slice(part));
    }

    /// Keeps `n` candidates by the exponential race: the smallest of `−ln u_i / p_i` have the law
    /// of drawing one after the other with probabilities `p_i` of what is left (`train.md`,
    /// Sampling without replacement). Those of probability zero come last, in uniform order.
    fn draw(&mut self, n: usize, stream: &Rng) {
        let Self { lowest, draws, .. } = self;
        let last = lowest.iter().map(|candidate| candidate.order()).max();
        let best = last.map_or(f64::INFINITY, distance);
        draws.resize(lowest.len(), Ranked(0));
        let pairs = draws.par_iter_mut().zip(&*lowest).with_min_len(PART);
        pairs.for_each(|(draw, candidate)| {
            let uniform = stream.uniform_at(candidate.point().into());
            // Differences of `q` for those of the ELBO: a common factor leaves the race as it is.
            let gap = distance(candidate.order()) - best;
            // The logarithm of `libm` has equal bits on every machine; the platform's need not.
            let time = -libm::log(uniform) / gap;
            let last = 1 << 63;
            // A time is not negative, so its bits are in its order.
            let order = if gap > 0.0 { time.to_bits() } else { last | uniform.to_bits() };
            *draw = Ranked::new(order, candidate.point());
        });
        draws.select_nth_unstable(n);
        draws.truncate(n);
    }
}

/// An order that `n` points or more do not exceed, most likely, and few more, by the scores of some.
fn likely_bound(sample: &mut Vec<u64>, q: &[f64], n: usize) -> u64 {
    let step = q.len().div_ceil(SAMPLED).max(1);
    sample.clear();
    sample.extend(q.iter().step_by(step).filter(|q| !q.is_nan()).map(|&q| largest_first(q)));
    let expected = n as f64 / step as f64;
    let rank = (expected + SURE * (expected.sqrt() + 1.0)) as usize;
    if rank < sample.len() { *sample.select_nth_unstable(rank).1 } else { u64::MAX }
}

/// Bits in the order of distances, the largest first.
fn largest_first(distance: f64) -> u64 {
    let bits = distance.to_bits();
    if bits >> 63 == 1 { bits } else { !(bits | 1 << 63) }
}

/// The distance of [`largest_first`] bits.
fn distance(order: u64) -> f64 {
    f64::from_bits(if order >> 63 == 1 { order } else { !(order | 1 << 63) })
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
        let points = chooser.destinations(&q, Quota { moves: 2, low_elbo: 3 }, &stream);
        assert_eq!(points, [3, 4], "the best explained candidate has probability zero");
        assert_eq!(chooser.destinations(&q, Quota { moves: 6, low_elbo: 3 }, &stream), [1, 3, 4]);
    }

    #[test]
    fn the_race_follows_the_probabilities() {
        let (q, quota) = ([0.0, 1.0, 2.0, 5.0], Quota { moves: 1, low_elbo: 4 });
        let mut counts = [0usize; 4];
        for seed in 0..4000 {
            let stream = Rng::new(seed, Purpose::Reassign, 0);
            let mut chooser = DestinationChooser::default();
            counts[chooser.destinations(&q, quota, &stream)[0] as usize] += 1;
        }
        assert_eq!(counts[0], 0);
        for (count, p) in counts.iter().zip([0.0, 0.125, 0.25, 0.625]) {
            assert!((*count as f64 / 4000.0 - p).abs() < 0.03, "{counts:?}");
        }
    }
}
