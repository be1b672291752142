//! What the strip of frames remembers of what is open.

use crate::app::frame_outcomes::FrameOutcomes;
use crate::app::panels::frame_strip::StripPosition;
use crate::app::viewer::preview::PlaceBefore;

/// What the strip of frames remembers of what is open.
#[derive(Default)]
pub(super) struct StripMemory {
    /// What became of the frames.
    pub(super) outcomes: FrameOutcomes,
    /// Where it is scrolled to.
    pub(super) position: StripPosition,
    /// Where one stood before a preview, and serial of what was open then.
    pub(super) before: Option<(u64, PlaceBefore)>,
}
