//! Passes of the published algorithm over frames, on a GPU (`training.md`, On a device).
//!
//! A frame is uploaded once, through mapped memory filled by all threads. Only moved means are uploaded, and
//! the GPU sorts all means into cells. One kernel searches, scores and sums, with one workgroup per tile.
//! One readback returns the scores, the sums of tiles, and the tiles left to the CPU. The capacity for sums
//! is estimated from the last pass; if it is too small, the pass is repeated.

pub mod layout;

use super::adapters::GpuCaps;
use super::constants::{STRIP_CELLS, module};
use super::error::{GpuError, GpuFaults, pass_failed};
use super::growing::copy_pieces;
use super::kernel::{BoundKernel, ComputeKernel, Grid};
use super::readback::{release_result, wait_for_result};
use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::inspection::DeviceError;
use crate::model::paper::mixture_device::{
    DevicePass, GridShape, MAX_TILE_POINTS, MeanCells, MixtureDevice, PassRule, PointColumns,
};
use layout::{
    Frame, HEAD_WORDS, Index, Mean, Memory, OF_FRAME, OF_INDEX, OF_MEANS, Part, PassSizes, READ,
    RECORD_BYTES,
};
use rayon::prelude::*;

/// Minimum capacity for records.
const MIN_RECORDS: u64 = 4096;
/// Means packed per task.
const PACKED: usize = 1 << 14;

/// Runs passes on its own device.
pub struct GpuMixture {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    name: String,
    kernel: ComputeKernel,
    index: IndexKernels,
    memory: Memory,
    /// Kernels bound to the current buffers; `None` if a buffer was replaced.
    bound: Option<(BoundKernel, BoundIndex)>,
    load: PassSizes,
    /// Capacity for records in the next pass with sums.
    record_capacity: u64,
    cells: GridShape,
    packed: Vec<Mean>,
    /// Uploads written to mapped memory, to be submitted with the next pass.
    pending_uploads: Vec<Upload>,
    /// Mapped result of the last pass.
    mapped_result: Option<wgpu::BufferView>,
}

/// Parts that are uploaded together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Upload {
    /// Staging buffer.
    from: Part,
    /// Parts in the order of the staging buffer.
    parts: &'static [Part],
}

const FRAME_UPLOAD: Upload = Upload { from: Part::Upload, parts: &OF_FRAME };
const MEAN_UPLOAD: Upload = Upload { from: Part::MeanUpload, parts: &OF_MEANS };

impl GpuMixture {
    /// Creates the kernels on a device that reports to `faults`.
    pub fn new(
        device: wgpu::Device,
        queue: wgpu::Queue,
        faults: GpuFaults,
        caps: &GpuCaps,
    ) -> Self {
        let shader = module(&device, "pass over a frame", layout::PASS);
        Self {
            kernel: ComputeKernel::new(&device, &shader, "run"),
            index: IndexKernels::new(&device),
            memory: Memory::new(&device),
            bound: None,
            device,
            queue,
            faults,
            name: caps.to_string(),
            load: PassSizes::default(),
            record_capacity: MIN_RECORDS,
            cells: GridShape::default(),
            packed: Vec::new(),
            pending_uploads: Vec::new(),
            mapped_result: None,
        }
    }

    fn upload_means(&mut self, means: &MeanCells<'_>) -> Result<(), GpuError> {
        let &MeanCells { shape, space, color, weight, changed_components: moved } = means;
        // If the previous upload was never submitted, the GPU lacks its changes: upload all means.
        let moved = moved.filter(|_| !self.pending_uploads.contains(&MEAN_UPLOAD));
        self.cells = shape;
        self.load.means = space.len() as u64;
        self.load.moved = moved.map_or(space.len(), <[u32]>::len) as u64;
        self.load.cells = shape.n_cells() as u64;
        self.make_room(&OF_INDEX)?;
        self.make_room(&OF_MEANS)?;
        let mut packed = std::mem::take(&mut self.packed);
        packed.resize(self.load.moved as usize, Mean::default());
        packed.par_chunks_mut(PACKED).enumerate().for_each(|(task, packed)| {
            for (i, packed) in (task * PACKED..).zip(packed) {
                let id = moved.map_or(i as u32, |moved| moved[i]);
                let at = id as usize;
                let (position, weight, color) = (space[at], weight[at], color[at]);
                *packed = Mean { position, weight, color, id };
            }
        });
        let written = self.stage_upload(MEAN_UPLOAD, [bytemuck::cast_slice(&packed)].into_iter());
        self.packed = packed;
        written
    }

    fn upload_points(&mut self, points: &PointColumns<'_>) -> Result<(), GpuError> {
        let PointColumns { columns, tiles } = *points;
        if tiles.windows(2).any(|tile| tile[1] - tile[0] > MAX_TILE_POINTS as u32) {
            let reason = format!("expected at most {MAX_TILE_POINTS} points per tile, found more");
            return Err(GpuError::NoPass { reason });
        }
        self.load.points = columns[0].len() as u64;
        self.load.tiles = tiles.len().saturating_sub(1) as u64;
        self.make_room(&OF_FRAME)?;
        self.make_room(&[Part::Distances, Part::Outcome])?;
        let columns = columns.map(bytemuck::cast_slice);
        self.stage_upload(FRAME_UPLOAD, columns.into_iter().chain([bytemuck::cast_slice(tiles)]))
    }

