//! The graphics adapter of tests that need one.

use super::skip::skip;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

/// Held by every test that has a device: drivers were seen to corrupt memory (NVIDIA 580) when
/// several devices of one process come and go at once, which the program itself never does.
static ONE_DEVICE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// The right to have a device; drop it after everything made on the device.
pub type Turn = MutexGuard<'static, ()>;

/// Waits until no other test has a device.
pub fn turn() -> Turn {
    ONE_DEVICE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Futures of native wgpu are ready when they are made.
pub fn now<T>(future: impl Future<Output = T>) -> T {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("a native wgpu future was not ready"),
    }
}

/// A Vulkan adapter; `None` skips the test.
pub fn vulkan() -> Option<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter = now(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok();
    let missing = || skip("no Vulkan adapter", "install mesa-vulkan-drivers, a software one");
    adapter.or_else(missing)
}
