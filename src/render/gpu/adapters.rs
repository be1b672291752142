//! Graphics adapters of this computer, and the choice among them.
//!
//! An adapter is described by name, backend and kind. A choice matches any part of that text, because drivers
//! format names in too many ways for an exact match. Software and OpenGL adapters are allowed but produce a
//! warning, since a silent fallback would appear as a slow program.

use super::constants::GROUP;
use super::error::GpuError;
use std::fmt;
use std::future::Future;
use std::path::Path;
use std::task::{Context, Poll, Waker};

/// Choice of a graphics adapter.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AdapterChoice {
    /// The most capable adapter, as ranked by wgpu (for windows) or by [`super::headless`].
    #[default]
    Auto,
    /// The first adapter whose driver runs shaders on the CPU (llvmpipe, WARP).
    Software,
    /// The first adapter whose [`AdapterInfo`] text contains this string, ignoring case.
    Named(String),
    /// The adapter at this index of [`list`].
    Index(usize),
}

impl AdapterChoice {
    /// Parses `auto`, `software`, an index, or otherwise part of a name.
    pub fn parse(text: &str) -> Self {
        match text {
            "auto" => Self::Auto,
            "software" => Self::Software,
            _ => text.parse().map_or_else(|_| Self::Named(text.to_owned()), Self::Index),
        }
    }
}

impl fmt::Display for AdapterChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Software => f.write_str("software"),
            Self::Named(name) => f.write_str(name),
            Self::Index(index) => index.fmt(f),
        }
    }
}

/// Description of an adapter.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterInfo {
    /// Name of the device.
    pub name: String,
    /// Graphics API through which the adapter is used.
    pub backend: wgpu::Backend,
    /// Kind of adapter: discrete, integrated, virtual or software.
    pub device_type: wgpu::DeviceType,
}

impl AdapterInfo {
    /// Describes a wgpu adapter.
    pub fn new(adapter: &wgpu::Adapter) -> Self {
        let info = adapter.get_info();
        Self { name: info.name, backend: info.backend, device_type: info.device_type }
    }

    /// Returns a warning if this is a software or OpenGL adapter.
    pub fn warning(&self) -> Option<String> {
        let what = if self.device_type == wgpu::DeviceType::Cpu {
            "runs on the CPU instead of a graphics card"
        } else if self.backend == wgpu::Backend::Gl {
            "uses OpenGL, which is slower and less tested"
        } else {
            return None;
        };
        Some(format!("{self} {what}; choose another adapter in Settings or with --adapter"))
    }
}

impl fmt::Display for AdapterInfo {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = match self.device_type {
            wgpu::DeviceType::DiscreteGpu => "discrete",
            wgpu::DeviceType::IntegratedGpu => "integrated",
            wgpu::DeviceType::VirtualGpu => "virtual",
            wgpu::DeviceType::Cpu => "software",
            wgpu::DeviceType::Other => "unknown type",
        };
        write!(f, "{} ({}, {kind})", self.name, self.backend)
    }
}

/// No adapter matches the choice.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("adapter: expected auto, software, or the name or number of an available adapter: {}; found `{choice}`", listed(.there))]
pub struct UnknownAdapter {
    /// Choice that matches no adapter.
    pub choice: AdapterChoice,
    /// Available adapters.
    pub there: Vec<AdapterInfo>,
}

pub(super) fn listed(adapters: &[AdapterInfo]) -> String {
    let line = |(i, adapter): (usize, &AdapterInfo)| format!("{i}: {adapter}");
    let lines: Vec<String> = adapters.iter().enumerate().map(line).collect();
    if lines.is_empty() { "none".to_owned() } else { format!("[{}]", lines.join("; ")) }
}

/// True if this computer may have a graphics card. Only Linux is checked, where `/dev` lists the cards.
/// Enumerating adapters instead would load all drivers, and the software driver includes a compiler of
/// 50 MB.
pub fn may_have_gpu() -> bool {
    !cfg!(target_os = "linux") || has_gpu_device_file(Path::new("/dev"))
}

