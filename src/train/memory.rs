//! Memory estimate of training, and the terms shared by both presets. Each preset's own terms are
//! beside its engine.

/// Decoded images of a frame and unprojection buffers, per pixel.
pub(super) const PIXEL_BYTES: usize = 24;
pub(super) const PROGRAM_BYTES: u64 = 30_000_000;

/// Upper estimate of the bytes used by a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Proportional to the number of components.
    pub model: u64,
    /// Remaining bytes, proportional to the size of a frame.
    pub frames: u64,
}

impl MemoryEstimate {
    /// Total bytes.
    pub fn total(&self) -> u64 {
        self.model.saturating_add(self.frames)
    }
}
