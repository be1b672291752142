//! Frames listed for a split: files found and pose valid, camera and depth encoding still undetermined.
//!
//! A layout has one camera and one depth encoding for a whole split, which depend on the size and pixel
//! format of its images. So frames are listed first, then the headers of some images decide by majority,
//! then the split is created.

use super::format::ParsedFolder;
use super::majority::majority;
use crate::dataset::decode;
use crate::dataset::decode::{DepthEncoding, ImageHeader};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DatasetSplit, DepthSource, FrameEntry, FrameFiles, FrameSource};
use crate::dataset::error::FrameProblem;
use crate::dataset::source::ByteSource;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use std::path::{Path, PathBuf};

/// Description of an error that did not occur again.
const REFUSED: &str = "a temporary read error";

fn header(path: &Path) -> Result<ImageHeader, FrameProblem> {
    decode::header(&ByteSource::File(path.to_owned()))
}

/// Size (columns, rows) of most photographs, which is the camera's size; `None` if none can be read.
pub(super) fn photograph_size(photographs: &[&Path]) -> Option<(u32, u32)> {
    majority(photographs, |path| header(path).map(|header| (header.width, header.height))).ok()?
}

/// A frame with an existing colour image and a valid pose.
pub(super) struct ListedFrame {
    pub name: String,
    pub pose: Pose,
    pub color: PathBuf,
    // An error is reported only after all frames are listed: without any depth in the split it is none.
    pub depth: Result<PathBuf, FrameProblem>,
}

pub(super) struct ListedSplit {
    pub name: String,
    pub frames: Vec<ListedFrame>,
}

impl ListedSplit {
    /// True if at least one frame has a depth image.
    pub fn has_depth(&self) -> bool {
        self.frames.iter().any(|c| c.depth.is_ok())
    }

    pub fn colors(&self) -> impl Iterator<Item = &Path> {
        self.frames.iter().map(|frame| frame.color.as_path())
    }

    /// Bits per channel of most depth images, 8 without depth; `None` if none can be read.
    pub fn depth_bits(&self) -> Option<u16> {
        let depths: Vec<&PathBuf> =
            self.frames.iter().filter_map(|frame| frame.depth.as_ref().ok()).collect();
        let bits = majority(&depths, |path| header(path).map(|header| header.bits_per_channel));
        bits.map(|bits| bits.unwrap_or(8)).ok()
    }

    /// Makes the split. If the split has depth, frames without depth are skipped.
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

    /// Skips all frames because no header can be read and camera or encoding is unknown; each gets a
    /// warning.
    pub fn skip_unreadable(self, parsed: &mut ParsedFolder) {
        for ListedFrame { name, color, depth, .. } in self.frames {
            let (file, problem) = match (header(&color), depth) {
                (Err(problem), _) | (_, Err(problem)) => (color, problem),
                (Ok(_), Ok(depth)) => match header(&depth) {
                    Err(problem) => (depth, problem),
                    // The error did not occur again, but must not be hidden.
                    Ok(_) => (color, FrameProblem::Read(std::io::Error::other(REFUSED))),
                },
            };
            parsed.skip(&self.name, &name, file, problem);
        }
    }
}
