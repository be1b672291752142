//! Guided camera: shows all dataset cameras before training, the camera of the latest frame during
//! training, and the whole scene at the end.
//!
//! Steering by the user ends it, the Ride along command starts it again. It moves with the snapshots,
//! without animation: pictures in between would take CPU time from training if no GPU draws.

use super::SceneView;
use super::frame_refs::FrameRef;
use super::steering::{GuideStage, ViewPosition};
use crate::app::camera::ViewCamera;
use crate::app::state::{Opened, RunState, Snapshot, Source};
use crate::model::splat::framing::{Framing, framing};
use glam::DVec3;
use std::time::Instant;

impl SceneView {
    /// True while the camera follows training.
    pub fn is_guided(&self) -> bool {
        self.guide.is_some()
    }

    pub(super) fn toggle_guide(&mut self) {
        self.guide = match self.guide {
            Some(_) => None,
            None => Some(GuideStage::Start),
        };
    }

    /// Moves a guided camera to the current stage of training.
    pub(super) fn follow_guide(&mut self, opened: &Opened, snapshot: &Snapshot) {
        let Some(shown) = self.guide else { return };
        let now = match (snapshot.state, snapshot.recent.last()) {
            (RunState::Finished | RunState::Failed, _) => GuideStage::End,
            (_, Some(frame)) => GuideStage::Frame(frame.index),
            (_, None) => GuideStage::Overview,
        };
        if now == shown {
            return;
        }
        self.guide = Some(now);
        self.place = ViewPosition::Free;
        match now {
            GuideStage::Start => {}
            GuideStage::Overview => self.frame_all_cameras(opened),
            GuideStage::Frame(position) => {
                let frame = FrameRef::trained(opened, position);
                if let (Some(frame), Some(camera)) = (frame, &mut self.camera) {
                    camera.move_to_camera(&frame.entry().camera);
                }
            }
            GuideStage::End => self.frame_finished_scene(opened, snapshot.source),
        }
    }

    /// Moves back until every camera of the dataset is visible.
    fn frame_all_cameras(&mut self, opened: &Opened) {
        let (Some(camera), Some(around)) = (&mut self.camera, framing_of_cameras(opened)) else {
            return;
        };
        camera.fit_scene_from_above(&around, self.viewport);
        self.moved_at = Instant::now();
    }

    /// Shows the whole scene if it was captured from outside. A room is shown from its first camera:
    /// from outside only the backs of its walls would be visible.
    fn frame_finished_scene(&mut self, opened: &Opened, source: Source) {
        let splats = framing(self.palette.splats().iter());
        let is_inside = match (&splats, source) {
            (Some(scene), Source::Dataset) => are_inside(&camera_centres(opened), scene),
            _ => false,
        };
        let Some(camera) = &mut self.camera else { return };
        match splats {
            Some(scene) if !is_inside => camera.fit_scene(&scene, self.viewport),
            _ => *camera = ViewCamera::home(&opened.home),
        }
        self.moved_at = Instant::now();
    }
}

/// Centres of the cameras of the run's frames.
fn camera_centres(opened: &Opened) -> Vec<DVec3> {
    let (Some(dataset), Some(plan)) = (&opened.dataset, &opened.plan) else { return Vec::new() };
    let frames = dataset.splits.get(plan.split).map_or(&[][..], |split| split.frames.as_slice());
    let trained = plan.frames.iter().filter_map(|&index| frames.get(index));
    trained.map(|frame| frame.camera.pose.centre()).collect()
}

/// Sphere around all cameras and the point halfway between them and the scene.
fn framing_of_cameras(opened: &Opened) -> Option<Framing> {
    let centres = camera_centres(opened);
    let mean = centres.iter().copied().sum::<DVec3>() / centres.len().max(1) as f64;
    let centre = 0.5 * (mean + opened.home.target);
    let farthest = centres.iter().map(|c| c.distance(centre)).fold(0.0, f64::max);
    let radius = farthest.max(0.5 * opened.home.radius);
    (!centres.is_empty()).then_some(Framing { centre, radius })
}

/// True if most of the cameras are inside the scene.
fn are_inside(cameras: &[DVec3], scene: &Framing) -> bool {
    let n = cameras.iter().filter(|c| c.distance(scene.centre) < scene.radius).count();
    2 * n > cameras.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_around_an_object_are_outside_and_those_of_a_room_inside() {
        let scene = Framing { centre: DVec3::ZERO, radius: 1.0 };
        assert!(!are_inside(&[DVec3::X * 4.0, DVec3::Y * 4.0, DVec3::ZERO], &scene));
        assert!(are_inside(&[DVec3::X * 0.5, DVec3::ZERO, DVec3::Z * 3.0], &scene));
        assert!(!are_inside(&[], &scene), "a model without cameras is seen whole");
    }
}
