//! A device that fails the test on any fault, and buffers to and fro.

use crate::common::adapter::{Turn, now, turn, vulkan};
use vbgs_studio::render::gpu::context::device_descriptor;
use vbgs_studio::render::gpu::faults::GpuFaults;

pub struct Gpu {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    faults: GpuFaults,
    _turn: Turn,
}

impl Gpu {
    /// `None` (with a note) where there is no Vulkan and none is demanded.
    pub fn new() -> Option<Self> {
        let turn = turn();
        let adapter = vulkan()?;
        let (device, queue) = now(adapter.request_device(&device_descriptor(&adapter))).unwrap();
        let faults = GpuFaults::default();
        faults.watch(&device);
        Some(Self { device, queue, faults, _turn: turn })
    }

    /// A storage buffer with these words, room for one at least.
    pub fn words(&self, words: &[u32]) -> wgpu::Buffer {
        let buffer = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * words.len().max(1) as u64,
            usage: wgpu::BufferUsages::STORAGE
                | wgpu::BufferUsages::COPY_SRC
                | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(words));
        buffer
    }

    /// The first words of a buffer, after everything submitted.
    pub fn read(&self, buffer: &wgpu::Buffer, n: usize) -> Vec<u32> {
        if n == 0 {
            return Vec::new();
        }
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: None,
            size: 4 * n as u64,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&Default::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, 4 * n as u64);
        self.queue.submit([encoder.finish()]);
        staging.map_async(wgpu::MapMode::Read, .., Result::unwrap);
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let bytes = staging.get_mapped_range(..).unwrap();
        bytemuck::pod_collect_to_vec(&bytes)
    }

    pub fn assert_no_faults(&self) {
        assert_eq!(self.faults.take(), []);
    }
}
