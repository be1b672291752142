//! What passes over frames ran on, or the fit of a scene's points, and what came of it: for reports and the
//! console.

use super::device_trial::{DeviceMs, who_did};
use serde::{Deserialize, Serialize};

/// What passes over frames, or the fit of a scene's points, ran on in this session.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PassUse {
    /// The device beside the processor, if one was to be used.
    pub device: Option<String>,
    /// Frames whose points the device fitted.
    pub device_frames: u64,
    /// Those that the processor fitted.
    pub processor_frames: u64,
    /// Share of the device's tiles, or of a scene's points, that it left to the processor.
    pub open_share: f64,
    /// What the choice was made by, if it was measured: one fit.
    pub trial: Option<DeviceMs>,
    /// Why the device was given up, if it was.
    pub given_up: Option<String>,
}

impl PassUse {
    /// Says, once, that the device was given up.
    pub(super) fn give_up(&mut self, reason: String) {
        tracing::warn!("{}: {reason}", self.device.as_deref().unwrap_or_default());
        self.given_up = Some(reason);
    }

    /// One line for people.
    pub fn line(&self) -> String {
        let counts = [self.device_frames, self.processor_frames];
        let Self { device, trial, given_up, .. } = self;
        let did = ["fitted", "frames"];
        who_did(did, device.as_deref(), counts, *trial, given_up.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_was_used() {
        let mut found = PassUse { processor_frames: 3, ..PassUse::default() };
        assert_eq!(found.line(), "the processor fitted frames");
        (found.device, found.device_frames) = (Some("Card".into()), 5);
        assert_eq!(found.line(), "Card fitted 5 frames, the processor 3");
    }
}
