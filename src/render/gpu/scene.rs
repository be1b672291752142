//! Splats in GPU memory.
//!
//! Only changes are uploaded (`rendering.md`, Uploads). Few changes are sent as (index, record)
//! pairs and scattered by a compute pass. Many changes are sent as one whole upload, because streaming is
//! faster than scattering. Buffers grow by half, so the number of reallocations is logarithmic in the scene's
//! size.

use super::adapters::max_buffer_bytes;
use super::constants::{SCATTER_GROUP, module};
use super::error::GpuError;
use super::growing::{MIB, allocate, filled_buffer};
use super::layout::{GpuAppearance, GpuSplat, SparseAppearance, SparseSplat, shader};
use super::pipeline::{ComputeKernel, Grid};
use super::task::IN;
use super::textures::GpuTextures;
use crate::model::splat::appearance::{Finishing, SplatView};

// Fraction of changed splats above which the whole scene is uploaded. A sparse record costs 80 bytes
// and a second pass over memory; a streamed one costs 64 bytes (`rendering.md`, Uploads).
const WHOLE_UPLOAD_SHARE: f64 = 0.15;

/// Splat records in GPU memory.
#[derive(Debug)]
pub struct GpuScene {
    scatter_splats: ComputeKernel,
    scatter_appearances: ComputeKernel,
    pub(super) buffers: SceneBuffers,
    n_splats: usize,
    pub(super) finishing: Finishing,
    pub(super) textures: GpuTextures,
}

#[derive(Debug)]
pub(super) struct SceneBuffers {
    pub(super) splats: wgpu::Buffer,
    /// Appearance records; `None` for a scene without appearance.
    pub(super) appearance: Option<wgpu::Buffer>,
    capacity: usize,
}

