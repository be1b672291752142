//! Points of the current frame, drawn over the picture.

use super::SceneView;
use super::frame_points::FramePoints;
use super::frame_refs::FrameRef;
use super::world_painter::WorldPainter;
use crate::app::state::{Opened, RunState, Snapshot};
use std::time::Instant;

impl SceneView {
    /// Number of the frame whose points are drawn, among all frames, and the number of its points.
    pub fn points_shown(&self) -> Option<(usize, usize)> {
        let shown = self.points.displayed().filter(|_| self.settings.shows_points);
        shown.map(|(frame, points)| (frame.number(), points.as_ref().map_or(0, Vec::len)))
    }

    /// Returns the frame in view, else the one trained last, else the first.
    fn current_frame(&self, opened: &Opened, snapshot: &Snapshot) -> Option<FrameRef> {
        let latest = snapshot.recent.last().map_or(0, |frame| frame.index);
        self.frame_ref().cloned().or_else(|| FrameRef::trained(opened, latest))
    }

    /// Draws the points of the current frame; until they are decoded, those of the previous one.
    pub(super) fn draw_frame_points(
        &mut self,
        world: &WorldPainter,
        opened: &Opened,
        snapshot: &Snapshot,
    ) {
        self.points.take_decoded();
        if let Some(frame) = self.current_frame(opened, snapshot) {
            // The corrected pose, because the scene is trained with it.
            let scene = self.palette.splats().finishing();
            let pose = scene.corrected_pose(&frame.entry().camera.pose);
            let cameras = (pose, opened.color_camera());
            let is_training = snapshot.state == RunState::Training;
            if let Err(error) =
                self.points.request_decoding(frame, cameras, is_training, &self.waker)
            {
                let text = format!("Starting the thread that decodes the frame failed: {error}");
                self.hint = Some((text, Instant::now()));
            }
        }
        match self.points.displayed() {
            None => {}
            Some((_, Ok(points))) => world.points(points),
            Some((_, Err(problem))) => self.hint = Some((problem.clone(), Instant::now())),
        }
    }

    pub(super) fn toggle_points(&mut self) {
        self.settings.shows_points = !self.settings.shows_points;
        self.points = FramePoints::default();
    }
}
