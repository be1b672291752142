//! Fingerprint that identifies a dataset without decoding images.
//!
//! It covers names, cameras and depth encoding of every frame, the size of every file, and samples of some
//! files' bytes. Reading all bytes would take minutes where opening takes a second, and edited images
//! rarely retain their sizes. Fingerprints of version 0.1.0 lack depth encoding, sizes and samples, which are
//! then not compared.

use super::decode::{CodeKind, DepthEncoding};
use super::depth::DepthKind;
use super::entry::{FrameFiles, FrameSource};
use super::folder::open_file;
use super::{Dataset, FrameEntry, Layout};
use crate::math::camera::{Camera, Intrinsics};
use serde::{Deserialize, Serialize};
use std::io::{Read, Result as IoResult, Seek, SeekFrom};
use std::path::Path;

/// Number of evenly spaced frames whose files are sampled.
const SAMPLED_FRAMES: usize = 32;
/// Number of evenly spaced samples of a file, from its start to its end.
const SAMPLED_PLACES: u64 = 3;
/// Number of bytes per sample.
const SAMPLED_BYTES: u64 = 1 << 14;

/// Fingerprint of one split of a dataset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Fingerprint {
    layout: String,
    split: String,
    frames: usize,
    size: [u32; 2],
    /// CRC-32 over names, intrinsics and poses of all frames, in order.
    poses: u32,
    first: FrameMark,
    last: FrameMark,
    /// CRC-32 over everything that affects decoding: image sizes, lens, colour camera, unit and trusted
    /// interval of depth, lowest used confidence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    reading: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sizes: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    content: Option<u32>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct FrameMark {
    name: String,
    color_bytes: Option<u64>,
    depth_bytes: Option<u64>,
}

impl Fingerprint {
    /// Returns the layout of the dataset's files; `None` for a layout that only a newer program version
    /// supports.
    pub fn layout(&self) -> Option<Layout> {
        Layout::named(&self.layout)
    }

    /// Computes the fingerprint of a split, which must have at least one frame.
    pub fn of(dataset: &Dataset, split: usize) -> Self {
        Self::of_first_frames(dataset, split, usize::MAX)
    }

    /// Computes the fingerprint of the first `n` frames of a split. It equals the fingerprint of the
    /// split before later frames were appended.
    #[expect(clippy::indexing_slicing, reason = "a split of the dataset, with at least one frame")]
    pub fn of_first_frames(dataset: &Dataset, split: usize, n: usize) -> Self {
        let split = &dataset.splits[split];
        let frames = &split.frames[..n.clamp(1, split.frames.len())];
        let (first, last) = (&frames[0], &frames[frames.len() - 1]);
        Self {
            layout: dataset.layout.name().to_owned(),
            split: split.name.clone(),
            frames: frames.len(),
            size: [first.camera.intrinsics.width, first.camera.intrinsics.height],
            poses: crc(frames, |crc, frame| {
                let Camera { intrinsics: k, pose } = &frame.camera;
                crc.0.update(frame.name.as_bytes());
                crc.reals([k.fx, k.fy, k.cx, k.cy]);
                crc.reals(pose.centre().to_array());
                crc.reals(pose.rotation().to_cols_array());
            }),
            first: FrameMark::of(first),
            last: FrameMark::of(last),
            reading: Some(crc(frames, add_decoding)),
            sizes: Some(crc(frames, |crc, frame| {
                // An unknown size differs from every real one.
                frame.files().for_each(|file| crc.number(file_size(file).unwrap_or(u64::MAX)));
            })),
            content: Some(content(frames)),
        }
    }

    /// Returns the number of frames in the split.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Describes the first difference from `found`, the fingerprint of another dataset; `None` if there
    /// is no difference.
    pub fn difference(&self, found: &Self) -> Option<String> {
        let differ = |what: &str, expected: &dyn std::fmt::Debug, found: &dyn std::fmt::Debug| {
            Some(format!("{what} (expected {expected:?}, found {found:?})"))
        };
        // What users recognise comes first; checksums can only state that something differs.
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
        } else if differs(self.reading, found.reading) {
            Some("size, lens or depth encoding in the files, such as the unit of depth".to_owned())
        } else if differs(self.sizes, found.sizes) {
            Some("sizes of image files".to_owned())
        } else if differs(self.content, found.content) {
            Some("content of image files".to_owned())
        } else {
            None
        }
    }
}

fn differs(a: Option<u32>, b: Option<u32>) -> bool {
    // Older fingerprints lack some sums, which does not count as a difference.
    a.zip(b).is_some_and(|(a, b)| a != b)
}

struct Crc(crc32fast::Hasher);

impl Crc {
    fn number(&mut self, number: u64) {
        self.0.update(&number.to_le_bytes());
    }

    fn reals(&mut self, numbers: impl IntoIterator<Item = f64>) {
        numbers.into_iter().for_each(|number| self.number(number.to_bits()));
    }

    fn intrinsics(&mut self, k: &Intrinsics) {
        self.number(u64::from(k.width) << 32 | u64::from(k.height));
        self.reals([k.fx, k.fy, k.cx, k.cy]);
    }
}

