//! Moving unused components onto badly explained points (`train.md`, Reassignment).
//!
//! The worst points are found by histograms over the leading bits of their scores and one selection
//! within the last bin, not by sorting a frame. Drawing without replacement in rounds, as
//! the reference does, has the law of an exponential race: every point gets a time from its own
//! random number, and the first ones win. The race has no rounds, runs on all threads and gives
//! equal points for any number of them.

use super::config::{PaperConfig, ReassignPolicy};
use crate::math::rng::Rng;
use rayon::prelude::*;

/// Draws one task takes at least.
const PART: usize = 1 << 10;

/// Parts of a frame that are looked through at once.
// A fixed number, not one a thread: joined, they are the same list for any number of threads.
const PARTS: usize = 16;
/// Bits of a score's order that tell bins of a histogram apart.
// Few: the parts' histograms are read by one thread.
const BIN_BITS: u32 = 12;
const N_BINS: usize = 1 << BIN_BITS;
/// Low bits that a bin spans, of the first histogram and of the second, which looks into one bin of the
/// first: sign and exponent are often the same for half of a frame.
const BIN_SHIFTS: [u32; 2] = [52, 40];

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

/// Chooses destinations, in memory kept from frame to frame.
#[derive(Default)]
pub struct DestinationChooser {
    parts: [Part; PARTS],
    /// Points by bin, of all parts.
    bins: Vec<u32>,
    /// Order of the score, reversed so that the lowest ELBO comes first, and the point.
    lowest: Vec<(u64, u32)>,
    /// Order of the draw, and the point.
    draws: Vec<(u64, u32)>,
    points: Vec<u32>,
}

/// What one part of a frame holds.
#[derive(Default)]
struct Part {
    histogram: Vec<u32>,
    lowest: Vec<(u64, u32)>,
}

impl DestinationChooser {
    /// With all memory that this configuration can need, whatever the frames hold.
    pub fn padded(config: &PaperConfig) -> Self {
        let Some(Quota { moves, low_elbo }) = Quota::new(config, config.components) else {
            return Self::default();
        };
        let part = || Part { histogram: vec![0; N_BINS], lowest: Vec::with_capacity(2 * low_elbo) };
        Self {
            parts: std::array::from_fn(|_| part()),
            bins: vec![0; N_BINS],
            lowest: Vec::with_capacity(2 * low_elbo),
            draws: Vec::with_capacity(low_elbo),
            points: Vec::with_capacity(moves),
        }
    }

    /// Points that receive a component, in ascending order: a D²-weighted sample without
    /// replacement among the points of lowest ELBO, that is of largest effective distance `q`.
    /// Points whose `q` is NaN are never chosen. `stream` gives every point its random number.
    pub fn destinations(&mut self, q: &[f64], quota: Quota, stream: &Rng) -> &[u32] {
        self.find_lowest(q, quota.low_elbo);
        self.points.clear();
        if self.lowest.len() <= quota.moves {
            self.points.extend(self.lowest.iter().map(|&(_, point)| point));
        } else {
            self.draw(quota.moves, stream);
            self.points.extend(self.draws.iter().map(|&(_, point)| point));
        }
        // In the order of points: neighbours then get neighbouring components, which lie close in
        // memory.
        self.points.sort_unstable();
        &self.points
    }

    /// The `n` points of lowest ELBO (all, if there are fewer), ties by lowest index; in no order.
    pub fn lowest_elbo(&mut self, q: &[f64], n: usize) -> impl Iterator<Item = u32> {
        self.find_lowest(q, n);
        self.lowest.iter().map(|&(_, point)| point)
    }

