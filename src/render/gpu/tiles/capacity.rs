//! Capacity for entries. Only the GPU knows how many entries an image needs, and reports it a few
//! frames later. Until then the farthest splats of an image that needs more are left out.

use super::buffers::COUNTS_BYTES;
use crate::render::gpu::constants::slot;
use crate::render::gpu::error::GpuError;
use crate::render::gpu::ring::ReadbackRing;

/// Initial estimate of entries per splat.
const PER_SPLAT: u64 = 4;
const MIN_ENTRIES: u64 = 1 << 16;

/// Tracks the entries that images need.
#[derive(Debug)]
pub(super) struct EntryDemand {
    ring: ReadbackRing,
    /// Maximum number of entries needed since the last [`Self::capacity`].
    needed: u64,
    /// Smallest capacity for which allocation failed.
    refused: u64,
    shortage: Option<GpuError>,
}

impl EntryDemand {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let ring = ReadbackRing::new(device, "needed entries", COUNTS_BYTES);
        Self { ring, needed: 0, refused: u64::MAX, shortage: None }
    }

    /// Capacity for the next image. `now` is the current one and `most` the adapter's limit.
    pub(super) fn capacity(&mut self, now: u64, n_splats: usize, most: u64) -> u64 {
        let needed = std::mem::take(&mut self.needed);
        let wanted = capacity_for(needed, now, n_splats, most);
        if needed > 0 {
            // Any capacity below the one that failed may still be available.
            let is_short = needed > most.min(self.refused - 1);
            self.shortage =
                is_short.then_some(GpuError::TooManyEntries { needed, capacity: wanted.max(now) });
        }
        if wanted < self.refused { wanted } else { now }
    }

    /// Records that a capacity could not be allocated, so that it is not requested again.
    pub(super) fn record_failure(&mut self, capacity: u64, error: GpuError) {
        self.refused = capacity;
        self.shortage = Some(error);
    }

    /// Shortage that leaves out the farthest splats, if it is permanent.
    pub(super) fn shortage(&self) -> Option<&GpuError> {
        self.shortage.as_ref()
    }

    /// Sends the counters of the image to the CPU. Must follow the image in the same encoder.
    pub(super) fn send(&mut self, encoder: &mut wgpu::CommandEncoder, counts: &wgpu::Buffer) {
        let needed = &mut self.needed;
        let free = self.ring.collect_and_reserve(|_, bytes| {
            let counts: [u32; slot::N_SLOTS] = bytemuck::pod_read_unaligned(bytes);
            *needed = (*needed).max(u64::from(counts[slot::N_NEEDED as usize]));
        });
        if let Some(slot) = free {
            self.ring.send(encoder, slot, counts, COUNTS_BYTES);
        }
    }
}

/// Capacity of 1.5 times what was needed, never below the current one.
fn capacity_for(needed: u64, now: u64, n_splats: usize, most: u64) -> u64 {
    let guess = MIN_ENTRIES.max(PER_SPLAT * n_splats as u64);
    // Extra capacity, because approaching the scene raises the demand frame by frame, and each growth
    // rebuilds the plan.
    let grown = if needed > now { needed + needed / 2 } else { 0 };
    guess.max(grown).max(now).min(most)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capacity_follows_what_is_needed_up_to_the_limit() {
        for (needed, now, n_splats, expected) in [
            (0, 0, 0, MIN_ENTRIES),
            (0, 0, 100_000, 400_000),
            (400_000, 400_000, 100_000, 400_000),
            (400_002, 400_000, 100_000, 600_003),
            (10, 600_003, 100_000, 600_003),
            (900_000, 600_003, 100_000, 1_000_000),
            (u64::from(u32::MAX), 1_000_000, 100_000, 1_000_000),
        ] {
            assert_eq!(capacity_for(needed, now, n_splats, 1_000_000), expected);
        }
    }
}
