//! The splats on the GPU and the order in which to draw them.

use super::GpuError;
use super::context::max_buffer_bytes;
use super::layout::{GpuSplat, SparseSplat};
use super::scatter::Scatter;
use crate::model::splats::Splat;
use std::future::Future;
use std::task::{Context, Poll, Waker};

const SPLAT_BYTES: u64 = size_of::<GpuSplat>() as u64;
const MIB: u64 = 1 << 20;
/// Share of changed splats above which the whole scene is uploaded: a sparse record costs 80 bytes
/// and a second pass over memory against 64 bytes streamed (`rendering.md` (d)).
const WHOLE_UPLOAD_SHARE: f64 = 0.15;

/// Splat records and draw order in GPU memory.
#[derive(Debug)]
pub struct GpuScene {
    scatter: Scatter,
    buffers: Buffers,
    n_splats: usize,
    n_order: usize,
}

#[derive(Debug)]
struct Buffers {
    splats: wgpu::Buffer,
    order: wgpu::Buffer,
    capacity: usize,
}

impl GpuScene {
    /// Size of a splat's record, which is what a whole upload sends of each.
    pub const BYTES_PER_SPLAT: u64 = SPLAT_BYTES;

    /// Uploads every splat. Nothing is drawn before [`Self::set_order`]. Also the way back after a
    /// lost device: the splats on the CPU are all it needs.
    pub fn new(
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        splats: &[Splat],
    ) -> Result<Self, GpuError> {
        let mut scene = Self {
            scatter: Scatter::new(device),
            buffers: Buffers::new(device, capacity_for(splats.len(), 0, &device.limits())?)?,
            n_splats: 0,
            n_order: 0,
        };
        scene.upload_whole(queue, splats);
        Ok(scene)
    }

    /// Brings the GPU to `splats`, of which only `changed` (any order, repeats allowed) and those
    /// past the previous length differ from the last call. Returns the bytes uploaded. On an error
    /// the scene draws on as it was. The order stays valid unless there are fewer splats than
    /// before, which empties it.
    pub fn update(
        &mut self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        changed: &[u32],
        splats: &[Splat],
    ) -> Result<u64, GpuError> {
        if splats.len() > self.buffers.capacity {
            let capacity = capacity_for(splats.len(), self.buffers.capacity, &device.limits())?;
            let grown = Buffers::new(device, capacity)?;
            let mut encoder = device.create_command_encoder(&Default::default());
            encoder.copy_buffer_to_buffer(
                &self.buffers.order,
                0,
                &grown.order,
                0,
                self.buffers.order.size(),
            );
            queue.submit([encoder.finish()]);
            self.buffers = grown;
            return Ok(self.upload_whole(queue, splats));
        }
        let n_kept = self.n_splats.min(splats.len());
        let n_dirty = changed.len() + splats.len() - n_kept;
        if n_dirty as f64 > WHOLE_UPLOAD_SHARE * splats.len() as f64 {
            return Ok(self.upload_whole(queue, splats));
        }
        let records: Vec<SparseSplat> = changed
            .iter()
            .map(|&id| id as usize)
            .filter(|&id| id < n_kept)
            .chain(n_kept..splats.len())
            .map(|id| SparseSplat {
                splat: GpuSplat::new(&splats[id]),
                index: id as u32,
                padding: [0; 3],
            })
            .collect();
        self.set_length(splats.len());
        if !records.is_empty() {
            self.scatter.run(device, queue, &self.buffers.splats, &records);
        }
        Ok(size_of_val(records.as_slice()) as u64)
    }

    /// Uploads the order in which to draw, farthest first (see [`super::sort::back_to_front`]);
    /// splats that it leaves out are not drawn. An order of fewer or older splats is fine, one that
    /// names a splat which is not there is refused and the previous one kept.
    pub fn set_order(&mut self, queue: &wgpu::Queue, order: &[u32]) -> Result<(), GpuError> {
        let stale = order.iter().find(|&&index| index as usize >= self.n_splats);
        // Repeated indices could make it longer than the scene.
        if let Some(&index) = stale.or_else(|| order.get(self.n_splats)) {
            return Err(GpuError::StaleOrder { index, n_splats: self.n_splats });
        }
        queue.write_buffer(&self.buffers.order, 0, bytemuck::cast_slice(order));
        self.n_order = order.len();
        Ok(())
    }