fn crc<'a>(
    frames: impl IntoIterator<Item = &'a FrameEntry>,
    mut add: impl FnMut(&mut Crc, &FrameEntry),
) -> u32 {
    let mut crc = Crc(crc32fast::Hasher::new());
    frames.into_iter().for_each(|frame| add(&mut crc, frame));
    crc.0.finalize()
}

fn add_decoding(crc: &mut Crc, frame: &FrameEntry) {
    crc.intrinsics(&frame.camera.intrinsics);
    if let Some(color) = &frame.color_camera {
        crc.intrinsics(&color.camera_at(&frame.camera).intrinsics);
    }
    let FrameSource::Files(files) = &frame.source else { return };
    let FrameFiles { lens, photo_lens, depth, mask, color: _, decoding: _ } = &**files;
    // Nothing without another lens or a mask: fingerprints stay as they were.
    for lens in std::iter::once(lens).chain(photo_lens) {
        crc.reals(lens.radial.into_iter().chain(lens.tangential));
    }
    mask.iter().for_each(|mask| crc.number(u64::from(mask.hides_black)));
    let Some(depth) = depth else { return };
    // The sensor setting is stored with the run.
    let DepthEncoding { codes, kind, trusted, sensor: _, units_per_metre: _ } = depth.encoding;
    let (code, unit) = match codes {
        CodeKind::Inverse8 => (0, 1.0),
        CodeKind::Linear16(unit) => (1, unit),
        CodeKind::ByContent(unit) => (2, unit),
        CodeKind::BareFloats => (3, 1.0),
    };
    crc.number(code);
    crc.number(u64::from(kind == DepthKind::Z));
    crc.reals([unit, trusted[0], trusted[1]]);
    // A number that no least confidence has.
    crc.number(depth.confidence.as_ref().map_or(u64::MAX, |(_, least)| u64::from(*least)));
}

fn file_size(path: &Path) -> Option<u64> {
    Some(path.metadata().ok()?.len())
}

fn content(frames: &[FrameEntry]) -> u32 {
    let n = frames.len().min(SAMPLED_FRAMES);
    let sampled = (0..n).filter_map(|i| frames.get(i * frames.len() / n));
    crc(sampled, |crc, frame| {
        frame.files().for_each(|file| {
            // An unreadable file has no content; its size is recorded as unknown.
            let _ = add_samples(file, &mut crc.0);
        });
    })
}

fn add_samples(path: &Path, crc: &mut crc32fast::Hasher) -> IoResult<()> {
    let mut file = open_file(path)?;
    let spare = file.metadata()?.len().saturating_sub(SAMPLED_BYTES);
    let mut bytes = Vec::new();
    for place in 0..SAMPLED_PLACES {
        // The last sample ends with the file.
        file.seek(SeekFrom::Start(spare * place / (SAMPLED_PLACES - 1)))?;
        bytes.clear();
        file.by_ref().take(SAMPLED_BYTES).read_to_end(&mut bytes)?;
        crc.update(&bytes);
    }
    Ok(())
}

impl FrameMark {
    fn of(frame: &FrameEntry) -> Self {
        Self {
            name: frame.name.clone(),
            color_bytes: frame.color_path().and_then(file_size),
            depth_bytes: frame.depth_path().and_then(file_size),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::LoadOptions;
    use crate::dataset::synthetic::SyntheticParams;
    use crate::dataset::synthetic::write::{SyntheticLayout, write};

    fn of(folder: &Path, options: &LoadOptions) -> Fingerprint {
        let dataset = crate::dataset::open(folder, options).unwrap();
        Fingerprint::of(&dataset, dataset.training_split().unwrap())
    }

    /// Checks that the fingerprint changes with the unit of depth, one byte of an image, and the size of
    /// a file.
    #[test]
    fn what_changes_the_numbers_changes_the_fingerprint() {
        let folder = tempfile::tempdir().unwrap();
        let small = SyntheticParams {
            width: 32,
            height: 24,
            n_train: 10,
            n_eval: 1,
            ..SyntheticParams::demo()
        };
        write(&small, folder.path(), SyntheticLayout::Tum, &mut |_, _| ()).unwrap();
        let plain = LoadOptions::default();
        let before = of(folder.path(), &plain);
        let difference = |options: &LoadOptions| before.difference(&of(folder.path(), options));
        assert_eq!(difference(&plain), None);
        let scaled = LoadOptions { depth_scale: Some(0.002), ..plain };
        assert!(difference(&scaled).unwrap().contains("depth"));

        let file = folder.path().join("depth/1000.200000.png");
        let bytes = std::fs::read(&file).unwrap();
        let mut edited = bytes.clone();
        edited[bytes.len() / 2] ^= 1;
        std::fs::write(&file, &edited).unwrap();
        assert_eq!(difference(&plain).unwrap(), "content of image files");
        edited.push(0);
        std::fs::write(&file, &edited).unwrap();
        assert_eq!(difference(&plain).unwrap(), "sizes of image files");
        std::fs::write(&file, bytes).unwrap();
        assert_eq!(difference(&plain), None);

        // Fingerprint of an older version.
        let older = Fingerprint { reading: None, sizes: None, content: None, ..before.clone() };
        assert_eq!(older.difference(&of(folder.path(), &scaled)), None);
        let text = serde_json::to_string(&older).unwrap();
        assert!(
            !text.contains("content")
                && serde_json::from_str::<Fingerprint>(&text).unwrap() == older
        );
    }
}
