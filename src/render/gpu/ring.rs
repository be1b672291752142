//! Asynchronous readback of small results from the GPU.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Results in flight. They are read two frames late, so the third slot is free.
pub(super) const N_SLOTS: usize = 3;

/// Buffers that the GPU fills and the CPU reads in turn.
#[derive(Debug)]
pub(super) struct ReadbackRing {
    slots: [Slot; N_SLOTS],
    next: usize,
}

#[derive(Debug)]
struct Slot {
    buffer: wgpu::Buffer,
    /// True once the buffer is mapped. wgpu's callback holds the second reference while it is pending. If
    /// this is the only reference and the value is false, the slot is free, even if a submission was dropped.
    mapped: Arc<AtomicBool>,
}

impl ReadbackRing {
    /// Creates buffers of `bytes` bytes each.
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

    /// Passes all arrived results to `read`, oldest first, with their slots. Returns a free slot; `None` if
    /// the GPU is behind.
    pub(super) fn collect_and_reserve(
        &mut self,
        mut read: impl FnMut(usize, &[u8]),
    ) -> Option<usize> {
        for age in 0..N_SLOTS {
            let slot = (self.next + age) % N_SLOTS;
            let Slot { buffer, mapped } = &self.slots[slot];
            if mapped.swap(false, Ordering::Acquire) {
                if let Ok(bytes) = buffer.get_mapped_range(..) {
                    read(slot, &bytes);
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
            mapped.store(result.is_ok(), Ordering::Release);
        });
    }
}