    /// Splats uploaded.
    pub fn n_splats(&self) -> usize {
        self.n_splats
    }

    /// Splats in the order, which is what a render pass draws.
    pub fn n_drawn(&self) -> usize {
        self.n_order
    }

    /// Splats that fit before the next growth.
    pub fn capacity(&self) -> usize {
        self.buffers.capacity
    }

    pub(super) fn splat_buffer(&self) -> &wgpu::Buffer {
        &self.buffers.splats
    }

    pub(super) fn order_buffer(&self) -> &wgpu::Buffer {
        &self.buffers.order
    }

    fn upload_whole(&mut self, queue: &wgpu::Queue, splats: &[Splat]) -> u64 {
        let records: Vec<GpuSplat> = splats.iter().map(GpuSplat::new).collect();
        let bytes: &[u8] = bytemuck::cast_slice(&records);
        queue.write_buffer(&self.buffers.splats, 0, bytes);
        self.set_length(splats.len());
        bytes.len() as u64
    }

    fn set_length(&mut self, n_splats: usize) {
        if n_splats < self.n_splats {
            self.n_order = 0;
        }
        self.n_splats = n_splats;
    }
}

impl Buffers {
    fn new(device: &wgpu::Device, capacity: usize) -> Result<Self, GpuError> {
        let storage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST;
        let create = |label, bytes_each, usage| {
            device.create_buffer(&wgpu::BufferDescriptor {
                label: Some(label),
                size: capacity as u64 * bytes_each,
                usage,
                mapped_at_creation: false,
            })
        };
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let splats = create("splats", SPLAT_BYTES, storage);
        let order =
            create("order", size_of::<u32>() as u64, storage | wgpu::BufferUsages::COPY_SRC);
        match ready(scope.pop()).flatten() {
            Some(_) => Err(GpuError::OutOfMemory {
                n_splats: capacity,
                mib: (capacity as u64 * SPLAT_BYTES).div_ceil(MIB),
            }),
            None => Ok(Self { splats, order, capacity }),
        }
    }
}

/// Slots for `n_splats`: half as many again as `before` when that fits the adapter.
fn capacity_for(n_splats: usize, before: usize, limits: &wgpu::Limits) -> Result<usize, GpuError> {
    let limit_bytes = max_buffer_bytes(limits);
    let max_splats = (limit_bytes / SPLAT_BYTES) as usize;
    if n_splats > max_splats {
        return Err(GpuError::TooManySplats {
            n_splats,
            needed_mib: (n_splats as u64 * SPLAT_BYTES).div_ceil(MIB),
            limit_mib: limit_bytes / MIB,
            max_splats,
        });
    }
    // A binding cannot be empty.
    Ok((before + before / 2).clamp(n_splats.max(1), max_splats))
}

/// Error scopes of native wgpu resolve at once; a backend that does not counts as no error.
fn ready<T>(future: impl Future<Output = T>) -> Option<T> {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn capacity_grows_by_half_up_to_the_limit() {
        let limits = wgpu::Limits {
            max_buffer_size: 1 << 30,
            max_storage_buffer_binding_size: 1000 * SPLAT_BYTES,
            ..Default::default()
        };
        for (n_splats, before, expected) in
            [(0, 0, 1), (10, 0, 10), (11, 10, 15), (40, 10, 40), (801, 800, 1000), (1000, 10, 1000)]
        {
            assert_eq!(capacity_for(n_splats, before, &limits).unwrap(), expected, "{n_splats}");
        }
    }

    #[test]
    fn too_many_splats_are_refused_with_numbers() {
        let limits = wgpu::Limits {
            max_buffer_size: 256 * MIB,
            max_storage_buffer_binding_size: 128 * MIB,
            ..Default::default()
        };
        let message = capacity_for(3_000_000, 0, &limits).unwrap_err().to_string();
        assert_eq!(
            message,
            "3000000 splats need 184 MiB, this adapter binds at most 128 MiB: keep to 2097152 \
             splats or draw with the CPU renderer"
        );
    }
}
