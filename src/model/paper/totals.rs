//! Totals of all components over all frames so far.
//!
//! Fixed-point totals make the sum exact and associative. Any frame order, thread count or sharding
//! gives bit-identical results, provided the initial model is the same. Components are split into
//! shards by id, so that threads never share a row. A row begins at a cache line. Its frame stamp comes
//! first, as it is read together with the first sums.
//!
//! Rejected alternatives (`training.md`, Tried and dropped): accumulators private to each thread (1.2
//! to 1.9 ms a frame before they are merged, while records and their addition take 0.9 to 1.4), sorting
//! the points by component (1.6 to 1.9 ms), and unordered floating-point sums, whose bits differ from
//! run to run.

use super::merging::{TotalShard, row_bytes};
use super::state::{Carry, Totals};
use super::total_scalar::TotalScalar;
use crate::math::real::Real;
use crate::model::conjugate::statistics::{Moments, N_SUMS, TileRecord};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// Maximum number of shards (ranges of components by id); a power of two.
const MAX_SHARDS: usize = 64;

/// Number format of the totals over all frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum UpdateWidth {
    /// 64-bit fixed point, with separate high limbs for sums that overflow.
    Fixed64,
    /// 128-bit fixed point.
    Fixed128,
}

/// Totals of all components over all frames so far.
pub struct Statistics {
    form: Form,
    components: usize,
    /// Binary logarithm of the number of components per shard.
    shard_bits: u32,
    used: usize,
    touched: Vec<u32>,
    frame: u32,
}

enum Form {
    Fixed64(Vec<TotalShard<i64>>),
    Fixed128(Vec<TotalShard<i128>>),
}

macro_rules! any_form {
    ($form:expr, $shards:ident => $body:expr) => {
        match $form {
            Form::Fixed64($shards) => $body,
            Form::Fixed128($shards) => $body,
        }
    };
}

impl Statistics {
    /// Creates empty totals of the given number format.
    pub fn new(components: usize, width: UpdateWidth) -> Self {
        let form = match width {
            UpdateWidth::Fixed64 => Form::Fixed64(empty_shards(components)),
            UpdateWidth::Fixed128 => Form::Fixed128(empty_shards(components)),
        };
        Self::from_form(form, components)
    }

    /// Restores totals from a checkpoint.
    pub fn restore(totals: &Totals) -> Self {
        let form = match totals {
            Totals::Fixed64 { rows, carries } => Form::Fixed64(filled_shards(rows, carries)),
            Totals::Fixed128(rows) => Form::Fixed128(filled_shards(rows, &[])),
        };
        Self::from_form(form, totals.len())
    }

    fn from_form(form: Form, components: usize) -> Self {
        let used = any_form!(&form, s => s.iter().map(|s| s.n_used).sum());
        Self {
            form,
            components,
            shard_bits: shard_bits(components),
            used,
            // Reserved for all components, so that a warm frame allocates nothing.
            touched: Vec::with_capacity(components),
            frame: 0,
        }
    }

    /// Returns the current totals.
    pub fn state(&self) -> Totals {
        match &self.form {
            Form::Fixed128(shards) => Totals::Fixed128(rows(shards)),
            Form::Fixed64(shards) => Totals::Fixed64 {
                rows: rows(shards),
                carries: shards
                    .iter()
                    .flat_map(|s| s.carries.iter().map(|(&id, &limbs)| Carry { id, limbs }))
                    // A carry that was cancelled is not part of the sum.
                    .filter(|carry| carry.limbs != [0; N_SUMS])
                    .collect(),
            },
        }
    }

    /// Number of components.
    pub fn len(&self) -> usize {
        self.components
    }

    /// True if there are no components.
    pub fn is_empty(&self) -> bool {
        self.components == 0
    }

    /// Returns the number of components with `N_k > 0`.
    pub fn used(&self) -> usize {
        self.used
    }

