//! What learning takes of the machine's memory: the form of an estimate, and what both presets take.
//! Each preset's own is beside its engine.

/// Decoded images of a frame and memory of unprojection, per pixel.
pub(super) const PIXEL_BYTES: usize = 24;
/// The program itself.
pub(super) const PROGRAM_BYTES: u64 = 30_000_000;

/// Bytes that a run is expected to take at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Grows with the number of components.
    pub model: u64,
    /// The rest; grows with the size of a frame.
    pub frames: u64,
}

impl MemoryEstimate {
    /// All of it.
    pub fn total(&self) -> u64 {
        self.model.saturating_add(self.frames)
    }
}
