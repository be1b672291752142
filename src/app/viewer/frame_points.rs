//! Points of the current frame in the viewport: the measured depth in the colours of the photograph.
//!
//! Frames are decoded one at a time on a separate thread. During training, each decoding is followed by a
//! pause of a multiple of its duration, to leave the cores to training; not every frame is shown then.

use super::frame_refs::FrameRef;
use crate::app::view_thread::RestingJob;
use crate::app::worker::Waker;
use crate::dataset::calibration::ColorCamera;
use crate::dataset::frame::DepthKind;
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use eframe::egui::Color32;
use glam::DVec3;

/// Maximum number of points drawn. More points are subsampled evenly.
// More would overlap.
const MAX_POINTS: usize = 12_000;

/// Points in world coordinates with their colours, or the reason why there are none.
pub(super) type Points = Result<Vec<(DVec3, Color32)>, String>;

#[derive(Default)]
pub(super) struct FramePoints {
    shown: Option<(FrameRef, Points)>,
    decoder: RestingJob<FrameRef, Points>,
}

impl FramePoints {
    pub fn displayed(&self) -> Option<(&FrameRef, &Points)> {
        self.shown.as_ref().map(|(frame, points)| (frame, points))
    }

    pub fn take_decoded(&mut self) {
        let Some((frame, decoded)) = self.decoder.take() else { return };
        let points = decoded.unwrap_or_else(|panic| {
            let text = panic.failure_notice("decoding the frame");
            Err(format!("{}: {text}", frame.entry().name))
        });
        self.shown = Some((frame, points));
    }

    /// Starts decoding a frame, unless it is decoded, another job is in progress, or training needs the
    /// cores.
    pub fn request_decoding(
        &mut self,
        frame: FrameRef,
        (pose, color_camera): (Pose, Option<ColorCamera>),
        is_training: bool,
        waker: &Waker,
    ) -> std::io::Result<()> {
        let is_shown = self.shown.as_ref().is_some_and(|(shown, _)| *shown == frame);
        if is_shown || !self.decoder.is_ready(is_training) {
            return Ok(());
        }
        let asked = frame.clone();
        let decode = move || points_of(&asked, pose, color_camera.as_ref());
        self.decoder.start("frame points", frame, waker.clone(), decode)
    }
}

/// Returns the coloured 3D points of a frame's depth image, in world coordinates. `pose` is the pose of the
/// depth camera.
fn points_of(frame: &FrameRef, pose: Pose, color_camera: Option<&ColorCamera>) -> Points {
    let (split, index) = frame.position();
    let loaded = frame.dataset().load(split, index).map_err(|error| error.to_string())?;
    let Some(depth) = &loaded.depth else {
        return Err(format!("{}: this frame has no depth", loaded.name));
    };
    let camera = Camera { pose, ..loaded.camera };
    let photo = frame.entry().photo_camera_at(pose, color_camera);
    let (width, height) = depth.size();
    // Per axis, hence the root.
    let stride = ((width * height) as f64 / MAX_POINTS as f64).sqrt().ceil().max(1.0) as usize;
    let mut points = Vec::with_capacity(MAX_POINTS);
    for row in (stride / 2..height).step_by(stride) {
        for column in (stride / 2..width).step_by(stride) {
            let length = depth.value_at(column, row).filter(|length| depth.is_trusted(*length));
            let Some(length) = length else { continue };
            let ray = camera.intrinsics.ray(column, row);
            let point = camera.pose.transform_point(match depth.kind {
                DepthKind::Z => ray * (length / ray.z),
                DepthKind::RayDistance => ray.normalize() * length,
            });
            let (pixel, ahead) = photo.project(point);
            let is_seen = ahead > 0.0 && pixel.min_element() >= 0.0;
            let [x, y] = pixel.to_array().map(|v| v as usize);
            // Points that project outside the photograph have no colour.
            let color = match is_seen && x < loaded.color.width && y < loaded.color.height {
                true => *loaded.color.at(x, y),
                false => [128, 128, 128, 255],
            };
            // Mostly transparent pixels are the background of a rendered dataset.
            if color[3] > 127 {
                points.push((point, Color32::from_rgb(color[0], color[1], color[2])));
            }
        }
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::session::demo_dataset;

    #[test]
    fn points_lie_where_the_camera_measured_them_in_its_colours() {
        let dataset = demo_dataset().unwrap();
        let frame = FrameRef::first(&dataset).unwrap();
        let camera = frame.entry().camera;
        let points = points_of(&frame, camera.pose, None).unwrap();
        assert!(points.len() > 1000 && points.len() <= MAX_POINTS, "{}", points.len());
        let loaded = frame.entry().load().unwrap();
        let depth = loaded.depth.unwrap();
        for (point, color) in points.into_iter().step_by(97) {
            let (pixel, ahead) = camera.project(point);
            let [x, y] = pixel.to_array().map(|v| v as usize);
            let [r, g, b, _] = *loaded.color.at(x, y);
            assert_eq!(color, Color32::from_rgb(r, g, b));
            let measured = match depth.kind {
                DepthKind::Z => ahead,
                DepthKind::RayDistance => point.distance(camera.pose.centre()),
            };
            assert!((measured - depth.value_at(x, y).unwrap()).abs() < 1e-6);
        }
        // With a corrected pose the points move along.
        let moved = Pose::look_at(camera.pose.centre() + DVec3::X, DVec3::ZERO, DVec3::Z).unwrap();
        assert!(points_of(&frame, moved, None).unwrap()[0].0.is_finite());
    }
}
