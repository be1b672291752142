//! A device without a window: for benches, and for pictures where there is no display.

use super::GpuError;
use super::context::{GpuCaps, device_descriptor};
use super::faults::GpuFaults;
use super::scene::ready;
use std::time::Duration;

/// A GPU that takes longer than this for one frame is not coming back.
const PATIENCE: Duration = Duration::from_secs(30);

/// Which adapter to take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AdapterChoice<'a> {
    /// The most capable that is no software.
    Hardware,
    /// The first whose name holds this text, or the one at this position of the list; software
    /// counts.
    Named(&'a str),
}

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
    #[error(
        "--adapter: expected the name or the number of an adapter, found `{asked}`; there are {found}"
    )]
    NotFound {
        /// What was asked for.
        asked: String,
        /// What there is.
        found: String,
    },
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
    /// The device.
    pub device: wgpu::Device,
    /// Its queue.
    pub queue: wgpu::Queue,
    /// What it can do.
    pub caps: GpuCaps,
    faults: GpuFaults,
}

impl HeadlessGpu {
    /// Opens a device with all that its adapter offers.
    pub fn new(choice: AdapterChoice) -> Result<Self, HeadlessError> {
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

    /// Waits until everything submitted is done. An error if it was not done well.
    pub fn wait(&self) -> Result<(), HeadlessError> {
        let failed =
            |reason: String| HeadlessError::Failed { adapter: self.caps.adapter.clone(), reason };
        let patiently = wgpu::PollType::Wait { submission_index: None, timeout: Some(PATIENCE) };
        self.device.poll(patiently).map_err(|e| failed(e.to_string()))?;
        match self.faults.take().into_iter().next() {
            Some(fault) => Err(failed(fault.message)),
            None => Ok(()),
        }
    }
}

fn choose(choice: AdapterChoice) -> Result<wgpu::Adapter, HeadlessError> {
    let mut adapters = adapters();
    let found = || list(&adapters);
    let position = match choice {
        AdapterChoice::Hardware => adapters
            .iter()
            .position(|a| a.get_info().device_type != wgpu::DeviceType::Cpu)
            .ok_or_else(|| HeadlessError::NoHardware { found: found() })?,
        AdapterChoice::Named(asked) => {
            let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
            position(&names, asked).ok_or_else(|| HeadlessError::NotFound {
                asked: asked.to_owned(),
                found: found(),
            })?
        }
    };
    Ok(adapters.swap_remove(position))
}

/// All adapters but those of GL, the most capable kind first.
fn adapters() -> Vec<wgpu::Adapter> {
    let instance = wgpu::Instance::new(wgpu::InstanceDescriptor {
        backends: wgpu::Backends::PRIMARY,
        ..wgpu::InstanceDescriptor::new_without_display_handle()
    });
    let mut adapters =
        ready(instance.enumerate_adapters(wgpu::Backends::PRIMARY)).unwrap_or_default();
    adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    });
    adapters
}

fn list(adapters: &[wgpu::Adapter]) -> String {
    let named = |(i, adapter): (usize, &wgpu::Adapter)| {
        let info = adapter.get_info();
        format!("{i}: {} ({:?})", info.name, info.device_type)
    };
    match adapters {
        [] => "none".to_owned(),
        _ => adapters.iter().enumerate().map(named).collect::<Vec<_>>().join(", "),
    }
}

/// By number, else by part of the name in any case.
fn position(names: &[String], asked: &str) -> Option<usize> {
    if let Ok(number) = asked.parse::<usize>() {
        return (number < names.len()).then_some(number);
    }
    let asked = asked.to_lowercase();
    names.iter().position(|name| name.to_lowercase().contains(&asked))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adapters_go_by_number_or_part_of_their_name() {
        let names = ["NVIDIA H200", "Intel Arc 770", "llvmpipe (LLVM 15)"].map(str::to_owned);
        for (asked, expected) in [
            ("nvidia", Some(0)),
            ("Arc", Some(1)),
            ("LLVMpipe", Some(2)),
            ("2", Some(2)),
            ("3", None),
            ("radeon", None),
        ] {
            assert_eq!(position(&names, asked), expected, "{asked}");
        }
    }
}
