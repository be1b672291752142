//! What photographs are compared on, and what that took: for reports and the console.

use super::device_trial::{DeviceMs, who_did};
use serde::{Deserialize, Serialize};

/// What photographs were compared on in this session: each that was learnt counts once, at rest those as well
/// that have still waited.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparerUse {
    /// The device beside the processor, if one was to be used.
    pub device: Option<String>,
    /// Photographs whose comparison by the device was learnt from.
    pub device_frames: u64,
    /// Those that the processor compared.
    pub processor_frames: u64,
    /// What the choice was made by, if it was measured.
    pub trial: Option<DeviceMs>,
    /// Why the device was given up, if it was.
    pub given_up: Option<String>,
    /// Mean milliseconds of a photograph.
    pub ms: ComparerMs,
}

/// Milliseconds of a photograph by what is done with it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparerMs {
    /// Projecting, sorting and listing splats, on the processor.
    pub prepare: f64,
    /// Walking over pixels, on whichever was used; both while they are tried.
    pub compare: f64,
    /// Lifting and stepping, on the processor.
    pub step: f64,
}

impl ComparerUse {
    /// One line for people.
    pub fn line(&self) -> String {
        let counts = [self.device_frames, self.processor_frames];
        let Self { device, trial, given_up, .. } = self;
        let did = ["compared", "photographs"];
        who_did(did, device.as_deref(), counts, *trial, given_up.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_what_was_used() {
        let mut found = ComparerUse { processor_frames: 3, ..ComparerUse::default() };
        assert_eq!(found.line(), "the processor compared photographs");
        found.device = Some("Card".into());
        found.device_frames = 5;
        found.trial = Some(DeviceMs { processor: 12.0, device: 1.5 });
        assert_eq!(
            found.line(),
            "Card compared 5 photographs, the processor 3 (measured: 1.5 ms on Card, 12.0 ms on the processor)"
        );
        found = ComparerUse { trial: None, given_up: Some("lost".into()), ..found };
        assert!(found.line().ends_with("the processor 3; the device was given up: lost"));
    }
}
