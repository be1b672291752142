//! What a device beside the processor says when it cannot do its part of a frame.

/// A device could not do its part; whoever asked it goes on without.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device}: expected a pass over a frame, which failed: {reason}")]
pub struct DeviceError {
    /// What it was to run on.
    pub device: String,
    /// What went wrong, in the device's words.
    pub reason: String,
}
