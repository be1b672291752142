//! The current frame in the view: its points over the picture.

use super::SceneView;
use super::frame_points::FramePoints;
use super::frame_refs::FrameRef;
use super::world_painter::WorldPainter;
use crate::app::state::{Opened, RunState, Snapshot};
use std::time::Instant;

impl SceneView {
    /// The frame whose points are drawn, by its place among all, and how many they are.
    pub fn points_shown(&self) -> Option<(usize, usize)> {
        let shown = self.points.shown().filter(|_| self.settings.shows_points);
        shown.map(|(frame, points)| (frame.number(), points.as_ref().map_or(0, Vec::len)))
    }

    /// The frame that is looked at or else was trained last; before training the first.
    fn current_frame(&self, opened: &Opened, snapshot: &Snapshot) -> Option<FrameRef> {
        let latest = snapshot.recent.last().map_or(0, |frame| frame.index);
        self.frame_ref().cloned().or_else(|| FrameRef::trained(opened, latest))
    }

    /// Draws the points of the current frame; of the one before until they are there.
    pub(super) fn frame_points(
        &mut self,
        world: &WorldPainter,
        opened: &Opened,
        snapshot: &Snapshot,
    ) {
        self.points.take();
        if let Some(frame) = self.current_frame(opened, snapshot) {
            // Where the camera really stood, as far as the scene tells.
            let scene = self.palette.splats().finishing();
            let pose = scene.corrected(&frame.entry().camera.pose);
            let cameras = (pose, opened.color_camera());
            let is_training = snapshot.state == RunState::Training;
            if let Err(error) = self.points.ask(frame, cameras, is_training, &self.waker) {
                let text = format!("No thread to decode a frame on: {error}");
                self.hint = Some((text, Instant::now()));
            }
        }
        match self.points.shown() {
            None => {}
            Some((_, Ok(points))) => world.points(points),
            Some((_, Err(problem))) => self.hint = Some((problem.clone(), Instant::now())),
        }
    }

    /// Shows points no longer, or again.
    pub(super) fn toggle_points(&mut self) {
        self.settings.shows_points = !self.settings.shows_points;
        self.points = FramePoints::default();
    }
}
