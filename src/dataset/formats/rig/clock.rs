//! What is known of a recording's images before any of them is looked at.

use super::mount::Mount;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::FrameProblem;
use crate::dataset::source::ByteSource;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;

/// A depth image and the photograph beside it, of one lens, with the times that they are stamped with.
pub(in super::super) struct Shot {
    pub name: String,
    pub depth: (f64, DepthSource),
    pub color: (f64, ByteSource),
}

impl Shot {
    /// What one of its files holds. Twice, as all that settings are chosen by: what a disk refuses once is
    /// learnt from later.
    pub fn read<T>(&self, read: impl Fn() -> Result<T, FrameProblem>) -> Option<T> {
        let told = |problem| {
            tracing::warn!("frame {}: {problem}; delays are told by others", self.name);
        };
        read().or_else(|_| read()).map_err(told).ok()
    }
}

/// How the camera moved, and how it reads images.
pub(in super::super) struct Clock<At> {
    /// World pose at a time, where it is known.
    pub at: At,
    /// Of both images.
    pub intrinsics: Intrinsics,
    /// Seconds from the first row of a depth image to the last, whose middle row is read at its time.
    pub depth_reading: f64,
    /// The same of a photograph.
    pub color_reading: f64,
}

impl<At> Clock<At>
where
    At: Fn(f64) -> Option<Pose>,
{
    /// One whose poses are of a camera that sits so on what the trajectory follows.
    pub fn mounted(&self, mount: Mount) -> Clock<impl Fn(f64) -> Option<Pose>> {
        let at = move |time| (self.at)(time).map(|pose| mount.of(&pose));
        let Self { intrinsics, depth_reading, color_reading, .. } = *self;
        Clock { at, intrinsics, depth_reading, color_reading }
    }

    /// One whose images take so many times as long to be read.
    pub fn slowed(&self, times: f64) -> Clock<&At> {
        let Self { at, intrinsics, depth_reading, color_reading } = self;
        let [depth_reading, color_reading] = [times * depth_reading, times * color_reading];
        Clock { at, intrinsics: *intrinsics, depth_reading, color_reading }
    }
}
