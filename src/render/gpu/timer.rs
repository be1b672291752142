//! Measures the stages of an image on the GPU without blocking.
//!
//! Reading a timestamp immediately would make the CPU wait for the GPU in every frame. Results pass through
//! a ring of buffers and arrive some frames late, which suffices for choosing the path and for display.

use super::path::{DrawPath, GpuTimes};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Measured stage, in execution order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GpuStage {
    Preprocess,
    Sort,
    Draw,
}

const N_STAGES: u32 = 3;
/// Each stage is one pass with a timestamp at its start and end.
const STAGE_BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

/// Timestamps of the last images.
#[derive(Debug)]
pub(super) struct StageTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ring: ReadbackRing,
    /// Path measured by each slot.
    paths: [DrawPath; N_SLOTS],
    milliseconds_per_tick: f64,
    latest: Option<(DrawPath, GpuTimes)>,
    is_new: bool,
}

impl StageTimer {
    /// `None` if the device has no timestamps.
    pub(super) fn new(device: &wgpu::Device, queue: &wgpu::Queue) -> Option<Self> {
        if !device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
            return None;
        }
        let bytes = u64::from(N_STAGES) * STAGE_BYTES;
        Some(Self {
            queries: device.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("stage times"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * N_STAGES * N_SLOTS as u32,
            }),
            resolved: device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("resolved stage times"),
                size: bytes,
                usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            ring: ReadbackRing::new(device, "read stage times", bytes),
            paths: [DrawPath::Quads; N_SLOTS],
            milliseconds_per_tick: f64::from(queue.get_timestamp_period()) * 1e-6,
            latest: None,
            is_new: false,
        })
    }

    /// Collects arrived results and reserves a slot for an image drawn by `path`; `None` if the GPU is
    /// behind.
    pub(super) fn reserve_slot(&mut self, path: DrawPath) -> Option<usize> {
        let Self { ring, paths, latest, is_new, .. } = self;
        let slot = ring.collect_and_reserve(|slot, bytes| {
            if let Some(times) = times(paths[slot], bytes, self.milliseconds_per_tick) {
                *latest = Some((paths[slot], times));
                *is_new = true;
            }
        })?;
        self.paths[slot] = path;
        Some(slot)
    }

    /// Timestamp writes for the compute pass of a stage.
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

    /// Timestamp writes for the render pass of a stage.
    pub(super) fn of_render(
        &self,
        slot: usize,
        stage: GpuStage,
    ) -> wgpu::RenderPassTimestampWrites<'_> {
        let first = first_query(slot, stage);
        wgpu::RenderPassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(first),
            end_of_pass_write_index: Some(first + 1),
        }
    }

    /// Resolves the timestamps and sends them to the CPU. Must follow the passes in the same encoder.
    pub(super) fn end(&self, encoder: &mut wgpu::CommandEncoder, slot: usize) {
        let stages = stages_of(self.paths[slot]);
        let first = first_query(slot, stages[0]);
        let end = first + 2 * stages.len() as u32;
        encoder.resolve_query_set(&self.queries, first..end, &self.resolved, 0);
        self.ring.send(encoder, slot, &self.resolved, stages.len() as u64 * STAGE_BYTES);
    }

    /// Most recent measurement.
    pub(super) fn latest(&self) -> Option<GpuTimes> {
        self.latest.map(|(_, times)| times)
    }

    /// Most recent measurement and its path, if not taken before.
    pub(super) fn take_latest(&mut self) -> Option<(DrawPath, GpuTimes)> {
        // The choice of path must count each measurement once.
        std::mem::take(&mut self.is_new).then_some(self.latest).flatten()
    }
}

/// Stages of a path, which are always the last ones of [`GpuStage`].
fn stages_of(path: DrawPath) -> &'static [GpuStage] {
    match path {
        DrawPath::Quads => &[GpuStage::Draw],
        DrawPath::Tiles => &[GpuStage::Preprocess, GpuStage::Sort, GpuStage::Draw],
    }
}

fn first_query(slot: usize, stage: GpuStage) -> u32 {
    2 * (N_STAGES * slot as u32 + stage as u32)
}

/// Times in milliseconds; `None` if the GPU's clock ran backwards, for example after a reset or sleep.
fn times(path: DrawPath, bytes: &[u8], milliseconds_per_tick: f64) -> Option<GpuTimes> {
    let mut out = GpuTimes { preprocess: None, sort: None, draw: 0.0 };
    for (&stage, bytes) in stages_of(path).iter().zip(bytes.chunks_exact(STAGE_BYTES as usize)) {
        let [begin, end]: [u64; 2] = bytemuck::pod_read_unaligned(bytes);
        // The clock may run backwards after sleep; no result is better than a huge one.
        let elapsed = end.checked_sub(begin)? as f64 * milliseconds_per_tick;
        match stage {
            GpuStage::Preprocess => out.preprocess = Some(elapsed),
            GpuStage::Sort => out.sort = Some(elapsed),
            GpuStage::Draw => out.draw = elapsed,
        }
    }
    Some(out)
}

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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_are_read_where_their_path_wrote_them() {
        let ticks: Vec<u8> =
            [10u64, 14, 20, 26, 30, 40].iter().flat_map(|t| t.to_le_bytes()).collect();
        let tiles = times(DrawPath::Tiles, &ticks, 0.5).unwrap();
        assert_eq!(tiles, GpuTimes { preprocess: Some(2.0), sort: Some(3.0), draw: 5.0 });
        assert_eq!(tiles.total(), 10.0);
        let quads = times(DrawPath::Quads, &ticks, 0.5).unwrap();
        assert_eq!(quads, GpuTimes { preprocess: None, sort: None, draw: 2.0 });
        let backwards: Vec<u8> = [9u64, 8].iter().flat_map(|t| t.to_le_bytes()).collect();
        assert_eq!(times(DrawPath::Quads, &backwards, 1.0), None);
        for path in [DrawPath::Quads, DrawPath::Tiles] {
            let stages = stages_of(path);
            let queries: Vec<u32> = stages.iter().map(|&s| first_query(1, s)).collect();
            assert!(queries.windows(2).all(|pair| pair[1] == pair[0] + 2), "{queries:?}");
        }
    }
}
