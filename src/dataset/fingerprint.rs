//! What a dataset is recognised by, without decoding an image.

use super::{Dataset, FrameEntry, Layout};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Marks of one split of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fingerprint {
    /// Layout of the files.
    layout: String,
    /// The split.
    split: String,
    /// Its frames.
    frames: usize,
    /// Columns and rows of the first frame.
    size: [u32; 2],
    /// CRC-32 over names, cameras and poses, in order.
    poses: u32,
    /// The first frame and the sizes of its files.
    first: FrameMark,
    /// The last one.
    last: FrameMark,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct FrameMark {
    name: String,
    color_bytes: Option<u64>,
    depth_bytes: Option<u64>,
}

impl Fingerprint {
    /// Layout of the files; `None` of files by a newer program.
    pub fn layout(&self) -> Option<Layout> {
        Layout::named(&self.layout)
    }

    /// Of a split, which has at least one frame.
    pub fn of(dataset: &Dataset, split: usize) -> Self {
        Self::of_first(dataset, split, usize::MAX)
    }

    /// Of a split as it was when it had `n` frames, if frames were only ever appended.
    pub fn of_first(dataset: &Dataset, split: usize, n: usize) -> Self {
        let split = &dataset.splits[split];
        let frames = &split.frames[..n.clamp(1, split.frames.len())];
        let (first, last) = (&frames[0], &frames[frames.len() - 1]);
        let mut poses = crc32fast::Hasher::new();
        for frame in frames {
            let k = &frame.camera.intrinsics;
            poses.update(frame.name.as_bytes());
            for number in [k.fx, k.fy, k.cx, k.cy] {
                poses.update(&number.to_le_bytes());
            }
            for number in frame.camera.pose.centre().to_array() {
                poses.update(&number.to_le_bytes());
            }
            for number in frame.camera.pose.rotation().to_cols_array() {
                poses.update(&number.to_le_bytes());
            }
        }
        Self {
            layout: dataset.layout.name().to_owned(),
            split: split.name.clone(),
            frames: frames.len(),
            size: [first.camera.intrinsics.width, first.camera.intrinsics.height],
            poses: poses.finalize(),
            first: FrameMark::of(first),
            last: FrameMark::of(last),
        }
    }

    /// Frames of the split.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// What differs first from the dataset `found`, in words.
    pub fn difference(&self, found: &Self) -> Option<String> {
        let differ = |what: &str, expected: &dyn std::fmt::Debug, found: &dyn std::fmt::Debug| {
            Some(format!("{what} (expected {expected:?}, found {found:?})"))
        };
        if self.layout != found.layout {
            differ("layout", &self.layout, &found.layout)
        } else if self.split != found.split {
            differ("split", &self.split, &found.split)
        } else if self.frames != found.frames {
            differ("number of frames", &self.frames, &found.frames)
        } else if self.size != found.size {
            differ("size of the frames", &self.size, &found.size)
        } else if self.first != found.first {
            differ("first frame", &self.first, &found.first)
        } else if self.last != found.last {
            differ("last frame", &self.last, &found.last)
        } else if self.poses != found.poses {
            Some("cameras or poses".to_owned())
        } else {
            None
        }
    }
}

impl FrameMark {
    fn of(frame: &FrameEntry) -> Self {
        let bytes = |path: Option<&Path>| Some(path?.metadata().ok()?.len());
        Self {
            name: frame.name.clone(),
            color_bytes: bytes(frame.color_path()),
            depth_bytes: bytes(frame.depth_path()),
        }
    }
}
