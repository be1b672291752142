//! What an adapter offers of the things we use, and what to ask of it.

use super::error::GpuError;

/// Features that help when offered; the renderer works without.
const OPTIONAL: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY;

/// Everything an adapter allows: its own limits (a splat buffer wants the largest binding there is)
/// and the optional features it has.
pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    wgpu::DeviceDescriptor {
        label: Some("vbgs device"),
        // Asking for a feature that is not offered fails; what is missing is done without.
        required_features: adapter.features() & OPTIONAL,
        required_limits: required_limits(adapter),
        ..Default::default()
    }
}

/// The adapter's own limits: the defaults would stop at 2 million splats on any card.
pub fn required_limits(adapter: &wgpu::Adapter) -> wgpu::Limits {
    adapter.limits()
}

/// What a device can do for us and how to name it to the user.
#[derive(Clone, Debug, PartialEq)]
pub struct GpuCaps {
    /// Name of the adapter.
    pub adapter: String,
    /// Vulkan, Metal, Dx12 or Gl.
    pub backend: wgpu::Backend,
    /// Driver and its version, as the driver words them; may be empty.
    pub driver: String,
    /// Discrete, integrated, virtual or software.
    pub device_type: wgpu::DeviceType,
    /// Bytes that one buffer can hold and a shader can see at once.
    pub max_buffer_bytes: u64,
    /// Pixels a side of the largest texture.
    pub max_texture_side: u32,
    /// Whether passes can be timed on the GPU.
    pub has_timestamps: bool,
    missing: Option<&'static str>,
}

impl GpuCaps {
    /// Of a device in use; `adapter` is the one it came from.
    pub fn new(adapter: &wgpu::Adapter, device: &wgpu::Device) -> Self {
        let info = adapter.get_info();
        let limits = device.limits();
        let flags = adapter.get_downlevel_capabilities().flags;
        // Downlevel adapters (OpenGL ES, WebGL) may lack both, and no limit says so.
        let missing = [
            (wgpu::DownlevelFlags::VERTEX_STORAGE, "storage buffers in vertex shaders"),
            (wgpu::DownlevelFlags::COMPUTE_SHADERS, "compute shaders"),
        ]
        .into_iter()
        .find_map(|(flag, what)| (!flags.contains(flag)).then_some(what));
        Self {
            adapter: info.name,
            backend: info.backend,
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            device_type: info.device_type,
            max_buffer_bytes: max_buffer_bytes(&limits),
            max_texture_side: limits.max_texture_dimension_2d,
            has_timestamps: device.features().contains(wgpu::Features::TIMESTAMP_QUERY),
            missing,
        }
    }

    /// Whether the "GPU" is this computer's CPU (llvmpipe, WARP): our CPU renderer is then many
    /// times faster (`rendering.md`, Software adapters).
    pub fn is_software(&self) -> bool {
        self.device_type == wgpu::DeviceType::Cpu
    }

    /// Whether the shaders can run at all.
    pub fn check(&self) -> Result<(), GpuError> {
        match self.missing {
            Some(missing) => Err(GpuError::Unsupported { adapter: self.adapter.clone(), missing }),
            None => Ok(()),
        }
    }
}

impl std::fmt::Display for GpuCaps {
    /// One line for the status bar: name, backend, driver.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}", self.adapter, self.backend)?;
        if !self.driver.is_empty() {
            write!(f, ", {}", self.driver)?;
        }
        write!(f, "{})", if self.is_software() { ", software" } else { "" })
    }
}

/// Bytes that fit in one buffer and in one binding of it.
pub(super) fn max_buffer_bytes(limits: &wgpu::Limits) -> u64 {
    limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
}