    fn find_lowest(&mut self, q: &[f64], n: usize) {
        let Self { parts, bins, lowest, .. } = self;
        let size = q.len().div_ceil(PARTS).max(1);
        // Where all points may be chosen no bound has to be found.
        let bound = if n < q.len() { last_order(parts, bins, q, n) } else { None };
        let bound = bound.unwrap_or(u64::MAX);
        parts.par_iter_mut().enumerate().for_each(|(i, part)| {
            part.collect(part_of(q, i, size), (i * size) as u32, bound);
        });
        lowest.clear();
        parts.iter().for_each(|part| lowest.extend_from_slice(&part.lowest));
        if n < lowest.len() {
            // The last bin may bring more than asked for.
            lowest.select_nth_unstable(n);
            lowest.truncate(n);
        }
    }

    /// Keeps `n` candidates by the exponential race: the smallest of `−ln u_i / p_i` have the law
    /// of drawing one after the other with probabilities `p_i` of what is left (`train.md`,
    /// Sampling without replacement). Those of probability zero come last, in uniform order.
    fn draw(&mut self, n: usize, stream: &Rng) {
        let Self { lowest, draws, .. } = self;
        let best = lowest.iter().map(|&(order, _)| distance(order)).fold(f64::INFINITY, f64::min);
        draws.resize(lowest.len(), (0, 0));
        let pairs = draws.par_iter_mut().zip(&*lowest).with_min_len(PART);
        pairs.for_each(|(draw, &(order, point))| {
            let uniform = stream.uniform_at(point.into());
            // Differences of `q` for those of the ELBO: a common factor leaves the race as it is.
            let gap = distance(order) - best;
            // The logarithm of `libm` has equal bits on every machine; the platform's need not.
            let time = -libm::log(uniform) / gap;
            let last = 1 << 63;
            // A time is not negative, so its bits are in its order.
            let order = if gap > 0.0 { time.to_bits() } else { last | uniform.to_bits() };
            *draw = (order, point);
        });
        draws.select_nth_unstable(n);
        draws.truncate(n);
    }
}

/// An order that `n` points do not exceed, and few more; `None` if there are not so many.
fn last_order(parts: &mut [Part; PARTS], bins: &mut Vec<u32>, q: &[f64], n: usize) -> Option<u64> {
    let size = q.len().div_ceil(PARTS).max(1);
    let (mut above, mut missing) = (0, n);
    for shift in BIN_SHIFTS {
        parts.par_iter_mut().enumerate().for_each(|(i, part)| {
            part.count(part_of(q, i, size), shift, above);
        });
        bins.clear();
        bins.resize(N_BINS, 0);
        for part in &*parts {
            bins.iter_mut().zip(&part.histogram).for_each(|(sum, n)| *sum += n);
        }
        let (mut found, mut before) = (0, 0);
        let bin = bins.iter().position(|&n| {
            before = found;
            found += n as usize;
            found >= missing
        })?;
        (above, missing) = (above << BIN_BITS | bin as u64, missing - before);
    }
    let shift = BIN_SHIFTS[1];
    Some(above << shift | ((1 << shift) - 1))
}

fn part_of(q: &[f64], part: usize, size: usize) -> &[f64] {
    let start = (part * size).min(q.len());
    &q[start..(start + size).min(q.len())]
}

impl Part {
    /// Counts points by the bits of their order from `shift` on, of those whose bits over these are
    /// `above`.
    fn count(&mut self, q: &[f64], shift: u32, above: u64) {
        self.histogram.clear();
        self.histogram.resize(N_BINS, 0);
        for &q in q.iter().filter(|q| !q.is_nan()) {
            let order = largest_first(q);
            if order.checked_shr(shift + BIN_BITS).unwrap_or(0) == above {
                self.histogram[(order >> shift) as usize % N_BINS] += 1;
            }
        }
    }

    /// Takes the points, counted from `first`, up to an order.
    fn collect(&mut self, q: &[f64], first: u32, bound: u64) {
        self.lowest.clear();
        for (&q, point) in q.iter().zip(first..) {
            let order = largest_first(q);
            if order <= bound && !q.is_nan() {
                self.lowest.push((order, point));
            }
        }
    }
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
