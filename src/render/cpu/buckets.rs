//! Lists of records per tile or per row of tiles.

use crate::math::image::split_by_sizes;
use rayon::prelude::*;
use std::ops::Range;

/// One list of records per bucket (a tile or a row of tiles), each in input order.
#[derive(Default)]
pub(super) struct Buckets {
    /// End of each bucket's list in `records`; the next bucket's list starts there.
    ends: Vec<usize>,
    records: Vec<u32>,
}

impl Buckets {
    /// Fills the lists anew. Each record is added to the lists of all buckets in the range that
    /// `touched` returns for the record.
    pub(super) fn fill(
        &mut self,
        n_buckets: usize,
        records: impl Iterator<Item = u32> + Clone,
        touched: impl Fn(u32) -> Range<usize>,
    ) {
        // Buffers are reused: the next image needs lists of about the same size.
        let Self { ends, records: listed } = self;
        count(n_buckets, records.clone(), &touched, ends);
        // Each entry first holds its bucket's start; filling advances it to the end.
        let mut total = 0;
        for end in ends.iter_mut() {
            total += std::mem::replace(end, total);
        }
        listed.resize(total, 0);
        records.for_each(|record| {
            for bucket in touched(record) {
                listed[ends[bucket]] = record;
                ends[bucket] += 1;
            }
        });
    }

    /// Fills the lists anew like [`Self::fill`], in parallel. `runs` are ascending ranges of records;
    /// each task processes `n` of the ranges. A task first counts its entries per bucket, then fills its
    /// own part of each list.
    pub(super) fn fill_parallel(
        &mut self,
        n_buckets: usize,
        runs: &[Range<u32>],
        n: usize,
        touched: impl Fn(u32) -> Range<usize> + Sync,
    ) {
        let Self { ends, records: listed } = self;
        // rayon would merge groups, which differ in their number of records.
        let groups = runs.par_chunks(n).with_max_len(1);
        let count_group = |runs: &[Range<u32>]| {
            let mut counts = Vec::new();
            count(n_buckets, runs.iter().cloned().flatten(), &touched, &mut counts);
            counts
        };
        let counts: Vec<Vec<usize>> = groups.clone().map(count_group).collect();
        // Ordered by list and, within a list, by group.
        let sizes: Vec<usize> =
            (0..n_buckets).flat_map(|i| counts.iter().map(move |of_group| of_group[i])).collect();
        ends.clear();
        ends.extend((0..n_buckets).scan(0, |end, i| {
            let of_groups = &sizes[i * counts.len()..(i + 1) * counts.len()];
            *end += of_groups.iter().sum::<usize>();
            Some(*end)
        }));
        listed.resize(ends.last().copied().unwrap_or(0), 0);
        let mut parts: Vec<Vec<_>> = counts.iter().map(|_| Vec::with_capacity(n_buckets)).collect();
        for (i, piece) in split_by_sizes(listed, sizes.into_iter()).into_iter().enumerate() {
            parts[i % counts.len()].push(piece.iter_mut());
        }
        parts.into_par_iter().zip(groups).for_each(|(mut parts, runs)| {
            for record in runs.iter().cloned().flatten() {
                for part in &mut parts[touched(record)] {
                    // Never `None`: each part has exactly the counted number of slots.
                    if let Some(place) = part.next() {
                        *place = record;
                    }
                }
            }
        });
    }

    /// Returns the end of each bucket's list, and all lists concatenated.
    #[cfg(feature = "gui")]
    pub(super) fn lists(&self) -> (&[usize], &[u32]) {
        (&self.ends, &self.records)
    }

    pub(super) fn get(&self, bucket: usize) -> &[u32] {
        let start = if bucket == 0 { 0 } else { self.ends[bucket - 1] };
        &self.records[start..self.ends[bucket]]
    }

    /// Returns the lists of all buckets as mutable slices, for reordering.
    pub(super) fn each_mut(&mut self) -> Vec<&mut [u32]> {
        let mut start = 0;
        let sizes = self.ends.iter().map(|&end| end - std::mem::replace(&mut start, end));
        split_by_sizes(&mut self.records, sizes)
    }
}

fn count(
    n_buckets: usize,
    records: impl Iterator<Item = u32>,
    touched: impl Fn(u32) -> Range<usize>,
    counts: &mut Vec<usize>,
) {
    counts.clear();
    // One extra entry: a difference array needs no inner loop over a record's buckets.
    counts.resize(n_buckets + 1, 0);
    // `for_each` instead of `for`: internal iteration is faster over flattened ranges.
    records.for_each(|record| {
        let Range { start, end } = touched(record);
        counts[start] = counts[start].wrapping_add(1);
        counts[end] = counts[end].wrapping_sub(1);
    });
    let mut touching = 0usize;
    for count in counts.iter_mut() {
        touching = touching.wrapping_add(*count);
        *count = touching;
    }
    counts.truncate(n_buckets);
}