    /// Writes data to mapped memory for the next pass, in the order of the parts.
    fn stage_upload<'a>(
        &mut self,
        upload: Upload,
        pieces: impl Iterator<Item = &'a [u8]>,
    ) -> Result<(), GpuError> {
        self.make_room(&[upload.from])?;
        let buffer = self.memory.buffer(upload.from);
        let bytes = self.load.bytes(upload.from);
        copy_pieces(buffer, bytes, pieces).map_err(pass_failed)?;
        if !self.pending_uploads.contains(&upload) {
            self.pending_uploads.push(upload);
        }
        Ok(())
    }

    /// Runs a pass with capacity for `load.records` records. Returns the numbers of records and of open
    /// tiles; records beyond the capacity are counted but not stored.
    fn run(&mut self, rule: &PassRule, with_sums: bool) -> Result<[u64; 2], GpuError> {
        self.make_room(&[Part::Records, Part::Readback])?;
        let Self { device, queue, memory, load, .. } = self;
        let sizes = [load.points, load.tiles, load.records].map(|n| n as usize);
        let frame = Frame::new(&self.cells, rule, sizes, with_sums);
        queue.write_buffer(memory.buffer(Part::Frame), 0, bytemuck::bytes_of(&frame));
        let mut encoder = device.create_command_encoder(&Default::default());
        let bound = self.bound.take().unwrap_or_else(|| self.bind());
        self.record(&mut encoder, &bound);
        self.bound = Some(bound);
        let readback = self.memory.buffer(Part::Readback);
        let bytes = self.load.bytes(Part::Readback);
        let uploads = self.pending_uploads.iter().map(|upload| self.memory.buffer(upload.from));
        uploads.clone().for_each(wgpu::Buffer::unmap);
        let submission = self.queue.submit([encoder.finish()]);
        let answer =
            wait_for_result(&self.device, &self.faults, submission, (readback, bytes), uploads)
                .map_err(pass_failed)?;
        self.pending_uploads.clear();
        let head: [u32; HEAD_WORDS as usize] =
            bytemuck::pod_read_unaligned(&answer[..HEAD_WORDS as usize * 4]);
        self.mapped_result = Some(answer);
        Ok(head.map(u64::from))
    }

    /// Ensures the size of some parts, whose contents may be lost.
    fn make_room(&mut self, parts: &[Part]) -> Result<(), GpuError> {
        let is_other = self.memory.ensure_capacity(&self.device, &self.load, parts);
        if !matches!(is_other, Ok(false)) {
            self.bound = None;
        }
        is_other.map(drop)
    }

    fn bind(&self) -> (BoundKernel, BoundIndex) {
        use Part::*;
        let parts = [Frame, Points, Tiles, Starts, Means, Appearance, Distances, Records, Outcome];
        let resource = |(at, part)| (at, self.memory.buffer(part).as_entire_binding());
        let resources: Vec<_> = (0..).zip(parts).map(resource).collect();
        let index = self.index.bind(&self.device, &self.memory);
        (self.kernel.bind(&self.device, &resources), index)
    }

    fn record(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        (bound, index): &(BoundKernel, BoundIndex),
    ) {
        let Self { memory, load, .. } = self;
        let copy = |encoder: &mut wgpu::CommandEncoder, (from, at), (to, by), bytes| {
            let (from, to) = (memory.buffer(from), memory.buffer(to));
            encoder.copy_buffer_to_buffer(from, at, to, by, bytes);
        };
        for upload in &self.pending_uploads {
            let mut at = 0;
            for &part in upload.parts {
                copy(encoder, (upload.from, at), (part, 0), load.bytes(part));
                at += load.bytes(part);
            }
        }
        if self.pending_uploads.contains(&MEAN_UPLOAD) {
            index.record(&self.queue, encoder, memory, load, &self.cells);
        }
        let head = HEAD_WORDS * size_of::<u32>() as u64;
        encoder.clear_buffer(memory.buffer(Part::Outcome), 0, Some(head));
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("pass over a frame"),
            timestamp_writes: None,
        });
        bound.dispatch(&mut pass, Grid::groups(load.tiles as usize));
        drop(pass);
        let mut at = 0;
        for part in READ {
            copy(encoder, (part, 0), (Part::Readback, at), load.bytes(part));
            at += load.bytes(part);
        }
    }

    /// Runs a pass, and repeats it if the capacity for records was too small. Returns the numbers of records
    /// and of open tiles.
    fn run_until_fits(&mut self, rule: &PassRule, with_sums: bool) -> Result<[usize; 2], GpuError> {
        loop {
            self.release_result();
            self.load.records = if with_sums { self.record_capacity } else { 0 };
            let [records, open] = self.run(rule, with_sums)?;
            // Successive frames are similar, so the estimate decays slowly: unused capacity is read back as
            // well.
            let kept = if with_sums {
                self.record_capacity - self.record_capacity / 8
            } else {
                self.record_capacity
            };
            self.record_capacity = kept.max(records + records / 4).max(MIN_RECORDS);
            if records <= self.load.records {
                return Ok([records as usize, open as usize]);
            }
        }
    }

    /// Releases the mapped result.
    fn release_result(&mut self) {
        release_result(&mut self.mapped_result, self.memory.buffer(Part::Readback));
    }

    fn refused(&self, error: &GpuError) -> DeviceError {
        DeviceError { device: self.name.clone(), reason: error.to_string() }
    }
}

