//! Temporary visits to dataset cameras.

use super::SceneView;
use super::frame_refs::FrameRef;
use super::stand::{GuideStage, Place};
use std::time::Instant;

/// Position before a temporary visit.
pub struct PlaceBefore {
    place: Place,
    guide: Option<GuideStage>,
    latest_frame: Option<FrameRef>,
}

impl SceneView {
    /// Current position, to return to.
    pub fn place_now(&self) -> PlaceBefore {
        PlaceBefore {
            place: self.place.clone(),
            guide: self.guide,
            latest_frame: self.latest_frame.clone(),
        }
    }

    /// Restores a position.
    pub fn return_to(&mut self, before: PlaceBefore) {
        let PlaceBefore { place, guide, latest_frame } = before;
        (self.place, self.guide, self.latest_frame) = (place, guide, latest_frame);
        self.moved_at = Instant::now();
    }
}
