//! Small results that come back from the GPU without anyone waiting for them.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Results under way at once: they are read two frames late, so the third slot is free.
pub(super) const N_SLOTS: usize = 3;

/// Buffers that are filled by the GPU and read by the CPU in turn.
#[derive(Debug)]
pub(super) struct ReadbackRing {
    slots: [Slot; N_SLOTS],
    next: usize,
}

#[derive(Debug)]
struct Slot {
    buffer: wgpu::Buffer,
    /// Set once the buffer is mapped. wgpu's callback holds the other reference while it waits, so
    /// a sole owner of `false` has nothing in flight, even when a submission never came.
    mapped: Arc<AtomicBool>,
}

impl ReadbackRing {
    /// Each result has `bytes` bytes.
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

    /// Reads what has come back, oldest first, each with the slot it was sent from, and takes a free
    /// slot; `None` while the GPU is behind.
    pub(super) fn turn(&mut self, mut read: impl FnMut(usize, &[u8])) -> Option<usize> {
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
        // The callback of a submission still holds its flag: the GPU is behind, and nobody waits
        // for it.
        if Arc::strong_count(&self.slots[slot].mapped) > 1 {
            return None;
        }
        self.next = (slot + 1) % N_SLOTS;
        Some(slot)
    }

    /// Copies the first `bytes` bytes of `source` and sends them on their way to the CPU.
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
