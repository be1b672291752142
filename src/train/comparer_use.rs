//! Statistics of the device that compares photographs, for reports and the console.

use super::device_trial::{DeviceMs, device_summary};
use serde::{Deserialize, Serialize};

/// Devices used to compare photographs in this session. Each trained photograph counts once; a settled
/// model includes those still in the shuffle buffer.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparerUse {
    /// Name of the device requested besides the CPU.
    pub device: Option<String>,
    /// Number of trained photographs compared by the device.
    pub device_frames: u64,
    /// Number of trained photographs compared by the CPU.
    pub processor_frames: u64,
    /// Timings that decided between device and CPU, if measured.
    pub trial: Option<DeviceMs>,
    /// Reason for a fallback to the CPU, if any.
    pub given_up: Option<String>,
    /// Mean milliseconds per photograph.
    pub ms: ComparerMs,
}

/// Milliseconds per photograph, by stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparerMs {
    /// Projecting, sorting and binning splats, on the CPU.
    pub prepare: f64,
    /// Comparing pixels on the chosen device; the sum of both during a trial.
    pub compare: f64,
    /// Computing and applying the step, on the CPU.
    pub step: f64,
}

impl ComparerUse {
    /// Returns a one-line summary.
    pub fn summary_line(&self) -> String {
        let counts = [self.device_frames, self.processor_frames];
        let Self { device, trial, given_up, .. } = self;
        let did = ["compared", "photographs"];
        device_summary(did, device.as_deref(), counts, *trial, given_up.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_was_used() {
        let mut found = ComparerUse { processor_frames: 3, ..ComparerUse::default() };
        assert_eq!(found.summary_line(), "the processor compared photographs");
        found.device = Some("Card".into());
        found.device_frames = 5;
        found.trial = Some(DeviceMs { processor: 12.0, device: 1.5 });
        assert_eq!(
            found.summary_line(),
            "Card compared 5 photographs, the processor 3 (measured: 1.5 ms on Card, 12.0 ms on the processor)"
        );
        found = ComparerUse { trial: None, given_up: Some("lost".into()), ..found };
        assert!(
            found.summary_line().ends_with("the processor 3; fell back to the processor: lost")
        );
    }
}