impl GpuScene {
    /// Uploads every splat. Also restores the scene after a lost device, from the splats on the CPU.
    pub fn new<'a>(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        splats: impl Into<SplatView<'a>>,
    ) -> Result<Self, GpuError> {
        let splats: SplatView<'a> = splats.into();
        let module = module(device, "scatter", shader::SCATTER);
        let mut scene = Self {
            scatter_splats: ComputeKernel::new(device, &module, "scatter_splats"),
            scatter_appearances: ComputeKernel::new(device, &module, "scatter_appearances"),
            buffers: SceneBuffers::new(device, splats, 0)?,
            n_splats: 0,
            finishing: splats.finishing().clone(),
            textures: GpuTextures::default(),
        };
        scene.upload_whole(queue, splats);
        scene.textures.update(device, queue, splats.finishing().textures.as_ref());
        Ok(scene)
    }

    /// Uploads the changes that turn the scene into `splats`. Only the splats in `changed` and those
    /// beyond the previous length may differ from the last call. `changed` may have any order and
    /// repeats. If appearance is added or removed, all splats are uploaded. Textures are uploaded if
    /// the last call had another. Returns the number of bytes uploaded.
    ///
    /// # Errors
    /// [`GpuError::TooManySplats`] or [`GpuError::OutOfMemory`]. In either case the scene keeps its
    /// previous splats.
    pub fn update<'a>(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        changed: &[u32],
        splats: impl Into<SplatView<'a>>,
    ) -> Result<u64, GpuError> {
        let splats: SplatView<'a> = splats.into();
        // Updated even if no splat changed, because crack filling and exposure belong to the scene.
        self.finishing.clone_from(splats.finishing());
        let n_bytes = self.update_splats(device, queue, changed, splats)?;
        Ok(n_bytes + self.textures.update(device, queue, splats.finishing().textures.as_ref()))
    }

    fn update_splats(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        changed: &[u32],
        splats: SplatView<'_>,
    ) -> Result<u64, GpuError> {
        let n_splats = splats.splats().len();
        if n_splats > self.buffers.capacity
            || has_appearance(splats) != self.buffers.appearance.is_some()
        {
            // Created before the old buffers are dropped, so that the scene remains drawable if memory is
            // short.
            self.buffers = SceneBuffers::new(device, splats, self.buffers.capacity)?;
            return Ok(self.upload_whole(queue, splats));
        }
        let n_kept = self.n_splats.min(n_splats);
        let n_dirty = changed.len() + n_splats - n_kept;
        // Above this fraction, streaming is faster than scattering (`rendering.md`, Uploads).
        if n_dirty as f64 > WHOLE_UPLOAD_SHARE * n_splats as f64 {
            return Ok(self.upload_whole(queue, splats));
        }
        let ids: Vec<usize> = changed
            .iter()
            .map(|&id| id as usize)
            .filter(|&id| id < n_kept)
            .chain(n_kept..n_splats)
            .collect();
        Ok(self.upload_some(device, queue, &ids, splats))
    }

    /// Number of splats on the GPU, including empty slots.
    pub fn n_splats(&self) -> usize {
        self.n_splats
    }

    /// Number of splats that fit before the buffers must grow.
    pub fn capacity(&self) -> usize {
        self.buffers.capacity
    }

    fn upload_whole(&mut self, queue: &wgpu::Queue, splats: SplatView<'_>) -> u64 {
        self.n_splats = splats.splats().len();
        let records: Vec<_> = (0..self.n_splats).map(|id| record(splats, id)).collect();
        let n_bytes = write(queue, &self.buffers.splats, &records);
        let Some(buffer) = &self.buffers.appearance else { return n_bytes };
        let all: Vec<_> = (0..self.n_splats).map(|id| appearance(splats, id)).collect();
        n_bytes + write(queue, buffer, &all)
    }

    fn upload_some(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        ids: &[usize],
        splats: SplatView<'_>,
    ) -> u64 {
        self.n_splats = splats.splats().len();
        let records: Vec<SparseSplat> = ids
            .iter()
            .map(|&id| SparseSplat { splat: record(splats, id), index: id as u32, padding: [0; 3] })
            .collect();
        let to = &self.buffers.splats;
        let n_bytes = scatter(device, queue, &self.scatter_splats, to, &records);
        let Some(buffer) = &self.buffers.appearance else { return n_bytes };
        let appearances: Vec<SparseAppearance> = ids
            .iter()
            .map(|&id| SparseAppearance { appearance: appearance(splats, id), index: id as u32 })
            .collect();
        n_bytes + scatter(device, queue, &self.scatter_appearances, buffer, &appearances)
    }
}

/// Returns the record of splat `id`; all zeros for an empty slot and for an invalid splat or
/// appearance.
fn record(splats: SplatView<'_>, id: usize) -> GpuSplat {
    let is_sound = splats.appearance().get(id).is_none_or(|a| GpuAppearance::new(a).is_some());
    if is_sound { GpuSplat::new(&splats.splats()[id]) } else { bytemuck::Zeroable::zeroed() }
}

/// Returns the appearance of splat `id`; zeros if it is invalid, because the splat is then not drawn.
fn appearance(splats: SplatView<'_>, id: usize) -> GpuAppearance {
    GpuAppearance::new(&splats.appearance()[id]).unwrap_or_else(bytemuck::Zeroable::zeroed)
}

fn has_appearance(splats: SplatView<'_>) -> bool {
    !splats.appearance().is_empty()
}

