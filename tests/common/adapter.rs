//! Graphics adapter for tests.

use super::skip::skip;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Waker};

/// Held by every test with a device. A driver (NVIDIA 580) corrupted memory when one process created and
/// destroyed several devices at once, which the program itself never does.
static ONE_DEVICE_AT_A_TIME: Mutex<()> = Mutex::new(());

/// Exclusive right to use a device. Drop it after everything created on the device.
pub type Turn = MutexGuard<'static, ()>;

/// Waits until no other test uses a device.
pub fn turn() -> Turn {
    ONE_DEVICE_AT_A_TIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the value of a wgpu future, which is ready at once on native platforms.
pub fn now<T>(future: impl Future<Output = T>) -> T {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => value,
        Poll::Pending => panic!("a native wgpu future was not ready"),
    }
}

/// Returns a Vulkan adapter; `None` skips the test.
pub fn vulkan() -> Option<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::VULKAN,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let adapter = now(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).ok();
    let missing = || skip("no Vulkan adapter", "install mesa-vulkan-drivers, a software one");
    adapter.or_else(missing)
}
