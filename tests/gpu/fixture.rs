//! One device shared by all tests, which take turns.
//!
//! Creating a device and loading its driver takes longer than most images here, and some drivers
//! fail if devices come and go. Only tests that lose or limit a device create their own.

use crate::common::adapter::{Turn, now, turn, vulkan};
use std::sync::OnceLock;
use vbgs_studio::render::gpu::adapters::{GpuCaps, device_descriptor};
use vbgs_studio::render::gpu::error::GpuFaults;
use vbgs_studio::render::gpu::headless::HeadlessGpu;

/// A device, its lock, and the errors that it reports later.
pub struct Fixture {
    pub adapter: wgpu::Adapter,
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub faults: GpuFaults,
    _turn: Turn,
}

impl Fixture {
    /// Locks the shared device; `None` if Vulkan is missing and not required.
    #[track_caller]
    pub fn shared() -> Option<Self> {
        static ADAPTER: OnceLock<wgpu::Adapter> = OnceLock::new();
        static DEVICE: OnceLock<(wgpu::Device, wgpu::Queue, GpuFaults)> = OnceLock::new();
        let turn = turn();
        if ADAPTER.get().is_none() {
            let _ = ADAPTER.set(vulkan()?);
        }
        let adapter = ADAPTER.get()?.clone();
        let (device, queue, faults) =
            DEVICE.get_or_init(|| opened(&adapter, &device_descriptor(&adapter))).clone();
        // Discards errors that an earlier, failed test left behind.
        faults.take_new();
        Some(Self { adapter, device, queue, faults, _turn: turn })
    }

    /// Creates a separate device, to be lost or limited; `limit` changes the requested limits.
    #[track_caller]
    pub fn own(limit: impl FnOnce(&mut wgpu::Limits)) -> Option<Self> {
        let shared = Self::shared()?;
        let mut descriptor = device_descriptor(&shared.adapter);
        limit(&mut descriptor.required_limits);
        let (device, queue, faults) = opened(&shared.adapter, &descriptor);
        Some(Self { device, queue, faults, ..shared })
    }

    /// The device for a task of training.
    pub fn headless(&self) -> HeadlessGpu {
        let (device, queue) = (self.device.clone(), self.queue.clone());
        let caps = GpuCaps::new(&self.adapter, &device);
        HeadlessGpu { device, queue, caps, faults: self.faults.clone() }
    }

    /// True for drivers that run on the CPU, which need a sixth of a second for an image.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == wgpu::DeviceType::Cpu
    }

    #[track_caller]
    pub fn assert_no_faults(&self) {
        let faults = self.faults.take_new();
        assert!(faults.is_empty(), "{faults:?}");
    }
}

fn opened(
    adapter: &wgpu::Adapter,
    descriptor: &wgpu::DeviceDescriptor<'_>,
) -> (wgpu::Device, wgpu::Queue, GpuFaults) {
    let (device, queue) = now(adapter.request_device(descriptor)).unwrap();
    let faults = GpuFaults::default();
    faults.watch(&device);
    let caps = GpuCaps::new(adapter, &device);
    println!("adapter: {caps}");
    caps.check().unwrap();
    (device, queue, faults)
}
