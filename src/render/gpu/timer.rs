//! How long the stages of an image take on the GPU, read back without ever waiting for them.
//!
//! Reading a timestamp at once would make the CPU wait for the GPU in every frame, so results go
//! through a ring of buffers and arrive some frames late: enough for a choice of path and for the
//! panel that shows them.

use super::path::{DrawPath, GpuTimes};
use super::ring::{N_SLOTS, ReadbackRing};

/// What is measured, in the order in which it happens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GpuStage {
    Preprocess,
    Sort,
    Draw,
}

const N_STAGES: u32 = 3;
/// A stage is one pass: a timestamp at its beginning, one at its end.
const STAGE_BYTES: u64 = 2 * wgpu::QUERY_SIZE as u64;

/// A ring of timestamps.
#[derive(Debug)]
pub(super) struct StageTimer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    ring: ReadbackRing,
    /// Which path each slot measures.
    paths: [DrawPath; N_SLOTS],
    milliseconds_per_tick: f64,
    latest: Option<(DrawPath, GpuTimes)>,
    is_new: bool,
}

impl StageTimer {
    /// `None` when the device has no timestamps.
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

    /// Collects what has come back and takes a free slot for an image by `path`; `None` while the
    /// GPU is behind.
    pub(super) fn begin(&mut self, path: DrawPath) -> Option<usize> {
        let Self { ring, paths, latest, is_new, .. } = self;
        let slot = ring.turn(|slot, bytes| {
            if let Some(times) = times(paths[slot], bytes, self.milliseconds_per_tick) {
                *latest = Some((paths[slot], times));
                *is_new = true;
            }
        })?;
        self.paths[slot] = path;
        Some(slot)
    }

    /// For the descriptor of the compute pass that is a stage.
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

    /// For the descriptor of the render pass that is a stage.
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

    /// After the passes, in the same encoder: sends their times on their way to the CPU.
    pub(super) fn end(&self, encoder: &mut wgpu::CommandEncoder, slot: usize) {
        let stages = stages_of(self.paths[slot]);
        let first = first_query(slot, stages[0]);
        let end = first + 2 * stages.len() as u32;
        encoder.resolve_query_set(&self.queries, first..end, &self.resolved, 0);
        self.ring.send(encoder, slot, &self.resolved, stages.len() as u64 * STAGE_BYTES);
    }

    /// The last measurement that came back.
    pub(super) fn latest(&self) -> Option<GpuTimes> {
        self.latest.map(|(_, times)| times)
    }

    /// The last measurement that came back and the path it is of, once.
    pub(super) fn take(&mut self) -> Option<(DrawPath, GpuTimes)> {
        // The choice of path must count each measurement once.
        std::mem::take(&mut self.is_new).then_some(self.latest).flatten()
    }
}

/// The stages that a path has; the last ones of all.
fn stages_of(path: DrawPath) -> &'static [GpuStage] {
    match path {
        DrawPath::Quads => &[GpuStage::Draw],
        DrawPath::Tiles => &[GpuStage::Preprocess, GpuStage::Sort, GpuStage::Draw],
    }
}

fn first_query(slot: usize, stage: GpuStage) -> u32 {
    2 * (N_STAGES * slot as u32 + stage as u32)
}

/// `None` from a GPU that was reset or put to sleep and ran its clock backwards.
fn times(path: DrawPath, bytes: &[u8], milliseconds_per_tick: f64) -> Option<GpuTimes> {
    let mut out = GpuTimes { preprocess: None, sort: None, draw: 0.0 };
    for (&stage, bytes) in stages_of(path).iter().zip(bytes.chunks_exact(STAGE_BYTES as usize)) {
        let [begin, end]: [u64; 2] = bytemuck::pod_read_unaligned(bytes);
        // A GPU that slept may run its clock backwards; no time is better than a huge one.
        let elapsed = end.checked_sub(begin)? as f64 * milliseconds_per_tick;
        match stage {
            GpuStage::Preprocess => out.preprocess = Some(elapsed),
            GpuStage::Sort => out.sort = Some(elapsed),
            GpuStage::Draw => out.draw = elapsed,
        }
    }
    Some(out)
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
