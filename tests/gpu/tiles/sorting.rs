//! The radix sort against the standard library's sort.

use crate::device::Gpu;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::render::gpu::tiles::sort::{Keys, RadixSort, SortBuffers};

/// Input of the first pass.
#[derive(Clone, Copy)]
enum Kind {
    /// Keys alone: the sort adds their indices and drops keys of all ones.
    Indexed,
    /// Pairs of a key and its index.
    Valued,
}
use Kind::{Indexed, Valued};

/// A storage buffer with these words; it has room for at least one.
fn buffer_of(gpu: &Gpu, words: &[u32]) -> wgpu::Buffer {
    let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 4 * words.len().max(1) as u64,
        usage: wgpu::BufferUsages::STORAGE
            | wgpu::BufferUsages::COPY_SRC
            | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
    buffer
}

/// Reads the first `n` words of a buffer after all submitted work.
fn read(gpu: &Gpu, buffer: &wgpu::Buffer, n: usize) -> Vec<u32> {
    if n == 0 {
        return Vec::new();
    }
    let staging = gpu.device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 4 * n as u64,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, 4 * n as u64);
    gpu.queue.submit([encoder.finish()]);
    staging.map_async(wgpu::MapMode::Read, .., Result::unwrap);
    gpu.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
    let bytes = staging.get_mapped_range(..).unwrap();
    bytemuck::pod_collect_to_vec(&bytes)
}

fn sorted(gpu: &Gpu, sort: &RadixSort, keys: &[u32], bits: u32, kind: Kind) -> Vec<[u32; 2]> {
    // A binding needs at least one pair.
    let nothing = vec![7; 2 * keys.len().max(1)];
    let mut beside = nothing.clone();
    for ((pair, &key), place) in beside.as_chunks_mut::<2>().0.iter_mut().zip(keys).zip(0..) {
        *pair = [key, place];
    }
    let first = match kind {
        Indexed => &nothing,
        Valued => &beside,
    };
    let pairs = [buffer_of(gpu, first), buffer_of(gpu, &nothing)];
    let alone = buffer_of(gpu, keys);
    let [least, largest] = range(keys);
    let counts = buffer_of(gpu, &[keys.len() as u32, u32::MAX, least, largest]);
    let kind = match kind {
        Indexed => Keys::Indexed { keys: &alone, source: 0, sink: 1, range: [2, 3] },
        Valued => Keys::Valued { source: 0 },
    };
    let buffers = SortBuffers { pairs: pairs.each_ref(), counts: &counts };
    let plan = sort.plan(&gpu.device, &gpu.queue, buffers, bits, kind);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    plan.record(&mut encoder.begin_compute_pass(&Default::default()));
    gpu.queue.submit([encoder.finish()]);
    let n_left = match kind {
        Keys::Valued { .. } => keys.len(),
        Keys::Indexed { .. } => read(gpu, &counts, 2)[1] as usize,
    };
    let words = read(gpu, &pairs[plan.result()], 2 * n_left);
    words.as_chunks::<2>().0.to_vec()
}

/// Smallest and largest key that is not dropped.
fn range(keys: &[u32]) -> [u32; 2] {
    let kept = || keys.iter().copied().filter(|&key| key != u32::MAX);
    [kept().min().unwrap_or(u32::MAX), kept().max().unwrap_or(0)]
}

/// Pairs of keys and indices in the order of a stable sort by `of(key)`.
fn stably(keys: &[u32], of: impl Fn(u32) -> u32) -> Vec<[u32; 2]> {
    let mut pairs: Vec<[u32; 2]> = keys.iter().copied().zip(0..).map(<[u32; 2]>::from).collect();
    pairs.sort_by_key(|pair| of(pair[0]));
    pairs
}

/// Expected result for keys alone: their range is reduced to its top `bits` bits.
fn indexed(keys: &[u32], bits: u32) -> Vec<[u32; 2]> {
    let [least, largest] = range(keys);
    let n_used = u32::BITS - largest.saturating_sub(least).leading_zeros();
    let cut = |key: u32| (key - least) >> n_used.saturating_sub(bits);
    let kept = |pair: &[u32; 2]| pair[0] != u32::MAX;
    let pairs = stably(keys, |key| if key == u32::MAX { key } else { cut(key) });
    pairs.into_iter().filter(kept).map(|[key, place]| [cut(key), place]).collect()
}

#[test]
fn every_size_is_sorted_stably() {
    let Some(gpu) = Gpu::new() else { return };
    let sort = RadixSort::new(&gpu.device);
    let sizes = [0, 1, 2, 31, 32, 33, 255, 256, 257, 511, 4096, 70_001, 262_144, 262_145, 300_000];
    for n in sizes {
        let mut rng = Rng::new(n as u64, Purpose::Synthetic, 0);
        // Few distinct values give many ties; one in eight is dropped.
        let coarse: Vec<u32> = (0..n)
            .map(|_| match rng.below(8) {
                0 => u32::MAX,
                _ => (rng.below(40) as u32) << (rng.below(4) * 8),
            })
            .collect();
        let found = sorted(&gpu, &sort, &coarse, 32, Valued);
        assert!(found == stably(&coarse, |key| key), "{n} keys");
        for bits in [32, 24] {
            let found = sorted(&gpu, &sort, &coarse, bits, Indexed);
            assert!(found == indexed(&coarse, bits), "{n} indexed keys, {bits} bits");
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn only_the_bits_asked_for_count() {
    let Some(gpu) = Gpu::new() else { return };
    let sort = RadixSort::new(&gpu.device);
    let mut rng = Rng::new(3, Purpose::Synthetic, 0);
    let keys: Vec<u32> = (0..5000).map(|_| (rng.below(1 << 32)) as u32).collect();
    for bits in [0, 1, 7, 8, 9, 12, 17, 31] {
        let found = sorted(&gpu, &sort, &keys, bits, Valued);
        assert!(found == stably(&keys, |key| key & ((1 << bits) - 1)), "{bits} bits");
    }
    gpu.assert_no_faults();
}

#[test]
fn a_million_keys_and_equal_ones() {
    let Some(gpu) = Gpu::new() else { return };
    let sort = RadixSort::new(&gpu.device);
    let mut rng = Rng::new(4, Purpose::Synthetic, 0);
    let keys: Vec<u32> = (0..1_000_000).map(|_| rng.below(1 << 32) as u32).collect();
    assert!(sorted(&gpu, &sort, &keys, 32, Indexed) == indexed(&keys, 32));
    for equal in [0, 0x0102_0304, u32::MAX] {
        let keys = vec![equal; 100_000];
        let found = sorted(&gpu, &sort, &keys, 32, Indexed);
        assert!(found == indexed(&keys, 32), "all {equal:#x}");
    }
    gpu.assert_no_faults();
}

#[test]
fn near_keys_far_from_zero_lose_nothing_to_few_bits() {
    let Some(gpu) = Gpu::new() else { return };
    let sort = RadixSort::new(&gpu.device);
    let mut rng = Rng::new(6, Purpose::Synthetic, 0);
    // Depths from 3 to 11 span less than two octaves, so 24 bits hold all that f32 distinguishes.
    let depths: Vec<f32> = (0..50_000).map(|_| rng.range(3.0, 11.0) as f32).collect();
    let keys: Vec<u32> = depths.iter().map(|depth| depth.to_bits()).collect();
    let places = sorted(&gpu, &sort, &keys, 24, Indexed).into_iter().map(|[_, place]| place);
    let by_depth = stably(&keys, |key| key).into_iter().map(|[_, place]| place);
    assert!(places.eq(by_depth));
    gpu.assert_no_faults();
}
