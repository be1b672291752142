//! Temporary visits to dataset cameras.

use super::SceneView;
use super::frame_refs::FrameRef;
use super::stand::{GuideStage, ViewPosition};
use std::time::Instant;

/// Position before a temporary visit.
pub struct SavedPosition {
    place: ViewPosition,
    guide: Option<GuideStage>,
    latest_frame: Option<FrameRef>,
}

impl SceneView {
    /// Current position, to return to.
    pub fn current_position(&self) -> SavedPosition {
        SavedPosition {
            place: self.place.clone(),
            guide: self.guide,
            latest_frame: self.latest_frame.clone(),
        }
    }

    /// Restores a position.
    pub fn restore_position(&mut self, before: SavedPosition) {
        let SavedPosition { place, guide, latest_frame } = before;
        (self.place, self.guide, self.latest_frame) = (place, guide, latest_frame);
        self.moved_at = Instant::now();
    }
}
