//! What is known of a recording's images before any of them is looked at.

use crate::dataset::entry::DepthSource;
use crate::dataset::error::FrameProblem;
use crate::dataset::source::ByteSource;
use crate::math::camera::Intrinsics;

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
