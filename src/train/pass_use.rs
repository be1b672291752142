//! Statistics of the device used for passes over frames or for fitting a scene's points, for reports and the
//! console.

use super::device_trial::{DeviceMs, device_summary};
use serde::{Deserialize, Serialize};

/// Devices used in this session for passes over frames or for fitting a scene's points.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PassUse {
    /// Name of the device requested besides the CPU.
    pub device: Option<String>,
    /// Number of frames fitted by the device.
    pub device_frames: u64,
    /// Number of frames fitted by the CPU.
    pub processor_frames: u64,
    /// Share of tiles (of points for a scene) that the device left to the CPU.
    pub open_share: f64,
    /// Timings of one fit that decided between device and CPU, if measured.
    pub trial: Option<DeviceMs>,
    /// Reason for a fallback to the CPU, if any.
    pub given_up: Option<String>,
}

impl PassUse {
    /// Records a fallback to the CPU and logs one warning.
    pub(super) fn record_fallback(&mut self, reason: String) {
        tracing::warn!("{}: {reason}", self.device.as_deref().unwrap_or_default());
        self.given_up = Some(reason);
    }

    /// Returns a one-line summary.
    pub fn summary_line(&self) -> String {
        let counts = [self.device_frames, self.processor_frames];
        let Self { device, trial, given_up, .. } = self;
        let did = ["fitted", "frames"];
        device_summary(did, device.as_deref(), counts, *trial, given_up.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_was_used() {
        let mut found = PassUse { processor_frames: 3, ..PassUse::default() };
        assert_eq!(found.summary_line(), "the processor fitted frames");
        (found.device, found.device_frames) = (Some("Card".into()), 5);
        assert_eq!(found.summary_line(), "Card fitted 5 frames, the processor 3");
    }
}
