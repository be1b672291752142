//! Totals of a range of consecutive components, updated by one thread at a time.

use super::total_scalar::TotalScalar;
use crate::math::real::Real;
use crate::model::conjugate::statistics::{Moments, N_SUMS, TileRecord};
use std::collections::BTreeMap;

// Records whose rows are prefetched together. With the frame stamp in the first cache line this is two to
// three times as fast as row by row.
const ROWS_AHEAD: usize = 16;

pub(super) struct TotalShard<T: TotalScalar> {
    pub rows: Vec<TotalRow<T>>,
    /// High limbs of the components that have any.
    pub carries: BTreeMap<u32, [i32; N_SUMS]>,
    /// Bit `i` of word `j` is set if row `64 j + i` has received points.
    pub used: Vec<u64>,
    pub n_used: usize,
    /// Ids of the rows changed by the current frame, each once.
    pub touched: Vec<u32>,
    /// Scratch buffer for records that must be sorted.
    sorted: Vec<TileRecord<f64>>,
}

/// Row of sums; two cache lines in 64-bit form.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct TotalRow<T> {
    /// Frame that last changed the row.
    frame: u32,
    /// Sums in the order of [`N_SUMS`]; low bits if high limbs are stored separately.
    pub sums: [T; N_SUMS],
}

pub(super) fn row_bytes<T: TotalScalar>(_: &[TotalShard<T>]) -> usize {
    size_of::<TotalRow<T>>()
}

impl<T: TotalScalar> TotalShard<T> {
    pub fn new(len: usize) -> Self {
        Self {
            rows: vec![TotalRow { frame: 0, sums: [T::default(); N_SUMS] }; len],
            carries: BTreeMap::new(),
            used: vec![0; len.div_ceil(64)],
            n_used: 0,
            touched: Vec::with_capacity(len),
            sorted: Vec::new(),
        }
    }

    /// Resets the frame stamps of all rows.
    pub fn reset_frame_stamps(&mut self) {
        self.rows.iter_mut().for_each(|row| row.frame = 0);
    }

    /// Adds the records of one frame; the first row belongs to component `first`.
    pub fn add_frame<R: Real>(
        &mut self,
        frame: u32,
        first: usize,
        records: impl FnOnce(&mut dyn FnMut(&[TileRecord<R>])),
    ) {
        self.touched.clear();
        if !T::ORDERED {
            return records(&mut |records| self.add_records(frame, first, records));
        }
        let mut sorted = std::mem::take(&mut self.sorted);
        sorted.clear();
        records(&mut |records| {
            let widened = |r: &TileRecord<R>| TileRecord {
                id: r.id,
                tile: r.tile,
                sums: r.sums.map(R::to_f64),
            };
            sorted.extend(records.iter().map(widened));
        });
        // A tile has at most one record per component: keys are unique, so the order is well defined.
        sorted.sort_unstable_by_key(|record| (record.id, record.tile));
        self.add_records(frame, first, &sorted);
        self.sorted = sorted;
    }

    /// Prefetches the rows of a group of records before adding to any of them, to hide memory latency.
    #[inline(always)]
    fn add_records<R: Real>(&mut self, frame: u32, first: usize, records: &[TileRecord<R>]) {
        for records in records.chunks(ROWS_AHEAD) {
            for record in records {
                self.prefetch_and_mark(frame, record.id as usize - first, record);
            }
            for record in records {
                self.add(record.id as usize - first, record);
            }
        }
    }

    #[inline(always)]
    fn prefetch_and_mark<R: Real>(&mut self, frame: u32, place: usize, record: &TileRecord<R>) {
        let row = &mut self.rows[place];
        // The value is not used: reading it fetches the row's second cache line.
        std::hint::black_box(row.sums[N_SUMS - 1]);
        let is_new = row.frame != frame;
        if is_new && !T::rounds_to_zero(record.sums[0].to_f64()) {
            row.frame = frame;
            self.touched.push(record.id);
            self.mark_used(place);
        }
    }

    #[inline(always)]
    fn add<R: Real>(&mut self, place: usize, record: &TileRecord<R>) {
        let sums = record.sums.map(R::to_f64);
        // All or nothing: otherwise a component that counts as unused would have moments.
        if T::rounds_to_zero(sums[0]) {
            return;
        }
        if let Some(limbs) = T::add(&mut self.rows[place].sums, &sums) {
            let carry = self.carries.entry(record.id).or_insert([0; N_SUMS]);
            carry.iter_mut().zip(limbs).for_each(|(c, l)| *c = c.saturating_add(l));
        }
    }

    pub fn mark_used(&mut self, place: usize) {
        let (word, bit) = (&mut self.used[place / 64], 1 << (place % 64));
        self.n_used += usize::from(*word & bit == 0);
        *word |= bit;
    }

    /// Returns the statistics of one component of the shard, about its initial mean.
    pub fn moments(&self, component: usize, shard_bits: u32) -> Moments {
        let row = &self.rows[component & ((1 << shard_bits) - 1)];
        let none = [0; N_SUMS];
        // Few models have carries at all: this avoids a lookup per component.
        let limbs = match self.carries.is_empty() {
            true => &none,
            false => self.carries.get(&(component as u32)).unwrap_or(&none),
        };
        Moments::from_sums(std::array::from_fn(|i| row.sums[i].value(limbs[i], i)))
    }
}
