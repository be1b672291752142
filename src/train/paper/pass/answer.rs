//! Integrates a device's results into a pass.

use super::{Pass, TileRecord};
use crate::model::conjugate::statistics::{N_SUMS, RECORD_WORDS};
use crate::model::paper::mixture_device::DevicePass;
use crate::train::timing::StageClock;
use rayon::prelude::*;
use std::sync::PoisonError;

/// Smaller counts round to zero in the totals, so their records are dropped.
const MIN_COUNT: f32 = 1e-11;

/// Minimum number of scores converted per task.
const WIDENED: usize = 1 << 13;

/// Component, tile and bits of the sums.
type RecordBits = (u32, u32, [u32; N_SUMS]);

impl Pass {
    /// Copies scores and records; scores of open tiles are computed later.
    pub(in crate::train::paper) fn adopt_device_pass(
        &self,
        shard_bits: u32,
        found: &DevicePass<'_>,
        q: &mut [f64],
    ) {
        let scores = q.par_iter_mut().zip(found.q).with_min_len(WIDENED);
        // In parallel, because both are dominated by the time to wake threads.
        rayon::join(
            || scores.for_each(|(q, &found)| *q = found.into()),
            || self.adopt_records(shard_bits, found.records),
        );
    }

    fn adopt_records(&self, shard_bits: u32, records: &[[u32; RECORD_WORDS]]) {
        // Equal parts per worker, whichever thread runs them, so that warm buffers suffice.
        let each = records.len().div_ceil(self.workers.len()).max(1);
        self.workers.par_iter().zip(records.par_chunks(each)).for_each(|(worker, records)| {
            let mut worker = worker.write().unwrap_or_else(PoisonError::into_inner);
            for words in records {
                let record = TileRecord::from_words(words);
                worker.narrow[record.id as usize >> shard_bits].push(record);
            }
        });
    }

    /// Adds the times of another clock to the CPU's.
    pub(in crate::train::paper) fn add_clock(&self, mut clock: StageClock) {
        self.worker().clock.add(clock.take_nanos());
    }

    /// Records of the last pass that affect the totals, sorted for comparison.
    pub(in crate::train::paper) fn effective_records(&self) -> Vec<RecordBits> {
        let mut kept = Vec::new();
        for worker in self.read_workers() {
            let records = worker.narrow.iter().flatten().filter(|r| r.sums[0] >= MIN_COUNT);
            // Adding 0.0 unifies zeros of either sign.
            kept.extend(records.map(|r| (r.id, r.tile, r.sums.map(|sum| (sum + 0.0).to_bits()))));
        }
        kept.sort_unstable();
        kept
    }
}
