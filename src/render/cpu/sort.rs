//! Radix sort of record lists by depth, nearest first.

/// Record index with its sort key.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Keyed {
    /// Bits of a positive `f32`, which order like its value.
    key: u32,
    record: u32,
}

/// Bits per pass. Three passes cover the 31 bits of a positive `f32`, and 2¹¹ counters fit L1.
const DIGIT_BITS: u32 = 11;
const N_DIGITS: usize = 1 << DIGIT_BITS;
const N_PASSES: usize = 3;
/// Shorter lists use a comparison sort: they have fewer items than a pass has counters.
const MIN_RADIX_LENGTH: usize = 1024;

/// Least-significant-digit radix sort with reusable buffers.
#[derive(Default)]
pub(super) struct DepthSorter {
    items: Vec<Keyed>,
    buffer: Vec<Keyed>,
}

impl DepthSorter {
    /// Sorts an ascending list of records by depth, which must be positive. Stable.
    pub(super) fn sort(&mut self, records: &mut [u32], depth: impl Fn(u32) -> f32) {
        let Self { items, buffer } = self;
        items.clear();
        let keyed = |&record: &u32| Keyed { key: depth(record).to_bits(), record };
        items.extend(records.iter().map(keyed));
        if items.len() < MIN_RADIX_LENGTH {
            items.sort_unstable_by_key(|item| (item.key, item.record));
        } else {
            // One loop counts the digits of all passes, because reordering leaves the counts unchanged.
            let mut starts = digit_starts(items);
            buffer.resize(items.len(), Keyed::default());
            for (pass, starts) in starts.iter_mut().enumerate() {
                for &item in items.iter() {
                    let start = &mut starts[digit(item.key, pass)];
                    buffer[*start as usize] = item;
                    *start += 1;
                }
                std::mem::swap(items, buffer);
            }
        }
        records.iter_mut().zip(items).for_each(|(record, item)| *record = item.record);
    }
}

#[inline(always)]
fn digit(key: u32, pass: usize) -> usize {
    (key >> (pass as u32 * DIGIT_BITS)) as usize & (N_DIGITS - 1)
}

/// Start of each digit's items, per pass.
fn digit_starts(items: &[Keyed]) -> [[u32; N_DIGITS]; N_PASSES] {
    let mut counts = [[0; N_DIGITS]; N_PASSES];
    for item in items {
        for (pass, counts) in counts.iter_mut().enumerate() {
            counts[digit(item.key, pass)] += 1;
        }
    }
    for counts in &mut counts {
        let mut start = 0;
        for count in counts {
            start += std::mem::replace(count, start);
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn agrees_with_the_stable_sort_of_the_standard_library(
            depths in proptest::collection::vec(prop_oneof![0f32..1e-30, 0.2f32..9.0, Just(1.5), 1e20f32..3e38], 0..300),
            times in prop_oneof![Just(1), Just(20)],
        ) {
            let depth = |record: u32| depths[record as usize % depths.len()];
            let mut sorted: Vec<u32> = (0..(times * depths.len()) as u32).collect();
            let mut expected = sorted.clone();
            expected.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)));
            DepthSorter::default().sort(&mut sorted, depth);
            prop_assert_eq!(sorted, expected);
        }
    }
}
