//! Visible records by row of tiles, the rows shared out among the threads.

use super::buckets::Buckets;
use super::record::DepthEntry;
use super::sort::Keyed;
use rayon::prelude::*;
use std::ops::Range;

/// Lists of records by row, each in the order of the sort.
#[derive(Default)]
pub(super) struct RowLists {
    /// Of `rows_each` rows each; the last may have fewer.
    parts: Vec<Buckets>,
    rows_each: usize,
}

impl RowLists {
    /// Lists the sorted records. Every thread goes through all of them and keeps those of its rows,
    /// which costs less than putting partial lists together.
    pub(super) fn fill(&mut self, n_rows: usize, sorted: &[Keyed], listings: &[DepthEntry]) {
        // At least 1, since it divides below.
        self.rows_each = n_rows.div_ceil(rayon::current_num_threads()).max(1);
        self.parts.resize_with(n_rows.div_ceil(self.rows_each), Buckets::default);
        let rows_each = self.rows_each;
        self.parts.par_iter_mut().enumerate().for_each(|(part, lists)| {
            // The last part may be short.
            let own = part * rows_each..((part + 1) * rows_each).min(n_rows);
            let records = sorted.iter().map(|keyed| keyed.record);
            lists.fill(own.len(), records, |i| within(&own, listings[i as usize].tile_rows()));
        });
    }

    /// Records of one row.
    pub(super) fn get(&self, row: usize) -> &[u32] {
        self.parts[row / self.rows_each].get(row % self.rows_each)
    }
}

/// The part of `rows` that lies in `own`, counted from its start.
fn within(own: &Range<usize>, rows: Range<usize>) -> Range<usize> {
    rows.start.clamp(own.start, own.end) - own.start..rows.end.clamp(own.start, own.end) - own.start
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::record::Rect;

    #[test]
    fn rows_list_the_same_whoever_lists_them() {
        let rects =
            [(0, 40), (33, 48), (5, 6), (0, 80)].map(|(y0, y1)| Rect { x0: 0, x1: 1, y0, y1 });
        let listings = rects.map(|rect| DepthEntry::new(1.0, &rect));
        let sorted = [3, 1, 0, 2].map(|record| Keyed { key: 0, record });
        for n_threads in [1, 2, 3, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let mut rows = RowLists::default();
            pool.install(|| rows.fill(5, &sorted, &listings));
            let lists: Vec<&[u32]> = (0..5).map(|row| rows.get(row)).collect();
            assert_eq!(lists, [&[3, 0, 2][..], &[3, 0], &[3, 1, 0], &[3], &[3]], "{n_threads}");
        }
    }
}