impl MixtureDevice for GpuMixture {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn set_means(&mut self, means: &MeanCells<'_>) -> Result<(), DeviceError> {
        self.upload_means(means).map_err(|error| self.refused(&error))
    }

    fn set_points(&mut self, points: &PointColumns<'_>) -> Result<(), DeviceError> {
        self.upload_points(points).map_err(|error| self.refused(&error))
    }

    fn pass(&mut self, rule: &PassRule, with_sums: bool) -> Result<DevicePass<'_>, DeviceError> {
        if self.load.points == 0 {
            // Nothing to dispatch.
            return Ok(DevicePass { q: &[], open: &[], records: &[] });
        }
        let [n_records, n_open] =
            self.run_until_fits(rule, with_sums).map_err(|error| self.refused(&error))?;
        let bytes: &[u8] = self.mapped_result.as_deref().unwrap_or_default();
        let (outcome, rest) = bytes.split_at(self.load.bytes(Part::Outcome) as usize);
        let (q, records) = rest.split_at(self.load.bytes(Part::Distances) as usize);
        let outcome: &[u32] = bytemuck::cast_slice(outcome);
        let records = &records[..n_records * RECORD_BYTES as usize];
        let records: &[u32] = bytemuck::cast_slice(records);
        Ok(DevicePass {
            q: bytemuck::cast_slice(q),
            open: &outcome[HEAD_WORDS as usize..][..n_open],
            records: records.as_chunks::<RECORD_WORDS>().0,
        })
    }
}

/// Kernels of a counting sort in execution order, with their bindings.
struct IndexKernels([(ComputeKernel, &'static [(u32, Part)]); 5]);

/// The kernels of [`IndexKernels`] with bound buffers.
struct BoundIndex([BoundKernel; 5]);

const RENEW: [(u32, Part); 3] = [(0, Part::Index), (1, Part::Moved), (2, Part::Components)];
const COUNT: [(u32, Part); 4] =
    [(0, Part::Index), (2, Part::Components), (3, Part::Starts), (4, Part::Places)];
const ADD: [(u32, Part); 3] = [(0, Part::Index), (3, Part::Starts), (5, Part::Strips)];
const PLACE: [(u32, Part); 6] = [
    (0, Part::Index),
    (2, Part::Components),
    (3, Part::Starts),
    (4, Part::Places),
    (6, Part::Means),
    (7, Part::Appearance),
];

impl IndexKernels {
    fn new(device: &wgpu::Device) -> Self {
        let shader = module(device, "index over means", layout::INDEX);
        let kernel = |entry| ComputeKernel::new(device, &shader, entry);
        Self([
            (kernel("renew"), &RENEW),
            (kernel("count"), &COUNT),
            (kernel("add"), &ADD),
            (kernel("scan"), &ADD),
            (kernel("place"), &PLACE),
        ])
    }

    /// Binds the buffers of every kernel.
    fn bind(&self, device: &wgpu::Device, memory: &Memory) -> BoundIndex {
        BoundIndex(self.0.each_ref().map(|(kernel, parts)| {
            let resource = |&(at, part)| (at, memory.buffer(part).as_entire_binding());
            kernel.bind(device, &parts.iter().map(resource).collect::<Vec<_>>())
        }))
    }
}

impl BoundIndex {
    /// Records the commands that apply the moved means and sort all means.
    fn record(
        &self,
        queue: &wgpu::Queue,
        encoder: &mut wgpu::CommandEncoder,
        memory: &Memory,
        load: &PassSizes,
        shape: &GridShape,
    ) {
        let settings = Index::new(shape, [load.means, load.moved]);
        queue.write_buffer(memory.buffer(Part::Index), 0, bytemuck::bytes_of(&settings));
        encoder.clear_buffer(memory.buffer(Part::Starts), 0, Some(load.bytes(Part::Starts)));
        let strips = (load.cells + 1).div_ceil(STRIP_CELLS.into()) as u32;
        let [moved, means] = [load.moved, load.means].map(|n| Grid::lanes(n as usize));
        let strips = Grid::row(strips);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some("index over means"),
            timestamp_writes: None,
        });
        for (bound, grid) in self.0.iter().zip([moved, means, strips, strips, means]) {
            bound.dispatch(&mut pass, grid);
        }
    }
}
