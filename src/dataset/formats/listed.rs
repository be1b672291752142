//! Frames on their way into a split: files found, pose sound, camera and depth format still open.
//!
//! A layout names one camera and one depth encoding for a whole split, and both depend on the size
//! and the pixel format of its images. So frames are first listed, then the headers of some images
//! decide by majority, then the split is made.

use super::format::ParsedFolder;
use super::majority::of_most;
use crate::dataset::decode;
use crate::dataset::decode::{DepthEncoding, ImageHeader};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DatasetSplit, DepthSource, FrameEntry, FrameFiles, FrameSource};
use crate::dataset::error::FrameProblem;
use crate::dataset::source::ByteSource;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use std::path::{Path, PathBuf};

/// What is said of a file that can be read now.
const REFUSED: &str = "one that could not be read a moment ago";

fn header(path: &Path) -> Result<ImageHeader, FrameProblem> {
    decode::header(&ByteSource::File(path.to_owned()))
}

/// Columns and rows of most photographs, which set the size of the camera; `None` if none can be read.
pub(super) fn photograph_size(photographs: &[&Path]) -> Option<(u32, u32)> {
    of_most(photographs, |path| header(path).map(|header| (header.width, header.height))).ok()?
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

    /// Files of the photographs.
    pub fn colors(&self) -> impl Iterator<Item = &Path> {
        self.frames.iter().map(|frame| frame.color.as_path())
    }

    /// Bits of the depth of most frames, any where there is no depth; `None` if none can be read.
    pub fn depth_bits(&self) -> Option<u16> {
        let depths: Vec<&PathBuf> =
            self.frames.iter().filter_map(|frame| frame.depth.as_ref().ok()).collect();
        let bits = of_most(&depths, |path| header(path).map(|header| header.bits_per_channel));
        bits.map(|bits| bits.unwrap_or(8)).ok()
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

    /// Without a readable header there is no camera or no encoding: each frame gets its own message.
    pub fn skip_unreadable(self, parsed: &mut ParsedFolder) {
        for ListedFrame { name, color, depth, .. } in self.frames {
            let (file, problem) = match (header(&color), depth) {
                (Err(problem), _) | (_, Err(problem)) => (color, problem),
                (Ok(_), Ok(depth)) => match header(&depth) {
                    Err(problem) => (depth, problem),
                    // What a disk gives only at a later attempt must not vanish without a word.
                    Ok(_) => (color, FrameProblem::Read(std::io::Error::other(REFUSED))),
                },
            };
            parsed.skip(&self.name, &name, file, problem);
        }
    }
}
