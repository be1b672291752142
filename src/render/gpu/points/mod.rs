//! Seeds and sums of a scene's points on a GPU (`scene.md`, On a device).
//!
//! Points are uploaded once per frame, through mapped memory filled by all threads, for both search and sums.
//! Seeds remain on the GPU, and new ones are appended to a hash grid. The grid is rebuilt when the number of
//! buckets grows. Sums are not retained: each frame returns them for the components it touched.

pub mod layout;

use super::adapters::GpuCaps;
use super::constants::{SUM_GROUP, module};
use super::error::{GpuError, GpuFaults, pass_failed};
use super::growing::copy_pieces;
use super::kernel::{BoundKernel, ComputeKernel, Grid};
use super::readback::{release_result, wait_for_result};
use crate::model::inspection::DeviceError;
use crate::model::scene::points_device::{POINT_WORDS, PointsDevice, Seeds, SlotSums};
use crate::model::scene::sums::N_SUMS;
use layout::{Memory, Part, PointSizes, SEED_BYTES, Settings};

/// Minimum number of hash buckets.
const MIN_BUCKETS: u64 = 1 << 12;

/// Searches seeds and sums points on its own device.
pub struct GpuPoints {
    device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    name: String,
    file: ComputeKernel,
    find: ComputeKernel,
    sum: ComputeKernel,
    memory: Memory,
    load: PointSizes,
    search: Settings,
    /// Uploads written to mapped memory, to be submitted with the next commands.
    pending_uploads: Vec<Part>,
    /// Mapped result of the last commands.
    answer: Option<wgpu::BufferView>,
}

impl GpuPoints {
    /// Creates the kernels on a device that reports to `faults`.
    pub fn new(
        device: wgpu::Device,
        queue: wgpu::Queue,
        faults: GpuFaults,
        caps: &GpuCaps,
    ) -> Self {
        let kernel = |entry, shader| {
            ComputeKernel::new(&device, &module(&device, "fit of points", shader), entry)
        };
        Self {
            file: kernel("file", layout::FILE),
            find: kernel("find", layout::FIND),
            sum: kernel("sum", layout::SUM),
            memory: Memory::new(&device),
            device,
            queue,
            faults,
            name: caps.to_string(),
            load: PointSizes::default(),
            search: bytemuck::Zeroable::zeroed(),
            pending_uploads: Vec::new(),
            answer: None,
        }
    }

    fn upload_seeds(&mut self, seeds: &Seeds<'_>) -> Result<(), GpuError> {
        let Self { load, memory, device, .. } = self;
        load.seeds = seeds.positions.len() as u64;
        // At least twice as many buckets as seeds, to keep chains short.
        let buckets = (2 * load.seeds).next_power_of_two().max(MIN_BUCKETS);
        let is_refiled = seeds.are_new || buckets != load.buckets || load.first_new > load.seeds;
        load.buckets = buckets;
        let is_lost = memory.ensure_capacity(device, load, &[Part::Seeds, Part::Heads])?;
        if is_refiled || is_lost || self.pending_uploads.contains(&Part::SeedUpload) {
            load.first_new = 0;
        }
        self.search = Settings::search(seeds);
        let new = &seeds.positions[load.first_new as usize..];
        if new.is_empty() {
            return Ok(());
        }
        let packed: Vec<[f32; 4]> = new.iter().map(|&[x, y, z]| [x, y, z, 0.0]).collect();
        self.stage_upload(Part::SeedUpload, &[bytemuck::cast_slice(&packed)])
    }

    fn upload_points(&mut self, points: &[[u32; POINT_WORDS]]) -> Result<(), GpuError> {
        self.load.points = points.len() as u64;
        let parts = [Part::Points, Part::Nearest];
        self.memory.ensure_capacity(&self.device, &self.load, &parts)?;
        self.stage_upload(Part::PointUpload, &[bytemuck::cast_slice(points)])
    }

    /// Writes data to mapped memory for the next commands.
    fn stage_upload(&mut self, upload: Part, pieces: &[&[u8]]) -> Result<(), GpuError> {
        self.memory.ensure_capacity(&self.device, &self.load, &[upload])?;
        let buffer = self.memory.buffer(upload);
        copy_pieces(buffer, self.load.bytes(upload), pieces.iter().copied())
            .map_err(pass_failed)?;
        if !self.pending_uploads.contains(&upload) {
            self.pending_uploads.push(upload);
        }
        Ok(())
    }

    /// Finds the nearest seed of every point and maps the result.
    fn run_search(&mut self) -> Result<(), GpuError> {
        let Self { load, .. } = *self;
        let settings = self.search.of_frame(load.points, load.first_new, load.buckets);
        self.run(settings, Part::Nearest, |gpu, encoder| {
            if load.first_new == 0 {
                encoder.clear_buffer(gpu.memory.buffer(Part::Heads), 0, None);
            }
            let mut pass = compute_pass(encoder, "seeds of points");
            let new = (load.seeds - load.first_new) as usize;
            if new > 0 {
                let filed = [(0, Part::Settings), (2, Part::Seeds), (3, Part::Heads)];
                gpu.bind(&gpu.file, &filed).dispatch(&mut pass, Grid::lanes(new));
            }
            let found = [
                (0, Part::Settings),
                (1, Part::Points),
                (2, Part::Seeds),
                (3, Part::Heads),
                (4, Part::Nearest),
            ];
            let points = Grid::lanes(load.points as usize);
            gpu.bind(&gpu.find, &found).dispatch(&mut pass, points);
        })?;
        self.load.first_new = load.seeds;
        Ok(())
    }

