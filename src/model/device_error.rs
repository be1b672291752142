//! Error of a compute device that cannot complete its part of a frame.

/// A device failed; the caller continues on the processor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{device} failed to compute a pass over a frame: {reason}")]
pub struct DeviceError {
    /// Name of the device.
    pub device: String,
    /// Reason as reported by the device.
    pub reason: String,
}
