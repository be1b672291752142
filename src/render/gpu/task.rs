//! Training tasks on a GPU device of their own: buffers, uploads, dispatches and results of one kind of task.
//!
//! A task declares its parts (buffers with their sizes) and its kernels with the parts that they bind.
//! Buffers grow on demand, and kernels stay bound until a buffer is replaced. Uploads pass through mapped
//! memory, filled by all threads. One readback returns the results. After an error the device is no longer
//! used, so no attempt is made to restore the previous state.

use super::error::{GpuError, GpuFaults};
use super::growing::{GrowingBuffer, copy_pieces};
use super::headless::HeadlessGpu;
use super::pipeline::{BoundKernel, ComputeKernel, Grid};
use crate::model::inspection::DeviceError;
use std::sync::mpsc;
use std::time::Duration;
use wgpu::BufferUsages as Usage;

// Timeout after which the GPU counts as lost.
pub(super) const WAIT_TIMEOUT: Duration = Duration::from_secs(30);

/// Usage of shader inputs, which are filled by copies.
pub(super) const IN: Usage = Usage::STORAGE.union(Usage::COPY_DST);
/// Usage of shader outputs, which are copied for reading back.
pub(super) const OUT: Usage = Usage::STORAGE.union(Usage::COPY_SRC);
pub(super) const SETTINGS: Usage = Usage::UNIFORM.union(Usage::COPY_DST);

pub(super) const WORD: u64 = size_of::<u32>() as u64;

/// One of a task's buffers, identified by its contents.
pub(super) trait TaskPart: Copy + PartialEq + Send + Sync + 'static {
    /// Numbers of items that a task processes.
    type Sizes: Default + Send + Sync;
    const LABEL: &'static str;
    /// Descriptions of all parts, each at the index of its part.
    const ALL: &'static [PartRow<Self>];
    /// Labels of the staging buffers, one per upload.
    const UPLOADS: &'static [&'static str];

    fn index(self) -> usize;

    fn bytes(self, sizes: &Self::Sizes) -> u64 {
        (Self::ALL[self.index()].3)(sizes)
    }
}

/// Description of a part: the part, its label (also used in messages), its usage, and its size in
/// bytes.
pub(super) type PartRow<P> = (P, &'static str, Usage, fn(&<P as TaskPart>::Sizes) -> u64);

pub(super) const fn bytes_of<T>() -> u64 {
    size_of::<T>() as u64
}

/// Binding numbers of a kernel and the parts bound to them.
pub(super) type Bindings<P> = &'static [(u32, P)];

pub(super) struct GpuTask<P: TaskPart> {
    pub(super) device: wgpu::Device,
    queue: wgpu::Queue,
    faults: GpuFaults,
    pub(super) name: String,
    /// Numbers of items for which buffers are allocated, cleared and read back.
    pub(super) sizes: P::Sizes,
    parts: Vec<GrowingBuffer>,
    uploads: Vec<Upload<P>>,
    readback: GrowingBuffer,
    kernels: Vec<TaskKernel<P>>,
    result: Option<wgpu::BufferView>,
}

struct TaskKernel<P: 'static> {
    kernel: ComputeKernel,
    bindings: Bindings<P>,
    /// Kernel with its buffers; `None` before its first run and after a buffer was replaced.
    bound: Option<BoundKernel>,
}

struct Upload<P> {
    staging: GrowingBuffer,
    /// Copies to be made by the next run; empty if nothing was staged since the last run.
    copies: Vec<PartCopy<P>>,
}

struct PartCopy<P> {
    part: P,
    from_byte: u64,
    to_byte: u64,
    bytes: u64,
}

