//! Selects the smallest of many numbers without sorting: a sample gives an upper bound, and one selection
//! among the numbers below it finds them.

use rayon::prelude::*;

// Number of parts searched in parallel. Fixed rather than one per thread, so that the joined list does not
// depend on the number of threads.
const PARTS: usize = 16;
/// Safety margin of the bound in standard deviations of the sample's count. About one frame in 30,000 needs a
/// second search.
const BOUND_MARGIN_SIGMAS: f64 = 4.0;

/// A point with its sort key in the upper bits: one comparison of integers orders both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Ranked(u128);

impl Ranked {
    /// Combines a sort key and a point.
    pub fn new(order: u64, point: u32) -> Self {
        Self(u128::from(order) << 32 | u128::from(point))
    }

    /// Sort key.
    pub fn order(self) -> u64 {
        (self.0 >> 32) as u64
    }

    /// Index of the point.
    pub fn point(self) -> u32 {
        self.0 as u32
    }
}

/// Selects the smallest items; buffers are reused.
#[derive(Default)]
pub struct Smallest {
    parts: [Vec<Ranked>; PARTS],
    sample: Vec<u64>,
    found: Vec<Ranked>,
}

impl Smallest {
    /// Allocates memory for selecting `n` items with a sample of `sampled` items.
    pub fn with_capacity(n: usize, sampled: usize) -> Self {
        Self {
            parts: std::array::from_fn(|_| Vec::with_capacity(2 * n)),
            sample: Vec::with_capacity(sampled),
            found: Vec::with_capacity(2 * n),
        }
    }

    /// Returns the `n` smallest items, or all if there are fewer; ties go to the lower point; unordered.
    ///
    /// `ranked(item, bound)` returns an item's rank, or `None` if it has none or exceeds `bound`. The bound
    /// is estimated from about `sampled` items.
    pub fn find(
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

    /// Estimates an order that at least `n` items, and not many more, do not exceed.
    fn estimate_bound(
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
        let rank = (expected + BOUND_MARGIN_SIGMAS * (expected.sqrt() + 1.0)) as usize;
        if rank < sample.len() { *sample.select_nth_unstable(rank).1 } else { u64::MAX }
    }

    /// Collects all items up to a bound.
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
