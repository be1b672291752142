//! A device without a window: for benches, and for pictures where there is no display.

use super::adapters::{self, AdapterChoice, AdapterFacts, UnknownAdapter};
use super::context::{GpuCaps, device_descriptor};
use super::error::GpuError;
use super::faults::GpuFaults;
use super::mixture::GpuMixture;
use super::photometric::GpuComparer;
use super::points::GpuPoints;
use super::poll::ready;
use std::time::Duration;

/// A GPU that takes longer than this for one frame is not coming back.
const PATIENCE: Duration = Duration::from_secs(30);

/// Why there is no device, or no more.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum HeadlessError {
    /// Nothing but software, or nothing at all.
    #[error(
        "expected a graphics adapter that is not software, found {found}; install its driver, or choose with --adapter"
    )]
    NoHardware {
        /// What there is.
        found: String,
    },
    /// Nothing goes by that name.
    #[error("--{0}")]
    NotFound(#[from] UnknownAdapter),
    /// The driver gives no device.
    #[error(
        "{adapter}: expected a device, which the driver refused ({reason}); choose another with --adapter"
    )]
    Refused {
        /// Name of the adapter.
        adapter: String,
        /// What the driver said.
        reason: String,
    },
    /// The device failed, or does not answer.
    #[error("{adapter}: {reason}")]
    Failed {
        /// Name of the adapter.
        adapter: String,
        /// What wgpu said.
        reason: String,
    },
    /// The adapter cannot do what is asked.
    #[error(transparent)]
    Gpu(#[from] GpuError),
}

/// A device, its queue and what they can do.
#[derive(Debug)]
pub struct HeadlessGpu {
    /// The device, with every limit and optional feature its adapter offers.
    pub device: wgpu::Device,
    /// The queue that takes the device's commands and uploads.
    pub queue: wgpu::Queue,
    /// What it can do.
    pub caps: GpuCaps,
    faults: GpuFaults,
}

impl HeadlessGpu {
    /// Opens a device with all that its adapter offers; [`AdapterChoice::Auto`] takes no software.
    pub fn new(choice: &AdapterChoice) -> Result<Self, HeadlessError> {
        let adapter = choose(choice)?;
        let name = adapter.get_info().name;
        let refused = |reason: String| HeadlessError::Refused { adapter: name.clone(), reason };
        let (device, queue) = ready(adapter.request_device(&device_descriptor(&adapter)))
            .ok_or_else(|| refused("no answer".to_owned()))?
            .map_err(|e| refused(e.to_string()))?;
        let faults = GpuFaults::default();
        faults.watch(&device);
        let caps = GpuCaps::new(&adapter, &device);
        caps.check()?;
        Ok(Self { device, queue, caps, faults })
    }

    /// What compares photographs on it.
    pub fn comparer(self) -> GpuComparer {
        GpuComparer::new(self.device, self.queue, self.faults, &self.caps)
    }

    /// What computes passes over frames on it.
    pub fn mixture(self) -> GpuMixture {
        GpuMixture::new(self.device, self.queue, self.faults, &self.caps)
    }

    /// What finds the seeds of a scene's points on it, and sums points.
    pub fn points(self) -> GpuPoints {
        GpuPoints::new(self.device, self.queue, self.faults, &self.caps)
    }

    /// Waits until everything submitted is done. An error if it was not done well.
    pub fn wait(&self) -> Result<(), HeadlessError> {
        let failed =
            |reason: String| HeadlessError::Failed { adapter: self.caps.adapter.clone(), reason };
        // A lost or hung device never answers; a bench must end with a message.
        let patiently = wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) };
        self.device.poll(patiently).map_err(|e| failed(e.to_string()))?;
        match self.faults.take().into_iter().next() {
            Some(fault) => Err(failed(fault.message)),
            None => Ok(()),
        }
    }
}

fn choose(choice: &AdapterChoice) -> Result<wgpu::Adapter, HeadlessError> {
    let mut adapters = match choice {
        // OpenGL is never taken unasked, and its drivers are the slowest to start.
        AdapterChoice::Auto => adapters::enumerate_in(wgpu::Backends::PRIMARY),
        _ => adapters::enumerate(),
    };
    let facts: Vec<AdapterFacts> = adapters.iter().map(AdapterFacts::new).collect();
    let position = match adapters::choose(choice, &facts)? {
        Some(position) => position,
        None => fastest(&facts)
            .ok_or_else(|| HeadlessError::NoHardware { found: adapters::listed(&facts) })?,
    };
    Ok(adapters.swap_remove(position))
}

/// The first of the most capable kind that is there, software and OpenGL left out.
fn fastest(adapters: &[AdapterFacts]) -> Option<usize> {
    let rank = |adapter: &AdapterFacts| match adapter.device_type {
        wgpu::DeviceType::DiscreteGpu => Some(0),
        wgpu::DeviceType::IntegratedGpu => Some(1),
        wgpu::DeviceType::VirtualGpu => Some(2),
        wgpu::DeviceType::Other => Some(3),
        wgpu::DeviceType::Cpu => None,
    };
    // OpenGL is the slower and less tested way: it must be asked for.
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
        let facts =
            |backend, device_type| AdapterFacts { name: "any".into(), backend, device_type };
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
