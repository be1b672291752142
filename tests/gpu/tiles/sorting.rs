//! The radix sort against the standard library's.

use super::device::Gpu;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::render::gpu::tiles::sort::{Keys, RadixSort, SortBuffers};

/// Sorts on the GPU; the values of `Keys::Valued` are the places.
fn sorted(gpu: &Gpu, sort: &RadixSort, keys: &[u32], bits: u32, kind: Keys) -> Vec<[u32; 2]> {
    let places: Vec<u32> = (0..keys.len() as u32).collect();
    let nothing = vec![7; keys.len()];
    let values = match kind {
        Keys::Valued { .. } => &places,
        Keys::Indexed { .. } => &nothing,
    };
    let key_buffers = [gpu.words(keys), gpu.words(&nothing)];
    let value_buffers = [gpu.words(values), gpu.words(&nothing)];
    let counts = gpu.words(&[keys.len() as u32, u32::MAX]);
    let buffers = SortBuffers {
        keys: key_buffers.each_ref(),
        values: value_buffers.each_ref(),
        counts: &counts,
    };
    let plan = sort.plan(&gpu.device, &gpu.queue, buffers, bits, kind);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    plan.record(&mut encoder.begin_compute_pass(&Default::default()));
    gpu.queue.submit([encoder.finish()]);
    let n_left = match kind {
        Keys::Valued { .. } => keys.len(),
        Keys::Indexed { .. } => gpu.read(&counts, 2)[1] as usize,
    };
    let result = plan.result();
    let keys = gpu.read(&key_buffers[result], n_left);
    let values = gpu.read(&value_buffers[result], n_left);
    keys.into_iter().zip(values).map(<[u32; 2]>::from).collect()
}

/// What a stable sort makes of keys that are not dropped.
fn expected(keys: &[u32], mask: u32, dropped: Option<u32>) -> Vec<[u32; 2]> {
    let mut pairs: Vec<[u32; 2]> = keys.iter().copied().zip(0..).map(<[u32; 2]>::from).collect();
    pairs.retain(|pair| Some(pair[0]) != dropped);
    pairs.sort_by_key(|pair| pair[0] & mask);
    pairs
}

const VALUED: Keys = Keys::Valued { source: 0 };
const INDEXED: Keys = Keys::Indexed { source: 0, sink: 1 };

#[test]
fn every_size_is_sorted_stably() {
    let Some(gpu) = Gpu::new() else { return };
    let sort = RadixSort::new(&gpu.device);
    let sizes = [0, 1, 2, 31, 32, 33, 255, 256, 257, 511, 4096, 70_001, 262_144, 262_145, 300_000];
    for n in sizes {
        let mut rng = Rng::new(n as u64, Purpose::Synthetic, 0);
        // Few values make many ties, and one in eight is to be dropped.
        let coarse: Vec<u32> = (0..n)
            .map(|_| match rng.below(8) {
                0 => u32::MAX,
                _ => (rng.below(40) as u32) << (rng.below(4) * 8),
            })
            .collect();
        let found = sorted(&gpu, &sort, &coarse, 32, VALUED);
        assert!(found == expected(&coarse, u32::MAX, None), "{n} keys");
        let found = sorted(&gpu, &sort, &coarse, 32, INDEXED);
        assert!(found == expected(&coarse, u32::MAX, Some(u32::MAX)), "{n} indexed keys");
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
        let found = sorted(&gpu, &sort, &keys, bits, VALUED);
        assert!(found == expected(&keys, (1 << bits) - 1, None), "{bits} bits");
    }
    gpu.assert_no_faults();
}

#[test]
fn a_million_keys_and_equal_ones() {
    let Some(gpu) = Gpu::new() else { return };
    let sort = RadixSort::new(&gpu.device);
    let mut rng = Rng::new(4, Purpose::Synthetic, 0);
    let keys: Vec<u32> = (0..1_000_000).map(|_| rng.below(1 << 32) as u32).collect();
    assert!(sorted(&gpu, &sort, &keys, 32, INDEXED) == expected(&keys, u32::MAX, Some(u32::MAX)));
    for equal in [0, 0x0102_0304, u32::MAX] {
        let keys = vec![equal; 100_000];
        let found = sorted(&gpu, &sort, &keys, 32, INDEXED);
        assert!(found == expected(&keys, u32::MAX, Some(u32::MAX)), "all {equal:#x}");
    }
    gpu.assert_no_faults();
}