    /// Sums the points of every slot and maps the result.
    fn run_sums(&mut self, asked: &SlotSums<'_>) -> Result<(), GpuError> {
        if asked.points.len() as u64 != self.load.points {
            let (expected, found) = (self.load.points, asked.points.len());
            let reason = format!("expected slots for {expected} points, found {found}");
            return Err(GpuError::NoPass { reason });
        }
        self.load.slots = asked.seeds.len() as u64;
        let parts = [Part::Fits, Part::References, Part::Sums];
        self.memory.ensure_capacity(&self.device, &self.load, &parts)?;
        let pieces = [bytemuck::cast_slice(asked.points), bytemuck::cast_slice(asked.seeds)];
        self.stage_upload(Part::FitUpload, &pieces)?;
        let bytes = self.load.bytes(Part::Sums);
        let groups = Grid::groups(asked.points.len().div_ceil(SUM_GROUP as usize));
        self.run(Settings::sums(asked), Part::Sums, |gpu, encoder| {
            encoder.clear_buffer(gpu.memory.buffer(Part::Sums), 0, Some(bytes));
            let summed = [
                (0, Part::Settings),
                (1, Part::Points),
                (2, Part::Fits),
                (3, Part::References),
                (4, Part::Sums),
            ];
            let mut pass = compute_pass(encoder, "sums of points");
            gpu.bind(&gpu.sum, &summed).dispatch(&mut pass, groups);
        })
    }

    /// Submits pending uploads and the given commands, then maps the `answer` part.
    fn run(
        &mut self,
        settings: Settings,
        answer: Part,
        commands: impl FnOnce(&Self, &mut wgpu::CommandEncoder),
    ) -> Result<(), GpuError> {
        self.memory.ensure_capacity(&self.device, &self.load, &[Part::Readback])?;
        let to = self.memory.buffer(Part::Settings);
        self.queue.write_buffer(to, 0, bytemuck::bytes_of(&settings));
        let mut encoder = self.device.create_command_encoder(&Default::default());
        self.pending_uploads
            .iter()
            .for_each(|&upload| self.record_upload_copies(&mut encoder, upload));
        commands(self, &mut encoder);
        let (readback, bytes) = (self.memory.buffer(Part::Readback), self.load.bytes(answer));
        encoder.copy_buffer_to_buffer(self.memory.buffer(answer), 0, readback, 0, bytes);
        let uploads = self.pending_uploads.iter().map(|&upload| self.memory.buffer(upload));
        uploads.clone().for_each(wgpu::Buffer::unmap);
        let submission = self.queue.submit([encoder.finish()]);
        let answer =
            wait_for_result(&self.device, &self.faults, submission, (readback, bytes), uploads);
        self.answer = Some(answer.map_err(pass_failed)?);
        self.pending_uploads.clear();
        Ok(())
    }

    /// Records the copy from a staging buffer to its destinations.
    fn record_upload_copies(&self, encoder: &mut wgpu::CommandEncoder, upload: Part) {
        let Self { memory, load, .. } = self;
        let mut copy = |from_byte, part, to_byte, bytes| {
            let (from, to) = (memory.buffer(upload), memory.buffer(part));
            encoder.copy_buffer_to_buffer(from, from_byte, to, to_byte, bytes);
        };
        match upload {
            Part::PointUpload => copy(0, Part::Points, 0, load.bytes(upload)),
            Part::SeedUpload => {
                copy(0, Part::Seeds, load.first_new * SEED_BYTES, load.bytes(upload));
            }
            _ => {
                let bytes = load.bytes(Part::Fits);
                copy(0, Part::Fits, 0, bytes);
                copy(bytes, Part::References, 0, load.bytes(Part::References));
            }
        }
    }

    fn bind(&self, kernel: &ComputeKernel, parts: &[(u32, Part)]) -> BoundKernel {
        let resource = |&(at, part)| (at, self.memory.buffer(part).as_entire_binding());
        kernel.bind(&self.device, &parts.iter().map(resource).collect::<Vec<_>>())
    }

    /// Releases the mapped result.
    fn release_result(&mut self) {
        release_result(&mut self.answer, self.memory.buffer(Part::Readback));
    }

    fn refused(&self, error: &GpuError) -> DeviceError {
        DeviceError { device: self.name.clone(), reason: error.to_string() }
    }
}

fn compute_pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    label: &'a str,
) -> wgpu::ComputePass<'a> {
    let label = Some(label);
    encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label, timestamp_writes: None })
}

impl PointsDevice for GpuPoints {
    fn name(&self) -> String {
        self.name.clone()
    }

    fn set_seeds(&mut self, seeds: &Seeds<'_>) -> Result<(), DeviceError> {
        self.upload_seeds(seeds).map_err(|error| self.refused(&error))
    }

    fn set_points(&mut self, points: &[[u32; POINT_WORDS]]) -> Result<(), DeviceError> {
        self.upload_points(points).map_err(|error| self.refused(&error))
    }

    fn nearest(&mut self) -> Result<&[u32], DeviceError> {
        self.release_result();
        // Without points there is nothing to submit.
        if self.load.points > 0 {
            self.run_search().map_err(|error| self.refused(&error))?;
        }
        Ok(self.answer.as_deref().map_or(&[], bytemuck::cast_slice))
    }

    fn sums(&mut self, asked: &SlotSums<'_>) -> Result<&[[i32; N_SUMS]], DeviceError> {
        self.release_result();
        if !asked.seeds.is_empty() {
            self.run_sums(asked).map_err(|error| self.refused(&error))?;
        }
        let quanta: &[i32] = self.answer.as_deref().map_or(&[], bytemuck::cast_slice);
        Ok(quanta.as_chunks().0)
    }
}
