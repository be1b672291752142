//! Camera poses during the readout of an image, per strip of rows.

use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;

/// Rows of a strip, and distance between sampled rows and columns.
pub(super) const EVERY: usize = 16;

/// World pose for each strip of an image; `None` if unknown.
pub(super) struct Strips {
    intrinsics: Intrinsics,
    poses: Vec<Option<Pose>>,
}

impl Strips {
    /// Poses for an image whose middle row is read at `time` and all rows in `reading` seconds.
    pub fn new(
        intrinsics: Intrinsics,
        at: impl Fn(f64) -> Option<Pose>,
        time: f64,
        reading: f64,
    ) -> Self {
        let rows = intrinsics.height as usize;
        let strips = (EVERY / 2..rows).step_by(EVERY);
        let read = |row: usize| reading * ((row as f64 + 0.5) / rows as f64 - 0.5);
        Self { intrinsics, poses: strips.map(|row| at(time + read(row))).collect() }
    }

    /// Sampled rows with the camera's pose at their readout, if known.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &Pose)> {
        let rows = (EVERY / 2..).step_by(EVERY);
        rows.zip(&self.poses).filter_map(|(row, pose)| Some((row, pose.as_ref()?)))
    }

    /// Projects a world point to pixel column, pixel row and depth; `None` outside the image. The row
    /// determines the time and thereby the pose, so the projection is iterated; two rounds reach pixel
    /// accuracy.
    pub fn project(&self, world: DVec3) -> Option<[f64; 3]> {
        let k = &self.intrinsics;
        let (mut strip, mut seen) = (self.poses.len() / 2, None);
        for _ in 0..2 {
            let (rotation, translation) = (*self.poses.get(strip)?)?.inverse();
            let local = rotation * world + translation;
            if local.z <= 0.0 {
                return None;
            }
            let (u, v) = (k.fx * local.x / local.z + k.cx, k.fy * local.y / local.z + k.cy);
            if !(u >= 0.0 && v >= 0.0 && u < f64::from(k.width) && v < f64::from(k.height)) {
                return None;
            }
            strip = (v as usize / EVERY).min(self.poses.len() - 1);
            seen = Some([u, v, local.z]);
        }
        seen
    }
}
