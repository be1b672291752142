//! Where a camera was while it read an image, strip by strip of rows.

use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;

/// Rows of a strip, and the rows and columns of which every so-many-th is a sample.
pub(super) const EVERY: usize = 16;

/// World poses at which the strips of an image were read.
pub(super) struct Strips {
    intrinsics: Intrinsics,
    poses: Vec<Option<Pose>>,
}

impl Strips {
    /// Of an image whose middle row was read at `time`, all rows in `reading` seconds.
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

    /// Rows of samples and where the camera was when it read them, where that is known.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &Pose)> {
        let rows = (EVERY / 2..).step_by(EVERY);
        rows.zip(&self.poses).filter_map(|(row, pose)| Some((row, pose.as_ref()?)))
    }

    /// Pixels from the left and the top rim, and depth, at which a world point is seen. Its row says when it
    /// was seen, and that where: twice round is enough for a pixel. `None` outside the image.
    pub fn seen(&self, world: DVec3) -> Option<[f64; 3]> {
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