/// True if a device folder lists a graphics card of any vendor, or cannot be read.
fn has_gpu_device_file(devices: &Path) -> bool {
    // DRM, NVIDIA, WSL, Qualcomm, Arm, Imagination, and AMD for computing alone.
    const CARDS: [&str; 7] = ["dri", "nvidia", "dxg", "kgsl", "mali", "pvr", "kfd"];
    let Ok(entries) = std::fs::read_dir(devices) else { return true };
    let is_card = |name: &str| CARDS.iter().any(|card| name.starts_with(card));
    entries.flatten().any(|entry| entry.file_name().to_str().is_some_and(is_card))
}

/// Lists the adapters of this computer that can draw windows. [`AdapterChoice::Index`] is an index in
/// this list.
pub fn list() -> Vec<AdapterInfo> {
    enumerate().iter().map(AdapterInfo::new).collect()
}

/// Returns the wgpu adapters in the order of [`list`].
pub(super) fn enumerate() -> Vec<wgpu::Adapter> {
    // Backends that can draw windows: all first-class ones, and OpenGL.
    enumerate_in(wgpu::Backends::PRIMARY | wgpu::Backends::GL)
}

/// Returns the adapters of the given backends, unless the environment selects other backends.
pub(super) fn enumerate_in(backends: wgpu::Backends) -> Vec<wgpu::Adapter> {
    let backends = wgpu::Backends::from_env().unwrap_or(backends);
    let environment = wgpu::InstanceDescriptor::new_without_display_handle_from_env();
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor { backends, ..environment });
    poll_once(instance.enumerate_adapters(backends)).unwrap_or_default()
}

/// Polls a future once and returns its value; native wgpu futures resolve immediately. `None` if the
/// future is still pending.
pub(super) fn poll_once<T>(future: impl Future<Output = T>) -> Option<T> {
    match std::pin::pin!(future).poll(&mut Context::from_waker(Waker::noop())) {
        Poll::Ready(value) => Some(value),
        Poll::Pending => None,
    }
}

/// Returns the index of the chosen adapter in `adapters`. `None` for [`AdapterChoice::Auto`], which
/// leaves the ranking to wgpu or [`super::headless`].
pub fn choose(
    choice: &AdapterChoice,
    adapters: &[AdapterInfo],
) -> Result<Option<usize>, UnknownAdapter> {
    let is_named =
        |a: &AdapterInfo, name: &str| a.to_string().to_lowercase().contains(&name.to_lowercase());
    let found = match choice {
        // Only wgpu knows which adapter can present to the window's surface.
        AdapterChoice::Auto => return Ok(None),
        AdapterChoice::Software => {
            adapters.iter().position(|a| a.device_type == wgpu::DeviceType::Cpu)
        }
        AdapterChoice::Named(name) => adapters.iter().position(|a| is_named(a, name)),
        AdapterChoice::Index(index) => Some(*index).filter(|&i| i < adapters.len()),
    };
    let unknown = || UnknownAdapter { choice: choice.clone(), there: adapters.to_vec() };
    found.map(Some).ok_or_else(unknown)
}

const OPTIONAL: wgpu::Features = wgpu::Features::TIMESTAMP_QUERY;

/// Returns a description of a device with the adapter's own limits and its available optional features.
/// A splat buffer needs the adapter's largest possible binding.
pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    wgpu::DeviceDescriptor {
        label: Some("vbgs device"),
        // Requesting an unavailable feature would fail.
        required_features: adapter.features() & OPTIONAL,
        // wgpu's default limits would allow only 2 million splats on any card.
        required_limits: adapter.limits(),
        ..Default::default()
    }
}

