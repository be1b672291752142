//! Stable radix sort of visible splats by depth.

/// A record under its depth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Keyed {
    /// Bits of a positive `f32`, which order like its value.
    pub key: u32,
    /// Index of the record.
    pub record: u32,
}

/// Bits per pass: three passes cover the 31 bits of a positive `f32`, and 2¹¹ counters fit L1.
const DIGIT_BITS: u32 = 11;
const N_DIGITS: usize = 1 << DIGIT_BITS;
const N_PASSES: usize = 3;

/// Least-significant-digit radix sort with its buffer.
#[derive(Default)]
pub(super) struct DepthSorter {
    buffer: Vec<Keyed>,
}

impl DepthSorter {
    /// Sorts by ascending key; equal keys keep their order.
    pub(super) fn sort(&mut self, items: &mut Vec<Keyed>) {
        // All passes are counted in one walk: sorting by a digit leaves the counts of others alone.
        let mut starts = digit_starts(items);
        // Three swaps leave the result in the caller's list, since each pass swaps.
        self.buffer.resize(items.len(), Keyed::default());
        for (pass, starts) in starts.iter_mut().enumerate() {
            for &item in items.iter() {
                let start = &mut starts[digit(item.key, pass)];
                self.buffer[*start as usize] = item;
                *start += 1;
            }
            std::mem::swap(items, &mut self.buffer);
        }
    }
}

#[inline(always)]
fn digit(key: u32, pass: usize) -> usize {
    (key >> (pass as u32 * DIGIT_BITS)) as usize & (N_DIGITS - 1)
}

/// Where each digit's items begin, for every pass.
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
            depths in proptest::collection::vec(prop_oneof![0f32..1e-30, 0.2f32..9.0, Just(1.5), 1e20f32..3e38], 0..300)
        ) {
            let items: Vec<Keyed> = depths
                .iter()
                .enumerate()
                .map(|(i, depth)| Keyed { key: depth.to_bits(), record: i as u32 })
                .collect();
            let mut expected = items.clone();
            expected.sort_by(|a, b| depths[a.record as usize].total_cmp(&depths[b.record as usize]));
            let mut sorted = items;
            DepthSorter::default().sort(&mut sorted);
            prop_assert_eq!(sorted, expected);
        }
    }
}
