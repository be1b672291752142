//! The window's graphics device: what it is, what else there is, and whether it is still there.

use super::viewport;
use crate::render::gpu::adapters::AdapterFacts;
use crate::render::gpu::faults::GpuFaults;
use eframe::egui_wgpu::RenderState;

/// The window's device, watched from the start.
pub struct WindowDevice {
    /// eframe's.
    pub state: RenderState,
    /// What went wrong after the fact.
    pub faults: GpuFaults,
    /// Everything that could draw the window.
    pub there: Vec<AdapterFacts>,
    /// What does.
    pub adapter: AdapterFacts,
}

impl WindowDevice {
    /// Listens to eframe's device.
    pub fn new(state: &RenderState) -> Self {
        let (there, adapter) = viewport::adapters(state);
        Self { state: state.clone(), faults: viewport::watch(state), there, adapter }
    }

    /// Whether it is gone, and everything on it.
    pub fn is_lost(&self) -> bool {
        // Word of a loss comes with a poll or a submission, and a window at rest submits nothing.
        viewport::poll(&self.state);
        self.faults.is_lost()
    }
}
