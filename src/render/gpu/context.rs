//! Features, limits and capabilities of an adapter.

use super::error::GpuError;

/// Optional features, requested if available.
const OPTIONAL: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY;

/// Requests the adapter's own limits (a splat buffer needs the largest possible binding) and the
/// available optional features.
pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    wgpu::DeviceDescriptor {
        label: Some("vbgs device"),
        // Requesting an unavailable feature would fail.
        required_features: adapter.features() & OPTIONAL,
        required_limits: required_limits(adapter),
        ..Default::default()
    }
}

/// Limits of the adapter itself: wgpu's defaults would allow only 2 million splats on any card.
pub fn required_limits(adapter: &wgpu::Adapter) -> wgpu::Limits {
    adapter.limits()
}

/// Capabilities of a device and its description for the user.
#[derive(Clone, Debug, PartialEq)]
pub struct GpuCaps {
    /// Name of the adapter.
    pub adapter: String,
    /// Graphics API: Vulkan, Metal, Dx12 or Gl.
    pub backend: wgpu::Backend,
    /// Driver and version as reported by the driver; may be empty.
    pub driver: String,
    /// Discrete, integrated, virtual or software.
    pub device_type: wgpu::DeviceType,
    /// Largest buffer that a shader can bind completely, bytes.
    pub max_buffer_bytes: u64,
    /// Largest side of a texture, pixels.
    pub max_texture_side: u32,
    /// True if passes can be timed on the GPU.
    pub has_timestamps: bool,
    missing: Option<&'static str>,
}

impl GpuCaps {
    /// Reads the capabilities of `device`, created from `adapter`.
    pub fn new(adapter: &wgpu::Adapter, device: &wgpu::Device) -> Self {
        let info = adapter.get_info();
        let limits = device.limits();
        let flags = adapter.get_downlevel_capabilities().flags;
        // Downlevel adapters (OpenGL ES, WebGL) may lack both; limits do not show that.
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

    /// True if the adapter runs on the CPU (llvmpipe, WARP), where the CPU renderer is many times
    /// faster (`rendering.md`, Software adapters).
    pub fn is_software(&self) -> bool {
        self.device_type == wgpu::DeviceType::Cpu
    }

    /// Fails if the adapter cannot run the shaders.
    pub fn check(&self) -> Result<(), GpuError> {
        match self.missing {
            Some(missing) => Err(GpuError::Unsupported { adapter: self.adapter.clone(), missing }),
            None => Ok(()),
        }
    }
}

impl std::fmt::Display for GpuCaps {
    /// Formats name, backend and driver as one line for the status bar.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} ({}", self.adapter, self.backend)?;
        if !self.driver.is_empty() {
            write!(f, ", {}", self.driver)?;
        }
        write!(f, "{})", if self.is_software() { ", software" } else { "" })
    }
}

/// Largest buffer, in bytes, that fits in one binding.
pub(super) fn max_buffer_bytes(limits: &wgpu::Limits) -> u64 {
    limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
}
