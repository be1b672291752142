//! The window's graphics device: its adapter, alternatives, and loss detection.

use super::viewport;
use crate::render::gpu::adapters::AdapterInfo;
use crate::render::gpu::faults::GpuFaults;
use eframe::egui_wgpu::RenderState;

pub struct WindowDevice {
    pub state: RenderState,
    /// Asynchronous errors and device loss.
    pub faults: GpuFaults,
    /// Adapters that can draw the window.
    pub there: Vec<AdapterInfo>,
    /// Adapter in use.
    pub adapter: AdapterInfo,
}

impl WindowDevice {
    /// Installs the error handlers on eframe's device.
    pub fn new(state: &RenderState) -> Self {
        let (there, adapter) = viewport::adapters(state);
        Self { state: state.clone(), faults: viewport::collect_faults(state), there, adapter }
    }

    /// True if the device and all its resources are lost.
    pub fn is_lost(&self) -> bool {
        // A loss is reported only by a poll or a submission, and an idle window submits nothing.
        viewport::poll(&self.state);
        self.faults.is_lost()
    }
}
