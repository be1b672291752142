//! Stable radix sort of pairs of u32 key and u32 value on the GPU; `sort.wgsl` describes the algorithm.
//!
//! Each digit takes three kernels: count the digits of each strip of keys, turn the counts into offsets,
//! scatter. The number of strips is fixed, so grids do not depend on a count from the GPU. Subgroups are
//! optional in wgpu and not used; sorting is a small part of a frame. The published crate took 70 to 87 ms
//! on llvmpipe (`rendering.md`, Tried and dropped).

use super::buffers;
use crate::render::gpu::constants::{N_STRIPS, module};
use crate::render::gpu::pipeline::{BoundKernel, ComputeKernel, Grid, storage};

// Maximum bits per digit: one lane of a workgroup per value.
const DIGIT_BITS: u32 = 8;

/// Pipelines and temporary digit counts, shared by all sorts.
#[derive(Debug)]
pub struct RadixSort {
    histogram: ComputeKernel,
    spine: ComputeKernel,
    scatter: ComputeKernel,
    strips: wgpu::Buffer,
    totals: wgpu::Buffer,
}

/// Input of a sort. Slots are indices in [`SortBuffers::counts`].
#[derive(Clone, Copy, Debug)]
pub enum Keys<'a> {
    /// Keys without values; the value of each key is its index. Keys of all ones are dropped. The
    /// smallest remaining key is subtracted from the others. If the range exceeds the bits of the sort,
    /// low bits are dropped.
    Indexed {
        /// Keys, u32 each.
        keys: &'a wgpu::Buffer,
        /// Slot that holds the number of keys.
        source: u32,
        /// Slot that receives the number of retained keys.
        sink: u32,
        /// Slots that hold the smallest and the largest retained key.
        range: [u32; 2],
    },
    /// Pairs of key and value in the first buffer of [`SortBuffers::pairs`].
    Valued {
        /// Slot that holds the number of pairs.
        source: u32,
    },
}

/// Buffers of a sort: two buffers of pairs, between which the passes alternate, and a buffer of
/// counters.
#[derive(Clone, Copy, Debug)]
pub struct SortBuffers<'a> {
    /// Buffers of pairs before and after a pass; a pair is a u32 key and a u32 value.
    pub pairs: [&'a wgpu::Buffer; 2],
    /// Counters, u32 each.
    pub counts: &'a wgpu::Buffer,
}

/// Sort of specific buffers, recorded anew for every frame.
#[derive(Debug)]
pub struct SortPlan {
    passes: Vec<[(BoundKernel, Grid); 3]>,
}

/// Settings of a pass: `Digit` in `sort.wgsl`.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
struct Digit {
    shift: u32,
    n_values: u32,
    source: u32,
    is_first: u32,
    sink: u32,
    least: u32,
    largest: u32,
    n_bits: u32,
}

impl RadixSort {
    /// Creates the pipelines.
    pub fn new(device: &wgpu::Device) -> Self {
        let module = module(device, "radix sort", buffers::SORT);
        let word = size_of::<u32>() as u64;
        Self {
            histogram: ComputeKernel::new(device, &module, "histogram"),
            spine: ComputeKernel::new(device, &module, "spine"),
            scatter: ComputeKernel::new(device, &module, "scatter"),
            strips: storage(device, "digits", word * u64::from(N_STRIPS << DIGIT_BITS)),
            totals: storage(device, "digit totals", word << DIGIT_BITS),
        }
    }

    /// Plans a sort by the lowest `bits` bits of the keys. `bits` is at most 32, and at least 1 for
    /// indexed keys.
    pub fn plan(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        buffers: SortBuffers<'_>,
        bits: u32,
        keys: Keys<'_>,
    ) -> SortPlan {
        let passes = digits(bits, keys)
            .into_iter()
            .enumerate()
            .map(|(i, digit)| {
                let from = match keys {
                    Keys::Indexed { keys, .. } if i == 0 => keys,
                    _ => buffers.pairs[i % 2],
                };
                let to = buffers.pairs[(i + 1) % 2];
                self.bind(device, queue, buffers.counts, [from, to], digit)
            })
            .collect();
        SortPlan { passes }
    }

    fn bind(
        &self,
        device: &wgpu::Device,
        queue: &wgpu::Queue,
        counts: &wgpu::Buffer,
        [from, to]: [&wgpu::Buffer; 2],
        digit: Digit,
    ) -> [(BoundKernel, Grid); 3] {
        let uniforms = device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("digit"),
            size: size_of::<Digit>() as u64,
            usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        queue.write_buffer(&uniforms, 0, bytemuck::bytes_of(&digit));
        let all = [&uniforms, counts, from, to, &self.strips, &self.totals];
        let bind = |kernel: &ComputeKernel, used: &[u32]| {
            let buffers: Vec<_> = used.iter().map(|&i| (i, all[i as usize])).collect();
            kernel.bind_buffers(device, &buffers)
        };
        [
            (bind(&self.histogram, &[0, 1, 2, 4]), Grid::row(N_STRIPS)),
            (bind(&self.spine, &[0, 1, 4, 5]), Grid::row(digit.n_values)),
            (bind(&self.scatter, &[0, 1, 2, 3, 4, 5]), Grid::row(N_STRIPS)),
        ]
    }
}

impl SortPlan {
    /// Records all passes of the sort.
    pub fn record(&self, pass: &mut wgpu::ComputePass<'_>) {
        for (kernel, grid) in self.passes.iter().flatten() {
            kernel.dispatch(pass, *grid);
        }
    }

    /// Returns the index in [`SortBuffers::pairs`] of the buffer that holds the sorted pairs.
    pub fn result(&self) -> usize {
        self.passes.len() % 2
    }
}

/// Splits the lowest `bits` bits of the keys into the minimum number of digits, of nearly equal width.
/// Each digit takes one pass.
fn digits(bits: u32, keys: Keys<'_>) -> Vec<Digit> {
    let n_passes = bits.div_ceil(DIGIT_BITS);
    // Equal widths instead of 8 and a remainder: digits with fewer values are faster to count.
    let width = bits.div_ceil(n_passes.max(1));
    (0..n_passes)
        .map(|i| {
            let shift = i * width;
            let (source, is_first, sink, [least, largest]) = match keys {
                Keys::Indexed { source, sink, range, .. } if i == 0 => (source, 1, sink, range),
                // Later passes sort only the keys that the first pass retained.
                Keys::Indexed { sink, .. } => (sink, 0, 0, [0; 2]),
                Keys::Valued { source } => (source, 0, 0, [0; 2]),
            };
            let n_values = 1 << width.min(bits - shift);
            Digit { shift, n_values, source, is_first, sink, least, largest, n_bits: bits }
        })
        .collect()
}
