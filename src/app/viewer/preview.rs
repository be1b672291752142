//! Looking through cameras of the dataset for a moment, and back to where one stood.

use super::SceneView;
use super::frame_refs::FrameRef;
use super::stand::{GuideStage, Place};
use std::time::Instant;

/// Where one stood before a preview.
pub struct PlaceBefore {
    place: Place,
    guide: Option<GuideStage>,
    latest_frame: Option<FrameRef>,
}

impl SceneView {
    /// Where one stands now, to come back to.
    pub fn place_now(&self) -> PlaceBefore {
        PlaceBefore {
            place: self.place.clone(),
            guide: self.guide,
            latest_frame: self.latest_frame.clone(),
        }
    }

    /// Stands there again, and goes on as before.
    pub fn return_to(&mut self, before: PlaceBefore) {
        let PlaceBefore { place, guide, latest_frame } = before;
        (self.place, self.guide, self.latest_frame) = (place, guide, latest_frame);
        self.moved_at = Instant::now();
    }
}