impl<P: TaskPart> GpuTask<P> {
    pub(super) fn new(gpu: HeadlessGpu) -> Self {
        debug_assert!(P::ALL.iter().zip(0..).all(|((part, ..), at)| part.index() == at));
        let HeadlessGpu { device, queue, caps, faults } = gpu;
        let growing = |label, usage| GrowingBuffer::new(&device, label, usage);
        let upload = |&label: &&'static str| Upload {
            staging: growing(label, Usage::MAP_WRITE | Usage::COPY_SRC),
            copies: Vec::new(),
        };
        Self {
            parts: P::ALL.iter().map(|&(_, label, usage, _)| growing(label, usage)).collect(),
            uploads: P::UPLOADS.iter().map(upload).collect(),
            readback: growing("results", Usage::MAP_READ | Usage::COPY_DST),
            device,
            queue,
            faults,
            name: caps.to_string(),
            sizes: P::Sizes::default(),
            kernels: Vec::new(),
            result: None,
        }
    }

    /// Returns the error that the task failed on this device; `reason` describes the cause.
    pub(super) fn failed(&self, reason: impl ToString) -> DeviceError {
        self.refused(&GpuError::TaskFailed { reason: reason.to_string() })
    }

    fn refused(&self, error: &GpuError) -> DeviceError {
        DeviceError { device: self.name.clone(), reason: error.to_string() }
    }

    /// Creates a kernel with values for the shader's override constants. Returns the kernel's index.
    pub(super) fn add_kernel(
        &mut self,
        module: &wgpu::ShaderModule,
        entry: &str,
        constants: &[(&str, f64)],
        bindings: Bindings<P>,
    ) -> usize {
        let kernel = ComputeKernel::specialized(&self.device, module, entry, constants);
        self.kernels.push(TaskKernel { kernel, bindings, bound: None });
        self.kernels.len() - 1
    }

    /// Ensures that the buffers of `parts` are large enough for the current sizes. Returns true if a
    /// buffer was replaced, which loses its contents.
    pub(super) fn ensure_capacity(
        &mut self,
        parts: impl IntoIterator<Item = P>,
    ) -> Result<bool, DeviceError> {
        let mut is_lost = false;
        for part in parts {
            let bytes = part.bytes(&self.sizes);
            let grown = self.parts[part.index()].ensure_capacity(&self.device, bytes);
            if grown.map_err(|error| self.refused(&error))? {
                // Any kernel may bind the replaced buffer.
                self.kernels.iter_mut().for_each(|kernel| kernel.bound = None);
                is_lost = true;
            }
        }
        Ok(is_lost)
    }

    /// Writes pieces to the mapped staging buffer of the upload with index `upload`; the next run
    /// copies the pieces to their parts. Pieces of one part must follow each other. The first part is
    /// written from `first_byte` on, all others from byte 0. Replaces pieces that were staged for this
    /// upload before.
    pub(super) fn stage_upload<'a>(
        &mut self,
        upload: usize,
        first_byte: u64,
        pieces: impl IntoIterator<Item = (P, &'a [u8])>,
    ) -> Result<(), DeviceError> {
        let (mut copies, mut slices): (Vec<PartCopy<P>>, Vec<&[u8]>) = Default::default();
        let mut from_byte = 0;
        for (part, piece) in pieces {
            let bytes = piece.len() as u64;
            match copies.last_mut().filter(|copy| copy.part == part) {
                Some(copy) => copy.bytes += bytes,
                None => {
                    let to_byte = if copies.is_empty() { first_byte } else { 0 };
                    copies.push(PartCopy { part, from_byte, to_byte, bytes });
                }
            }
            from_byte += bytes;
            slices.push(piece);
        }
        let staging = &mut self.uploads[upload].staging;
        let grown = staging.ensure_capacity(&self.device, from_byte);
        let copied = grown.map(|_| copy_pieces(&staging.buffer, from_byte, slices));
        copied.map_err(|error| self.refused(&error))?.map_err(|reason| self.failed(reason))?;
        self.uploads[upload].copies = copies;
        Ok(())
    }

    /// True if pieces are staged for this upload and not copied to their parts yet.
    pub(super) fn is_staged(&self, upload: usize) -> bool {
        !self.uploads[upload].copies.is_empty()
    }

    pub(super) fn write(&self, part: P, contents: &impl bytemuck::NoUninit) {
        self.queue.write_buffer(&self.parts[part.index()].buffer, 0, bytemuck::bytes_of(contents));
    }

    /// Copies the staged uploads, clears the parts `clears` and runs kernels, given by index. Then maps
    /// the parts `read` as the result.
    pub(super) fn run(
        &mut self,
        clears: &[P],
        dispatches: &[(usize, Grid)],
        read: &[P],
    ) -> Result<(), DeviceError> {
        // The view is dropped first, because a buffer with a live view cannot be unmapped.
        if self.result.take().is_some() {
            self.readback.buffer.unmap();
        }
        let bytes = read.iter().map(|part| part.bytes(&self.sizes)).sum();
        let grown = self.readback.ensure_capacity(&self.device, bytes);
        grown.map_err(|error| self.refused(&error))?;
        let commands = self.record(clears, dispatches, read);
        let staged: Vec<&wgpu::Buffer> = self
            .uploads
            .iter()
            .filter(|upload| !upload.copies.is_empty())
            .map(|upload| &upload.staging.buffer)
            .collect();
        // wgpu rejects submissions that use a mapped buffer.
        staged.iter().for_each(|buffer| buffer.unmap());
        let submission = self.queue.submit([commands]);
        // Staging buffers are mapped again here, so that the next upload need not wait.
        let mut maps = vec![(&self.readback.buffer, wgpu::MapMode::Read, bytes)];
        maps.extend(staged.into_iter().map(|buffer| (buffer, wgpu::MapMode::Write, buffer.size())));
        wait_mapped(&self.device, submission, &maps).map_err(|reason| self.failed(reason))?;
        // wgpu reports errors of the device to a callback, not to the failing call.
        if let Some(fault) = self.faults.take_new().into_iter().next() {
            return Err(self.failed(fault));
        }
        // The buffer only grows, so it may be larger than the result.
        let result = self.readback.buffer.get_mapped_range(..bytes);
        self.result = Some(result.map_err(|error| self.failed(error))?);
        self.uploads.iter_mut().for_each(|upload| upload.copies.clear());
        Ok(())
    }

    /// Returns the parts read by the last run, one after another; empty before the first run and after
    /// a failure.
    pub(super) fn result(&self) -> &[u8] {
        self.result.as_deref().unwrap_or_default()
    }

    fn record(
        &mut self,
        clears: &[P],
        dispatches: &[(usize, Grid)],
        read: &[P],
    ) -> wgpu::CommandBuffer {
        let Self { device, sizes, parts, kernels, .. } = self;
        let mut encoder = device.create_command_encoder(&Default::default());
        for Upload { staging, copies } in &self.uploads {
            for &PartCopy { part, from_byte, to_byte, bytes } in copies {
                let to = &parts[part.index()].buffer;
                encoder.copy_buffer_to_buffer(&staging.buffer, from_byte, to, to_byte, bytes);
            }
        }
        for &part in clears {
            encoder.clear_buffer(&parts[part.index()].buffer, 0, Some(part.bytes(sizes)));
        }
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(P::LABEL),
            timestamp_writes: None,
        });
        for &(at, grid) in dispatches {
            let TaskKernel { kernel, bindings, bound } = &mut kernels[at];
            let bound = bound.get_or_insert_with(|| {
                let buffer = |&(at, part): &(u32, P)| (at, &parts[part.index()].buffer);
                kernel.bind_buffers(device, &bindings.iter().map(buffer).collect::<Vec<_>>())
            });
            bound.dispatch(&mut pass, grid);
        }
        // The pass borrows the encoder, and copies follow.
        drop(pass);
        let mut to_byte = 0;
        for part in read {
            let (from, bytes) = (&parts[part.index()].buffer, part.bytes(sizes));
            encoder.copy_buffer_to_buffer(from, 0, &self.readback.buffer, to_byte, bytes);
            to_byte += bytes;
        }
        encoder.finish()
    }
}

/// Waits for a submission and maps the start of each buffer. `maps` holds each buffer, its map mode and
/// the number of bytes.
///
/// # Errors
/// Message from wgpu or the driver.
fn wait_mapped(
    device: &wgpu::Device,
    submission: wgpu::SubmissionIndex,
    maps: &[(&wgpu::Buffer, wgpu::MapMode, u64)],
) -> Result<(), String> {
    let (sender, receiver) = mpsc::sync_channel(maps.len());
    for &(buffer, mode, bytes) in maps {
        let sender = sender.clone();
        buffer.map_async(mode, ..bytes, move |result| {
            // The receiver is gone only if the wait below has already failed.
            let _ = sender.send(result);
        });
    }
    let patiently =
        wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(WAIT_TIMEOUT) };
    device.poll(patiently).map_err(|error| error.to_string())?;
    // All callbacks have run by now, or never will.
    let mut n_mapped = 0;
    for result in receiver.try_iter() {
        result.map_err(|error| error.to_string())?;
        n_mapped += 1;
    }
    if n_mapped < maps.len() { Err("a buffer was never mapped".to_owned()) } else { Ok(()) }
}