impl SceneBuffers {
    /// Allocates buffers for the splats. If the splats exceed the capacity `before`, the capacity grows
    /// by a factor of at least 1.5, within the adapter's limit.
    fn new(device: &wgpu::Device, splats: SplatView<'_>, before: usize) -> Result<Self, GpuError> {
        let splat_bytes = size_of::<GpuSplat>() as u64;
        let appearance_bytes =
            if has_appearance(splats) { size_of::<GpuAppearance>() as u64 } else { 0 };
        let largest = splat_bytes.max(appearance_bytes);
        let n_splats = splats.splats().len();
        let capacity = if n_splats > before {
            capacity_for(n_splats, before, largest, &device.limits())?
        } else {
            capacity_for(before, 0, largest, &device.limits())?
        };
        let create = |label, bytes_each| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: capacity as u64 * bytes_each,
                usage: IN,
                mapped_at_creation: false,
            })
        };
        let refused = GpuError::OutOfMemory {
            n_splats: capacity,
            mib: (capacity as u64 * (splat_bytes + appearance_bytes)).div_ceil(MIB),
        };
        let (splats, appearance) = allocate(device, refused, || {
            let appearance = (appearance_bytes > 0).then(|| create("appearance", appearance_bytes));
            (create("splats", splat_bytes), appearance)
        })?;
        Ok(Self { splats, appearance, capacity })
    }
}

/// Returns the capacity, in splats, of a buffer for `n_splats` splats of `bytes_each` bytes: at least
/// 1.5 times `before`, within the adapter's limit.
fn capacity_for(
    n_splats: usize,
    before: usize,
    bytes_each: u64,
    limits: &wgpu::Limits,
) -> Result<usize, GpuError> {
    let limit_bytes = max_buffer_bytes(limits);
    let max_splats = (limit_bytes / bytes_each) as usize;
    if n_splats > max_splats {
        return Err(GpuError::TooManySplats {
            n_splats,
            needed_mib: (n_splats as u64 * bytes_each).div_ceil(MIB),
            limit_mib: limit_bytes / MIB,
            max_splats,
        });
    }
    // A binding cannot be empty.
    Ok((before + before / 2).clamp(n_splats.max(1), max_splats))
}

/// Writes records to the start of a buffer. Returns the number of bytes uploaded.
fn write(queue: &wgpu::Queue, to: &wgpu::Buffer, records: &[impl bytemuck::NoUninit]) -> u64 {
    let bytes: &[u8] = bytemuck::cast_slice(records);
    queue.write_buffer(to, 0, bytes);
    bytes.len() as u64
}

/// Scatters changed records with their indices into `target`, which must contain every index. Returns
/// the number of bytes uploaded.
fn scatter(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    kernel: &ComputeKernel,
    target: &wgpu::Buffer,
    changed: &[impl bytemuck::NoUninit],
) -> u64 {
    // An empty buffer cannot be bound.
    if changed.is_empty() {
        return 0;
    }
    let bytes: &[u8] = bytemuck::cast_slice(changed);
    let list = filled_buffer(device, queue, "changed records", IN, bytes);
    let bound = kernel.bind_buffers(device, &[(0, &list), (1, target)]);
    let groups = Grid::groups(changed.len().div_ceil(SCATTER_GROUP as usize));
    let mut encoder = device.create_command_encoder(&Default::default());
    bound.dispatch(&mut encoder.begin_compute_pass(&Default::default()), groups);
    queue.submit([encoder.finish()]);
    bytes.len() as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capacity_grows_by_half_up_to_the_limit() {
        let limits = wgpu::Limits {
            max_buffer_size: 1 << 30,
            max_storage_buffer_binding_size: 1000 * 64,
            ..Default::default()
        };
        for (n_splats, before, expected) in
            [(0, 0, 1), (10, 0, 10), (11, 10, 15), (40, 10, 40), (801, 800, 1000), (1000, 10, 1000)]
        {
            assert_eq!(
                capacity_for(n_splats, before, 64, &limits).unwrap(),
                expected,
                "{n_splats}"
            );
        }
    }

    #[test]
    fn too_many_splats_are_refused_with_numbers() {
        let limits = wgpu::Limits {
            max_buffer_size: 256 * MIB,
            max_storage_buffer_binding_size: 128 * MIB,
            ..Default::default()
        };
        let message = capacity_for(3_000_000, 0, 64, &limits).unwrap_err().to_string();
        assert_eq!(
            message,
            "3000000 splats need 184 MiB, but this adapter binds at most 128 MiB: use at most \
             2097152 splats or the CPU renderer"
        );
    }
}
