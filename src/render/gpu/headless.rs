//! GPU device without a window, for benchmarks, training and rendering without a display.

use super::adapters;
use super::adapters::{
    AdapterChoice, AdapterInfo, GpuCaps, UnknownAdapter, device_descriptor, poll_once,
};
use super::error::{GpuError, GpuFaults};
use super::task::WAIT_TIMEOUT;

/// Failure to open or use a headless device.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HeadlessError {
    /// No hardware adapter was found: only software adapters, or none at all.
    #[error(
        "expected a hardware graphics adapter, found {found}; install its driver or choose an adapter with --adapter"
    )]
    NoHardware {
        /// Available adapters.
        found: String,
    },
    /// No adapter matches the choice.
    #[error("--{0}")]
    NotFound(#[from] UnknownAdapter),
    /// The device could not be created, failed or does not respond.
    #[error("{adapter}: {reason}")]
    Failed {
        /// Name of the adapter.
        adapter: String,
        /// Message from wgpu or the driver.
        reason: String,
    },
    /// The adapter does not support the operation.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// GPU device without a window, with its queue and capabilities.
#[derive(Debug)]
pub struct HeadlessGpu {
    /// Device with all limits and optional features of its adapter.
    pub device: wgpu::Device,
    /// Queue for commands and uploads.
    pub queue: wgpu::Queue,
    /// Capabilities of the device.
    pub caps: GpuCaps,
    /// Log of the device's loss and errors.
    pub faults: GpuFaults,
}

impl HeadlessGpu {
    /// Opens a device with all limits and optional features of its adapter. [`AdapterChoice::Auto`]
    /// excludes software adapters.
    pub fn new(choice: &AdapterChoice) -> Result<Self, HeadlessError> {
        let adapter = choose(choice)?;
        let name = adapter.get_info().name;
        let refused = |reason: String| HeadlessError::Failed {
            adapter: name.clone(),
            reason: format!(
                "the driver could not create a device ({reason}); choose another adapter with --adapter"
            ),
        };
        let (device, queue) = poll_once(adapter.request_device(&device_descriptor(&adapter)))
            .ok_or_else(|| refused("no response".to_owned()))?
            .map_err(|e| refused(e.to_string()))?;
        let faults = GpuFaults::default();
        faults.watch(&device);
        let caps = GpuCaps::new(&adapter, &device);
        caps.check()?;
        Ok(Self { device, queue, caps, faults })
    }

    /// Waits until all submitted work is done.
    ///
    /// # Errors
    /// [`HeadlessError::Failed`] if the wait times out or a fault was reported.
    pub fn wait(&self) -> Result<(), HeadlessError> {
        let failed =
            |reason: String| HeadlessError::Failed { adapter: self.caps.info.name.clone(), reason };
        // A lost or hung device never responds; a benchmark must then end with a message.
        let patiently =
            wgpu::PollType::Wait { submission_index: None, timeout: Some(WAIT_TIMEOUT) };
        self.device.poll(patiently).map_err(|e| failed(e.to_string()))?;
        match self.faults.take_new().into_iter().next() {
            Some(fault) => Err(failed(fault)),
            None => Ok(()),
        }
    }
}

fn choose(choice: &AdapterChoice) -> Result<wgpu::Adapter, HeadlessError> {
    let mut adapters = match choice {
        // OpenGL is used only if chosen explicitly, and its drivers start slowest.
        AdapterChoice::Auto => adapters::enumerate_in(wgpu::Backends::PRIMARY),
        _ => adapters::enumerate(),
    };
    let facts: Vec<AdapterInfo> = adapters.iter().map(AdapterInfo::new).collect();
    let position = match adapters::choose(choice, &facts)? {
        Some(position) => position,
        None => fastest(&facts)
            .ok_or_else(|| HeadlessError::NoHardware { found: adapters::listed(&facts) })?,
    };
    Ok(adapters.swap_remove(position))
}

/// Returns the index of the first adapter of the most capable kind, excluding software and OpenGL.
fn fastest(adapters: &[AdapterInfo]) -> Option<usize> {
    let rank = |adapter: &AdapterInfo| match adapter.device_type {
        wgpu::DeviceType::DiscreteGpu => Some(0),
        wgpu::DeviceType::IntegratedGpu => Some(1),
        wgpu::DeviceType::VirtualGpu => Some(2),
        wgpu::DeviceType::Other => Some(3),
        wgpu::DeviceType::Cpu => None,
    };
    // OpenGL is slower and less tested, so it must be chosen explicitly.
    let hardware = adapters.iter().enumerate().filter(|(_, a)| a.backend != wgpu::Backend::Gl);
    hardware
        .filter_map(|(i, adapter)| Some((rank(adapter)?, i)))
        .min()
        .map(|(_, position)| position)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn left_to_itself_it_takes_the_most_capable_hardware() {
        let facts = |backend, device_type| AdapterInfo { name: "any".into(), backend, device_type };
        let (vulkan, gl) = (wgpu::Backend::Vulkan, wgpu::Backend::Gl);
        let software = facts(vulkan, wgpu::DeviceType::Cpu);
        let integrated = facts(vulkan, wgpu::DeviceType::IntegratedGpu);
        let discrete = facts(vulkan, wgpu::DeviceType::DiscreteGpu);
        let by_gl = facts(gl, wgpu::DeviceType::DiscreteGpu);
        let there = [software.clone(), by_gl.clone(), integrated, discrete];
        assert_eq!(fastest(&there), Some(3));
        assert_eq!(fastest(&there[..3]), Some(2));
        assert_eq!(fastest(&[software, by_gl]), None);
    }
}