/// Capabilities of a device, and its description for the status bar.
#[derive(Clone, Debug, PartialEq)]
pub struct GpuCaps {
    /// Description of the adapter.
    pub info: AdapterInfo,
    /// Driver and version as reported by the driver; may be empty.
    driver: String,
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
        let missing = [
            // Downlevel adapters (OpenGL ES, WebGL) may lack them; limits do not show that.
            (flags.contains(wgpu::DownlevelFlags::COMPUTE_SHADERS), "compute shaders"),
            // The preprocessing kernel binds 8.
            (limits.max_storage_buffers_per_shader_stage >= 8, "8 storage buffers in a shader"),
            (limits.max_storage_textures_per_shader_stage >= 1, "storage textures"),
            (limits.max_compute_invocations_per_workgroup >= GROUP, "workgroups of 256"),
            // The raster and walk kernels use 15 KiB.
            (limits.max_compute_workgroup_storage_size >= 1 << 14, "16 KiB of workgroup memory"),
        ]
        .into_iter()
        .find_map(|(is_there, what)| (!is_there).then_some(what));
        Self {
            info: AdapterInfo::new(adapter),
            driver: format!("{} {}", info.driver, info.driver_info).trim().to_owned(),
            has_timestamps: device.features().contains(wgpu::Features::TIMESTAMP_QUERY),
            missing,
        }
    }

    /// True if the adapter runs on the CPU (llvmpipe, WARP), where the CPU renderer is many times
    /// faster (`rendering.md`, Software adapters).
    pub fn is_software(&self) -> bool {
        self.info.device_type == wgpu::DeviceType::Cpu
    }

    /// Fails if the adapter cannot run the shaders.
    pub fn check(&self) -> Result<(), GpuError> {
        match self.missing {
            Some(missing) => {
                Err(GpuError::Unsupported { adapter: self.info.name.clone(), missing })
            }
            None => Ok(()),
        }
    }
}

impl fmt::Display for GpuCaps {
    /// Formats name, backend and driver as one line for the status bar.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({}", self.info.name, self.info.backend)?;
        if !self.driver.is_empty() {
            write!(f, ", {}", self.driver)?;
        }
        write!(f, "{})", if self.is_software() { ", software" } else { "" })
    }
}

/// Returns the size, in bytes, of the largest buffer that one binding can hold.
pub(super) fn max_buffer_bytes(limits: &wgpu::Limits) -> u64 {
    limits.max_buffer_size.min(limits.max_storage_buffer_binding_size)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn there() -> Vec<AdapterInfo> {
        let facts = |name: &str, backend, device_type| AdapterInfo {
            name: name.to_owned(),
            backend,
            device_type,
        };
        vec![
            facts("NVIDIA RTX", wgpu::Backend::Vulkan, wgpu::DeviceType::DiscreteGpu),
            facts("llvmpipe", wgpu::Backend::Vulkan, wgpu::DeviceType::Cpu),
            facts("NVIDIA RTX/PCIe", wgpu::Backend::Gl, wgpu::DeviceType::Other),
        ]
    }

    #[test]
    fn adapters_are_found_by_number_name_and_kind() {
        let asked = |text: &str| choose(&AdapterChoice::parse(text), &there());
        assert_eq!(asked("auto"), Ok(None));
        assert_eq!(asked("software"), Ok(Some(1)));
        assert_eq!(asked("nvidia"), Ok(Some(0)));
        assert_eq!(asked("PCIe"), Ok(Some(2)));
        assert_eq!(asked("llvmpipe (vulkan, software)"), Ok(Some(1)));
        assert_eq!(asked("2"), Ok(Some(2)));
        for wrong in ["3", "radeon"] {
            let text = asked(wrong).unwrap_err().to_string();
            assert!(
                text.contains(wrong) && text.contains("1: llvmpipe (vulkan, software)"),
                "{text}"
            );
        }
        let none = choose(&AdapterChoice::Software, &[]).unwrap_err().to_string();
        assert!(none.contains("adapter: none") && none.contains("`software`"), "{none}");
    }

    #[test]
    fn a_card_shows_in_the_folder_of_devices() {
        let devices = tempfile::tempdir().unwrap();
        std::fs::write(devices.path().join("null"), "").unwrap();
        assert!(!has_gpu_device_file(devices.path()));
        std::fs::write(devices.path().join("nvidia0"), "").unwrap();
        assert!(has_gpu_device_file(devices.path()));
        assert!(
            has_gpu_device_file(&devices.path().join("none")),
            "an unreadable folder counts as a card"
        );
    }

    #[test]
    fn only_software_and_opengl_are_worth_a_word() {
        let worth: Vec<bool> = there().iter().map(|a| a.warning().is_some()).collect();
        assert_eq!(worth, [false, true, true]);
    }
}
