//! Measures the stages of an image on the GPU without blocking.
//!
//! Reading a timestamp immediately would make the CPU wait for the GPU in every frame. Results pass through
//! a ring of buffers and arrive some frames late, which suffices for display.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// GPU times of the stages of one image in milliseconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuTimes {
    /// Time for converting splats to records, milliseconds.
    pub preprocess: f64,
    /// Time for sorting records by depth and tile, milliseconds.
    pub sort: f64,
    /// Time for drawing records, milliseconds.
    pub draw: f64,
}

impl GpuTimes {
    /// Sum of the stages, milliseconds.
    pub fn total(&self) -> f64 {
        self.preprocess + self.sort + self.draw
    }
}

/// Stage whose GPU time is measured; the variants are in execution order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GpuStage {
    Preprocess,
    Sort,
    Draw,
}

const N_STAGES: u32 = 3;
// Each stage is one pass with a timestamp at its start and end.
const IMAGE_BYTES: u64 = 2 * N_STAGES as u64 * wgpu::QUERY_SIZE as u64;

#[derive(Debug)]
pub(super) struct StageTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ring: ReadbackRing,
    milliseconds_per_tick: f64,
    pub(super) latest: Option<GpuTimes>,
}

impl StageTimer {
    /// Creates a timer; `None` if the device has no timestamps.
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stage times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * N_STAGES * N_SLOTS as u32,
            }),
            resolved: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("resolved stage times"),
                size: IMAGE_BYTES,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            ring: ReadbackRing::new(device, "read stage times", IMAGE_BYTES),
            milliseconds_per_tick: f64::from(queue.get_timestamp_period()) * 1e-6,
            latest: None,
        })
    }

    /// Collects arrived results and reserves a slot for the next image. `None` if no slot is free
    /// because the GPU is behind.
    pub(super) fn reserve_slot(&mut self) -> Option<usize> {
        let Self { ring, latest, milliseconds_per_tick, .. } = self;
        ring.collect_and_reserve(|bytes| {
            if let Some(times) = times(bytes, *milliseconds_per_tick) {
                *latest = Some(times);
            }
        })
    }

    pub(super) fn of_compute(
        &self,
        slot: usize,
        stage: GpuStage,
    ) -> wgpu::ComputePassTimestampWrites<'_> {
        let first = first_query(slot, stage);
        wgpu::ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Resolves the timestamps of an image and copies them for the CPU. Must be recorded after the
    /// passes in the same encoder.
    pub(super) fn end(&self, encoder: &mut wgpu::CommandEncoder, slot: usize) {
        let first = first_query(slot, GpuStage::Preprocess);
        let end = first + 2 * N_STAGES;
        encoder.resolve_query_set(&self.queries, first..end, &self.resolved, 0);
        self.ring.send(encoder, slot, &self.resolved, IMAGE_BYTES);
    }
}

fn first_query(slot: usize, stage: GpuStage) -> u32 {
    2 * (N_STAGES * slot as u32 + stage as u32)
}

/// Converts the timestamps of an image to stage times; `None` if the GPU's clock ran backwards.
fn times(bytes: &[u8], milliseconds_per_tick: f64) -> Option<GpuTimes> {
    let ticks: [[u64; 2]; N_STAGES as usize] = bytemuck::pod_read_unaligned(bytes);
    let mut stages = [0.0; N_STAGES as usize];
    for (stage, [begin, end]) in stages.iter_mut().zip(ticks) {
        // The clock may run backwards after sleep; no result is better than a huge one.
        *stage = end.checked_sub(begin)? as f64 * milliseconds_per_tick;
    }
    let [preprocess, sort, draw] = stages;
    Some(GpuTimes { preprocess, sort, draw })
}

// Results in flight. They are read two frames late, so the third slot is free.
pub(super) const N_SLOTS: usize = 3;

/// Ring of buffers that the GPU fills and the CPU reads some frames later.
#[derive(Debug)]
pub(super) struct ReadbackRing {
    slots: [Slot; N_SLOTS],
    next: usize,
}

#[derive(Debug)]
struct Slot {
    buffer: wgpu::Buffer,
    /// True once the buffer is mapped. wgpu's callback holds the second reference while it is pending.
    /// The slot is free if the value is false and this is the only reference, even after a dropped
    /// submission.
    mapped: Arc<AtomicBool>,
}

impl ReadbackRing {
    pub(super) fn new(device: &wgpu::Device, label: &str, bytes: u64) -> Self {
        let slots = std::array::from_fn(|_| Slot {
            buffer: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: bytes,
                usage: wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                mapped_at_creation: false,
            }),
            mapped: Arc::default(),
        });
        Self { slots, next: 0 }
    }

    /// Passes all arrived results to `read`, oldest first. Returns a free slot; `None` if there is none
    /// because the GPU is behind.
    pub(super) fn collect_and_reserve(&mut self, mut read: impl FnMut(&[u8])) -> Option<usize> {
        for age in 0..N_SLOTS {
            let slot = (self.next + age) % N_SLOTS;
            let Slot { buffer, mapped } = &self.slots[slot];
            // Acquires what the callback released: the buffer is mapped before it is read.
            if mapped.swap(false, Ordering::Acquire) {
                if let Ok(bytes) = buffer.get_mapped_range(..) {
                    read(&bytes);
                }
                buffer.unmap();
            }
        }
        let slot = self.next;
        // The pending callback of a submission still holds the flag: the GPU is behind, and the
        // CPU does not wait for it.
        if Arc::strong_count(&self.slots[slot].mapped) > 1 {
            return None;
        }
        self.next = (slot + 1) % N_SLOTS;
        Some(slot)
    }

    /// Records a copy of the first `bytes` bytes of `source` to a slot, and maps the slot on submission.
    pub(super) fn send(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        slot: usize,
        source: &wgpu::Buffer,
        bytes: u64,
    ) {
        let Slot { buffer, mapped } = &self.slots[slot];
        encoder.copy_buffer_to_buffer(source, 0, buffer, 0, bytes);
        let mapped = Arc::clone(mapped);
        encoder.map_buffer_on_submit(buffer, wgpu::MapMode::Read, .., move |result| {
            // A failed mapping leaves the slot free.
            mapped.store(result.is_ok(), Ordering::Release);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_read_where_they_were_written() {
        let bytes = |ticks: [u64; 6]| bytemuck::bytes_of(&ticks).to_vec();
        let found = times(&bytes([10, 14, 20, 26, 30, 40]), 0.5).unwrap();
        assert_eq!(found, GpuTimes { preprocess: 2.0, sort: 3.0, draw: 5.0 });
        assert_eq!(found.total(), 10.0);
        assert_eq!(times(&bytes([10, 14, 26, 20, 30, 40]), 1.0), None);
        let stages = [GpuStage::Preprocess, GpuStage::Sort, GpuStage::Draw];
        assert_eq!(stages.map(|stage| first_query(1, stage)), [6, 8, 10]);
    }
}
