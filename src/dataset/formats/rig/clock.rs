//! Inputs of the rig estimate: image pairs, timestamps, trajectory and readout times.

use super::mount::Mount;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::FrameProblem;
use crate::dataset::source::ByteSource;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;

/// A depth image and its photograph, of one lens, with their timestamps.
pub(in super::super) struct ImagePair {
    pub name: String,
    pub depth: (f64, DepthSource),
    pub color: (f64, ByteSource),
}

impl ImagePair {
    /// Reads one of its files. Retries once, because a passing disk error would change the estimate
    /// silently.
    pub fn read<T>(&self, read: impl Fn() -> Result<T, FrameProblem>) -> Option<T> {
        let told = |problem| {
            tracing::warn!(
                "frame {}: {problem}; delays are estimated from other frames",
                self.name
            );
        };
        read().or_else(|_| read()).map_err(told).ok()
    }
}

/// Camera motion and readout times.
pub(in super::super) struct Clock<At> {
    /// World pose at a time; `None` if unknown.
    pub at: At,
    /// Intrinsics of both images.
    pub intrinsics: Intrinsics,
    /// Seconds from the first to the last row of a depth image; its timestamp is that of the middle row.
    pub depth_reading: f64,
    /// The same for a photograph.
    pub color_reading: f64,
}

impl<At> Clock<At>
where
    At: Fn(f64) -> Option<Pose>,
{
    /// Returns the clock of a camera with this mount on the tracked body.
    pub fn mounted(&self, mount: Mount) -> Clock<impl Fn(f64) -> Option<Pose>> {
        let at = move |time| (self.at)(time).map(|pose| mount.camera_pose(&pose));
        let Self { intrinsics, depth_reading, color_reading, .. } = *self;
        Clock { at, intrinsics, depth_reading, color_reading }
    }

    /// Returns a clock with readout times multiplied by `times`.
    pub fn slowed(&self, times: f64) -> Clock<&At> {
        let Self { at, intrinsics, depth_reading, color_reading } = self;
        let [depth_reading, color_reading] = [times * depth_reading, times * color_reading];
        Clock { at, intrinsics: *intrinsics, depth_reading, color_reading }
    }
}