    /// Returns the memory of a component's sums, in bytes.
    pub fn row_bytes(&self) -> usize {
        any_form!(&self.form, shards => row_bytes(shards))
    }

    /// Number of shards.
    pub fn shards(&self) -> usize {
        any_form!(&self.form, shards => shards.len())
    }

    /// Returns the binary logarithm of the number of components per shard: component `k` belongs to
    /// shard `k >> shard_bits`.
    pub fn shard_bits(&self) -> u32 {
        self.shard_bits
    }

    /// Adds one frame's records. `of_shard(s, add)` passes the records of shard `s` to `add`, slice by
    /// slice in any order. There is at most one record per tile and component. A record whose count
    /// rounds to zero is skipped.
    pub fn add_frame<R: Real>(
        &mut self,
        of_shard: impl Fn(usize, &mut dyn FnMut(&[TileRecord<R>])) + Sync,
    ) {
        // The stamp would wrap, so that rows of the first frames would appear changed.
        if self.frame == u32::MAX {
            any_form!(&mut self.form, shards => shards.iter_mut().for_each(TotalShard::reset_frame_stamps));
            self.frame = 0;
        }
        self.frame += 1;
        let (frame, bits) = (self.frame, self.shard_bits);
        any_form!(&mut self.form, shards => {
            // The number of records varies a lot between shards: each is its own unit of work.
            shards.par_iter_mut().with_max_len(1).enumerate().for_each(|(s, shard)| {
                shard.add_frame(frame, s << bits, |add| of_shard(s, add));
            });
            self.touched.clear();
            // In the order of shards, which does not depend on threads.
            shards.iter().for_each(|s| self.touched.extend_from_slice(&s.touched));
            self.used = shards.iter().map(|s| s.n_used).sum();
        });
    }

    /// Returns the components that the last frame changed, each once.
    pub fn touched(&self) -> &[u32] {
        &self.touched
    }

    /// Returns the ids of components without points, ascending.
    pub fn unused(&self) -> impl Iterator<Item = u32> {
        (0..self.shards())
            .flat_map(move |s| {
                let used = any_form!(&self.form, shards => &shards[s].used);
                let first = (s as u32) << self.shard_bits;
                used.iter().zip((first..).step_by(64)).flat_map(|(&word, first)| {
                    // Each step clears the lowest set bit. The step after 0 is computed too, but not used.
                    std::iter::successors(Some(!word), |w| Some(w & w.wrapping_sub(1)))
                        .take_while(|&w| w != 0)
                        .map(move |w| first + w.trailing_zeros())
                })
            })
            // The last word of bits may extend beyond the last component.
            .take_while(|&id| (id as usize) < self.components)
    }

    /// Returns the statistics of one component.
    pub fn moments(&self, component: usize) -> Moments {
        let shard = component >> self.shard_bits;
        any_form!(&self.form, shards => shards[shard].moments(component, self.shard_bits))
    }
}

fn shard_bits(components: usize) -> u32 {
    // At least 64 components, one word of the bit set of used rows.
    components.div_ceil(MAX_SHARDS).next_power_of_two().max(64).trailing_zeros()
}

fn empty_shards<T: TotalScalar>(components: usize) -> Vec<TotalShard<T>> {
    let len = 1 << shard_bits(components);
    (0..components).step_by(len).map(|first| TotalShard::new(len.min(components - first))).collect()
}

fn filled_shards<T: TotalScalar>(rows: &[[T; N_SUMS]], carries: &[Carry]) -> Vec<TotalShard<T>> {
    let bits = shard_bits(rows.len());
    let mut shards = empty_shards(rows.len());
    for (id, &sums) in rows.iter().enumerate() {
        let (shard, place) = (&mut shards[id >> bits], id & ((1 << bits) - 1));
        shard.rows[place].sums = sums;
        // A count may be non-zero although its low bits are zero; its carry marks it below.
        if sums[0] != T::default() {
            shard.mark_used(place);
        }
    }
    for carry in carries {
        let (shard, place) = (carry.id as usize >> bits, carry.id as usize & ((1 << bits) - 1));
        shards[shard].carries.insert(carry.id, carry.limbs);
        shards[shard].mark_used(place);
    }
    shards
}

