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
        self.ends.clear();
        self.ends.resize(n_buckets, 0);
        for record in records.clone() {
            for bucket in touched(record) {
                self.ends[bucket] += 1;
            }
        }
        // Each entry first holds where its bucket starts; filling moves it to the end.
        let mut total = 0;
        for end in &mut self.ends {
            total += std::mem::replace(end, total);
        }
        self.records.resize(total, 0);
        for record in records {
            for bucket in touched(record) {
                self.records[self.ends[bucket]] = record;
                self.ends[bucket] += 1;
            }
        }
    }

    /// Where each bucket's list ends, among the lists laid end to end, and these.
    #[cfg(feature = "gui")]
    pub(super) fn lists(&self) -> (&[usize], &[u32]) {
        (&self.ends, &self.records)
    }

    /// The list of every bucket, to be put in another order.
    pub(super) fn lists_mut(&mut self) -> impl Iterator<Item = &mut [u32]> {
        let (mut rest, mut start) = (&mut self.records[..], 0);
        self.ends.iter().map(move |&end| {
            let (own, later) = std::mem::take(&mut rest).split_at_mut(end - start);
            (rest, start) = (later, end);
            own
        })
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
            let lengths: Vec<usize> = buckets.lists_mut().map(|list| list.len()).collect();
            assert_eq!(lengths, [1, 0, 1, 2, 0]);
        }
        buckets.fill(1, std::iter::empty(), touched);
        assert!(buckets.get(0).is_empty());
    }
}
