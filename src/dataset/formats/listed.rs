//! Frames on their way into a split: files found, pose sound, camera and depth format still open.
//!
//! A layout names one camera and one depth encoding for a whole split, and both depend on the size
//! and the pixel format of its images. So frames are first listed, then the header of the first
//! readable image decides, then the split is made.

use super::format::ParsedFolder;
use crate::dataset::decode;
use crate::dataset::decode::{DepthEncoding, ImageHeader};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DatasetSplit, DepthSource, FrameEntry, FrameFiles, FrameSource};
use crate::dataset::error::FrameProblem;
use crate::dataset::source::ByteSource;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use std::path::{Path, PathBuf};

fn header(path: &Path) -> Result<ImageHeader, FrameProblem> {
    decode::header(&ByteSource::File(path.to_owned()))
}

/// A frame whose colour image exists and whose pose is sound.
pub(super) struct ListedFrame {
    pub name: String,
    pub pose: Pose,
    pub color: PathBuf,
    // An error until all frames are listed: in a split without any depth a missing file is none.
    pub depth: Result<PathBuf, FrameProblem>,
}

/// The frames of one split.
pub(super) struct ListedSplit {
    pub name: String,
    pub frames: Vec<ListedFrame>,
}

impl ListedSplit {
    /// Whether the split is meant to have depth: a single depth image says so.
    pub fn has_depth(&self) -> bool {
        self.frames.iter().any(|c| c.depth.is_ok())
    }

    /// The first readable colour header: it sets the size of the split's camera.
    pub fn color_header(&self) -> Option<ImageHeader> {
        // Not that of the first frame: one damaged image must not cost the whole split.
        self.frames.iter().find_map(|c| header(&c.color).ok())
    }

    /// The first readable depth header.
    pub fn depth_header(&self) -> Option<ImageHeader> {
        self.frames.iter().find_map(|c| header(c.depth.as_ref().ok()?).ok())
    }

    /// Makes the split; in one with depth, frames without are skipped.
    pub fn into_split(
        self,
        intrinsics: Intrinsics,
        encoding: DepthEncoding,
        parsed: &mut ParsedFolder,
    ) -> DatasetSplit {
        let has_depth = self.has_depth();
        let mut frames = Vec::with_capacity(self.frames.len());
        for ListedFrame { name, pose, color, depth } in self.frames {
            let depth = match depth {
                Ok(path) => Some(DepthSource { file: path.into(), encoding, confidence: None }),
                Err(problem) if has_depth => {
                    parsed.skip(&self.name, &name, color, problem);
                    continue;
                }
                Err(_) => None,
            };
            let lens = Distortion::default();
            let source =
                FrameSource::Files(Box::new(FrameFiles { color: color.into(), depth, lens }));
            let camera = Camera { intrinsics, pose };
            frames.push(FrameEntry { name, camera, color_camera: None, time: None, source });
        }
        DatasetSplit { name: self.name, frames, has_depth }
    }

    /// Without a readable header there is no camera: each frame gets its own message.
    pub fn skip_unreadable(self, parsed: &mut ParsedFolder) {
        for ListedFrame { name, color, .. } in self.frames {
            if let Err(problem) = header(&color) {
                parsed.skip(&self.name, &name, color, problem);
            }
        }
    }
}