fn rows<T: TotalScalar>(shards: &[TotalShard<T>]) -> Vec<[T; N_SUMS]> {
    shards.iter().flat_map(|s| s.rows.iter().map(|row| row.sums)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    const WIDTHS: [UpdateWidth; 2] = [UpdateWidth::Fixed64, UpdateWidth::Fixed128];

    fn records(components: usize, n: u32, seed: u64) -> Vec<TileRecord<f32>> {
        let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
        let record = |tile| {
            let mut sums = [0.0; N_SUMS];
            sums.fill_with(|| rng.normal() as f32);
            sums[0] = sums[0].abs();
            TileRecord { id: rng.below(components) as u32, tile, sums }
        };
        (0..n).map(record).collect()
    }

    fn add(statistics: &mut Statistics, records: &[TileRecord<f32>]) {
        let bits = statistics.shard_bits();
        statistics.add_frame(|shard, add| {
            records.iter().filter(|r| r.id as usize >> bits == shard).for_each(|r| add(&[*r]));
        });
    }

    #[test]
    fn used_touched_and_unused_follow_the_records() {
        for (components, width) in [1, 63, 64, 65, 5000].into_iter().zip(WIDTHS.iter().cycle()) {
            let mut statistics = Statistics::new(components, *width);
            let all = records(components, components as u32 / 2, 2);
            add(&mut statistics, &all);
            let mut ids: Vec<u32> = all.iter().map(|r| r.id).collect();
            ids.sort_unstable();
            ids.dedup();
            let mut touched = statistics.touched().to_vec();
            touched.sort_unstable();
            assert_eq!(touched, ids);
            assert_eq!(statistics.used(), ids.len());
            let unused: Vec<u32> = statistics.unused().collect();
            let expected: Vec<u32> =
                (0..components as u32).filter(|id| ids.binary_search(id).is_err()).collect();
            assert_eq!(unused, expected);
            let restored = Statistics::restore(&statistics.state());
            assert_eq!(restored.state(), statistics.state());
            assert_eq!(restored.used(), statistics.used());
        }
    }

    #[test]
    fn sums_beyond_64_bits_carry() {
        let mut statistics = Statistics::new(3, UpdateWidth::Fixed64);
        let mut sums = [0.0f32; N_SUMS];
        (sums[0], sums[4], sums[5]) = (3e7, 2.5e4, -2.5e4);
        let record = TileRecord { id: 1, tile: 0, sums };
        for _ in 0..100 {
            add(&mut statistics, &[record]);
        }
        let moments = statistics.moments(1);
        assert_eq!(moments.count, 3e9);
        assert_eq!(moments.second.to_array()[..2], [2.5e6, -2.5e6]);
        let Totals::Fixed64 { carries, .. } = statistics.state() else { panic!("64 bits") };
        assert_eq!(carries.len(), 1);
        let mut restored = Statistics::restore(&statistics.state());
        assert_eq!(restored.used(), 1);
        for statistics in [&mut statistics, &mut restored] {
            add(statistics, &[record]);
        }
        assert_eq!(restored.state(), statistics.state());
    }

    #[test]
    fn counts_that_round_to_nothing_leave_no_moments() {
        let mut sums = [1.0f32; N_SUMS];
        sums[0] = 1e-12;
        let mut statistics = Statistics::new(2, UpdateWidth::Fixed64);
        add(&mut statistics, &[TileRecord { id: 0, tile: 0, sums }]);
        assert_eq!(statistics.used(), 0);
        assert_eq!(statistics.moments(0), Moments::default());
        assert!(statistics.touched().is_empty());
    }
}
