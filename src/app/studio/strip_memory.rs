//! State of the frame strip.

use crate::app::frame_outcomes::FrameOutcomes;
use crate::app::panels::frame_strip::StripPosition;
use crate::app::viewer::preview::SavedPosition;

/// State of the frame strip for the open dataset.
#[derive(Default)]
pub(super) struct FrameStripState {
    pub(super) outcomes: FrameOutcomes,
    pub(super) position: StripPosition,
    /// Serial of the open dataset and view before a preview began.
    pub(super) before: Option<(u64, SavedPosition)>,
}
