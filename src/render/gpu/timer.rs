//! How long a render pass takes on the GPU, read back without ever waiting for it.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Measurements under way at once: results are read two frames late, so the third slot is free.
const N_SLOTS: usize = 3;
/// A pass is two timestamps.
const SLOT_BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

/// A ring of begin/end timestamps.
#[derive(Debug)]
pub(super) struct PassTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    slots: [Slot; N_SLOTS],
    next: usize,
    seconds_per_tick: f64,
    latest: Option<Duration>,
}

#[derive(Debug)]
struct Slot {
    readback: wgpu::Buffer,
    /// Set once the buffer is mapped. wgpu's callback holds the other reference while it waits, so
    /// a sole owner of `false` has nothing in flight, even when a submission never came.
    mapped: Arc<AtomicBool>,
}

impl PassTimer {
    /// `None` when the device has no timestamps.
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let buffer = |label, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: SLOT_BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("pass times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * N_SLOTS as u32,
            }),
            resolved: buffer(
                "resolved pass times",
                wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            ),
            slots: std::array::from_fn(|_| Slot {
                readback: buffer(
                    "read pass times",
                    wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ,
                ),
                mapped: Arc::default(),
            }),
            next: 0,
            seconds_per_tick: f64::from(queue.get_timestamp_period()) * 1e-9,
            latest: None,
        })
    }

    /// Collects what has come back and takes a free slot; `None` while the GPU is behind.
    pub(super) fn begin(&mut self) -> Option<usize> {
        for age in 0..N_SLOTS {
            self.collect((self.next + age) % N_SLOTS);
        }
        let slot = self.next;
        if Arc::strong_count(&self.slots[slot].mapped) > 1 {
            return None;
        }
        self.next = (slot + 1) % N_SLOTS;
        Some(slot)
    }

    /// For the descriptor of the pass to be measured.
    pub(super) fn writes(&self, slot: usize) -> wgpu::RenderPassTimestampWrites<'_> {
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * slot as u32),
            end_of_pass_write_index: Some(2 * slot as u32 + 1),
        }
    }

    /// After the pass, in the same encoder: sends its times on their way to the CPU.
    pub(super) fn end(&mut self, encoder: &mut wgpu::CommandEncoder, slot: usize) {
        let first = 2 * slot as u32;
        encoder.resolve_query_set(&self.queries, first..first + 2, &self.resolved, 0);
        let Slot { readback, mapped } = &self.slots[slot];
        encoder.copy_buffer_to_buffer(&self.resolved, 0, readback, 0, SLOT_BYTES);
        let mapped = Arc::clone(mapped);
        encoder.map_buffer_on_submit(readback, wgpu::MapMode::Read, .., move |result| {
            mapped.store(result.is_ok(), Ordering::Release);
        });
    }

    /// The last measurement that came back.
    pub(super) fn latest(&self) -> Option<Duration> {
        self.latest
    }

    fn collect(&mut self, slot: usize) {
        let Slot { readback, mapped } = &self.slots[slot];
        if !mapped.swap(false, Ordering::Acquire) {
            return;
        }
        if let Ok(bytes) = readback.get_mapped_range(..) {
            let ticks: [u64; 2] = bytemuck::pod_read_unaligned(&bytes);
            // A GPU that was reset or put to sleep can run its clock backwards.
            if let Some(elapsed) = ticks[1].checked_sub(ticks[0]) {
                self.latest = Some(Duration::from_secs_f64(elapsed as f64 * self.seconds_per_tick));
            }
        }
        readback.unmap();
    }
}
