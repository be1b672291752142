//! Records listed under every row of tiles (or tile) that they touch.

use std::ops::Range;

/// Lists of records by bucket, each in the order the records came in.
#[derive(Default)]
pub(super) struct Buckets {
    /// Where each bucket's list ends, and the next one begins.
    ends: Vec<usize>,
    records: Vec<u32>,
}

impl Buckets {
    /// Lists `records` under the buckets that `touched` gives: count, prefix sum, fill.
    pub(super) fn fill(
        &mut self,
        n_buckets: usize,
        records: impl Iterator<Item = u32> + Clone,
        touched: impl Fn(u32) -> Range<usize>,
    ) {
        // Cleared and not made anew: the lists of the next image need about as much room.
        let Self { ends, records: listed } = self;
        ends.clear();
        // One more: what begins and what ends at a bucket is counted, which takes no loop a record.
        ends.resize(n_buckets + 1, 0);
        // Not `for`: what yields the records may be runs of them, which a closure goes through faster.
        records.clone().for_each(|record| {
            let Range { start, end } = touched(record);
            ends[start] = ends[start].wrapping_add(1);
            ends[end] = ends[end].wrapping_sub(1);
        });
        // Each entry first holds where its bucket starts; filling moves it to the end.
        let (mut touching, mut total) = (0usize, 0);
        for end in ends.iter_mut() {
            touching = touching.wrapping_add(std::mem::replace(end, total));
            total += touching;
        }
        ends.truncate(n_buckets);
        listed.resize(total, 0);
        records.for_each(|record| {
            for bucket in touched(record) {
                listed[ends[bucket]] = record;
                ends[bucket] += 1;
            }
        });
    }

    /// Where each bucket's list ends, among the lists laid end to end, and these.
    #[cfg(feature = "gui")]
    pub(super) fn lists(&self) -> (&[usize], &[u32]) {
        (&self.ends, &self.records)
    }

    /// Records of one bucket.
    pub(super) fn get(&self, bucket: usize) -> &[u32] {
        let start = if bucket == 0 { 0 } else { self.ends[bucket - 1] };
        &self.records[start..self.ends[bucket]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bucket_lists_its_records_in_order() {
        let touched = |record: u32| [2..4, 0..1, 3..4, 1..1][record as usize].clone();
        let mut buckets = Buckets::default();
        for _ in 0..2 {
            buckets.fill(5, [3, 2, 1, 0].into_iter(), touched);
            let lists: Vec<&[u32]> = (0..5).map(|bucket| buckets.get(bucket)).collect();
            assert_eq!(lists, [&[1][..], &[], &[0], &[2, 0], &[]]);
        }
        buckets.fill(1, std::iter::empty(), touched);
        assert!(buckets.get(0).is_empty());
    }
}
