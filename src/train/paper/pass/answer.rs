//! What a device found of a pass, taken over as if the processor had found it.

use super::{Pass, TileRecord};
use crate::model::conjugate::statistics::{N_SUMS, RECORD_WORDS};
use crate::model::paper::mixture_device::DevicePass;
use crate::train::timing::StageClock;
use rayon::prelude::*;
use std::sync::PoisonError;

/// Counts below round to nothing in the totals, so that no record of one is kept.
const MIN_COUNT: f32 = 1e-11;

/// Scores that a task widens at least.
const WIDENED: usize = 1 << 13;

/// Number, tile and the bits of the sums.
type RecordBits = (u32, u32, [u32; N_SUMS]);

impl Pass {
    /// Takes over scores and records; scores of open tiles are still to come.
    pub(in crate::train::paper) fn take_over(
        &self,
        shard_bits: u32,
        found: &DevicePass<'_>,
        q: &mut [f64],
    ) {
        let scores = q.par_iter_mut().zip(found.q).with_min_len(WIDENED);
        // Both at once: what threads take to wake is most of either.
        rayon::join(
            || scores.for_each(|(q, &found)| *q = found.into()),
            || self.take_over_records(shard_bits, found.records),
        );
    }

    fn take_over_records(&self, shard_bits: u32, records: &[[u32; RECORD_WORDS]]) {
        // As many to each worker, whoever sorts them: memory that is warm then holds all.
        let each = records.len().div_ceil(self.workers.len()).max(1);
        self.workers.par_iter().zip(records.par_chunks(each)).for_each(|(worker, records)| {
            let mut worker = worker.write().unwrap_or_else(PoisonError::into_inner);
            for words in records {
                let record = TileRecord::from_words(words);
                worker.narrow[record.id as usize >> shard_bits].push(record);
            }
        });
    }

    /// Books the time that a clock has seen on top of the processor's own.
    pub(in crate::train::paper) fn book(&self, mut clock: StageClock) {
        self.worker().clock.add(clock.take());
    }

    /// The records of the last pass that reach the totals, in an order of their own.
    pub(in crate::train::paper) fn kept_records(&self) -> Vec<RecordBits> {
        let mut kept = Vec::new();
        for worker in self.read_workers() {
            let records = worker.narrow.iter().flatten().filter(|r| r.sums[0] >= MIN_COUNT);
            // Zeros of either sign are one number.
            kept.extend(records.map(|r| (r.id, r.tile, r.sums.map(|sum| (sum + 0.0).to_bits()))));
        }
        kept.sort_unstable();
        kept
    }
}
