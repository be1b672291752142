//! The smallest of many numbers, by a bound that a sample tells and one selection among what it lets through:
//! a frame is not sorted.

use rayon::prelude::*;

/// Parts that are looked through at once.
// A fixed number, not one a thread: joined, they are the same list for any number of threads.
const PARTS: usize = 16;
/// Deviations of a sample's count by which the bound is farther than it tells: then one frame of 30,000 or
/// so is looked through twice.
const SURE: f64 = 4.0;

/// A point and what it is ordered by, which takes the upper bits: one number compares faster than two.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ranked(u128);

impl Ranked {
    /// A point by its order.
    pub fn new(order: u64, point: u32) -> Self {
        Self(u128::from(order) << 32 | u128::from(point))
    }

    /// What it is ordered by.
    pub fn order(self) -> u64 {
        (self.0 >> 32) as u64
    }

    /// The point.
    pub fn point(self) -> u32 {
        self.0 as u32
    }
}

/// Finds the smallest, in memory kept from frame to frame.
#[derive(Default)]
pub struct Smallest {
    parts: [Vec<Ranked>; PARTS],
    sample: Vec<u64>,
    found: Vec<Ranked>,
}

impl Smallest {
    /// With memory for so many, and for a sample of so many items.
    pub fn with_capacity(n: usize, sampled: usize) -> Self {
        Self {
            parts: std::array::from_fn(|_| Vec::with_capacity(2 * n)),
            sample: Vec::with_capacity(sampled),
            found: Vec::with_capacity(2 * n),
        }
    }

    /// The `n` smallest of some items, or all if there are fewer; ties by lowest point; in no order.
    ///
    /// `ranked` says an item's rank, or `None` if it has none or its order is beyond a bound. About `sampled`
    /// items tell the bound.
    pub fn find(
        &mut self,
        items: usize,
        n: usize,
        sampled: usize,
        ranked: impl Fn(usize, u64) -> Option<Ranked> + Sync,
    ) -> &[Ranked] {
        // Where all may be chosen no bound has to be found.
        let bound =
            if n < items { self.likely_bound(items, n, sampled, &ranked) } else { u64::MAX };
        self.collect(items, bound, &ranked);
        if self.found.len() < n && bound < u64::MAX {
            // The sample was not like the frame.
            self.collect(items, u64::MAX, &ranked);
        }
        let Self { found, .. } = self;
        if n < found.len() {
            found.select_nth_unstable(n);
            found.truncate(n);
        }
        found
    }

    /// An order that `n` items or more do not exceed, most likely, and few more.
    fn likely_bound(
        &mut self,
        items: usize,
        n: usize,
        sampled: usize,
        ranked: &(impl Fn(usize, u64) -> Option<Ranked> + Sync),
    ) -> u64 {
        let Self { sample, .. } = self;
        let step = items.div_ceil(sampled).max(1);
        let any = |item| ranked(item, u64::MAX);
        sample.clear();
        sample.extend((0..items).step_by(step).filter_map(any).map(Ranked::order));
        let expected = n as f64 / step as f64;
        let rank = (expected + SURE * (expected.sqrt() + 1.0)) as usize;
        if rank < sample.len() { *sample.select_nth_unstable(rank).1 } else { u64::MAX }
    }

    /// Finds all up to a bound.
    fn collect(
        &mut self,
        items: usize,
        bound: u64,
        ranked: &(impl Fn(usize, u64) -> Option<Ranked> + Sync),
    ) {
        let Self { parts, found, .. } = self;
        let size = items.div_ceil(PARTS).max(1);
        parts.par_iter_mut().enumerate().for_each(|(i, part)| {
            // Out of the array while it grows: lengths side by side would be one line of all threads' caches.
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
            // Not like what a sample of every tenth says, and like it.
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
