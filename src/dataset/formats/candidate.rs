//! Frames on their way into a split: files found, pose sound, camera and depth format still open.

use super::Parsed;
use crate::dataset::decode;
use crate::dataset::decode::{DepthEncoding, Header};
use crate::dataset::error::FrameProblem;
use crate::dataset::{FrameEntry, FrameSource, Split};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use std::path::PathBuf;

/// A frame whose colour image exists and whose pose is sound.
pub(super) struct Candidate {
    pub name: String,
    pub pose: Pose,
    pub color: PathBuf,
    pub depth: Result<PathBuf, FrameProblem>,
}

/// The candidates of one split.
pub(super) struct Candidates {
    pub split: String,
    pub frames: Vec<Candidate>,
}

impl Candidates {
    /// Whether the split is meant to have depth: a single depth image says so.
    pub fn have_depth(&self) -> bool {
        self.frames.iter().any(|c| c.depth.is_ok())
    }

    /// The first readable colour header: it sets the size of the split's camera.
    pub fn color_header(&self) -> Option<Header> {
        self.frames.iter().find_map(|c| decode::header(&c.color).ok())
    }

    /// The first readable depth header.
    pub fn depth_header(&self) -> Option<Header> {
        self.frames.iter().find_map(|c| decode::header(c.depth.as_ref().ok()?).ok())
    }

    /// Makes the split; in one with depth, frames without are skipped.
    pub fn into_split(
        self,
        intrinsics: Intrinsics,
        encoding: DepthEncoding,
        parsed: &mut Parsed,
    ) -> Split {
        let has_depth = self.have_depth();
        let mut frames = Vec::with_capacity(self.frames.len());
        for Candidate { name, pose, color, depth } in self.frames {
            let depth = match depth {
                Ok(path) => Some((path, encoding)),
                Err(problem) if has_depth => {
                    parsed.skip(&self.split, &name, color, problem);
                    continue;
                }
                Err(_) => None,
            };
            let source = FrameSource::Files { color, depth };
            frames.push(FrameEntry { name, camera: Camera { intrinsics, pose }, source });
        }
        Split { name: self.split, frames, has_depth }
    }

    /// Without a readable header there is no camera: each frame gets its own message.
    pub fn skip_unreadable(self, parsed: &mut Parsed) {
        for Candidate { name, color, .. } in self.frames {
            if let Err(problem) = decode::header(&color) {
                parsed.skip(&self.split, &name, color, problem);
            }
        }
    }
}
