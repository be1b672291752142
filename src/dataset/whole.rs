//! Completeness of a frame's files while they may still be written.
//!
//! A photograph is judged by its end and not decoded, since training decodes it later. PNG has a final
//! chunk; a JPEG is searched for its end marker after the first scan, because phones append data. Other
//! depth files have a known length and are small enough to be read.

use super::decode::{self, CodeKind};
use super::entry::{FrameEntry, FrameSource};
use super::error::FrameProblem;
use super::files::open_file;
use super::source::ByteSource;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;
use std::time::{Duration, UNIX_EPOCH};

const PNG: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Length 0, name and checksum of the final chunk.
const PNG_END: [u8; 12] = *b"\0\0\0\0IEND\xaeB`\x82";
const JPEG: [u8; 2] = [0xFF, 0xD8];

impl FrameEntry {
    /// True if all of its files exist and are complete.
    pub(super) fn is_complete(&self) -> bool {
        let FrameSource::Files(files) = &self.source else { return true };
        let Some(depth) = files.depth.as_ref().filter(|_| is_whole(&files.color)) else {
            return is_whole(&files.color);
        };
        // Files without a header may start with any bytes, also those of an image.
        let is_bare = depth.encoding.codes == CodeKind::BareFloats;
        let depth_ends = if is_bare { None } else { has_image_end(depth.file.path()) };
        let map_ends = depth.confidence.as_ref().map(|(map, _)| has_image_end(map.path()));
        match (depth_ends, map_ends) {
            (Some(false), _) | (_, Some(Some(false))) => false,
            (Some(true), None | Some(Some(true))) => true,
            // Values without a header and arrays have a length but no end marker. Other defects do not
            // vanish as the file grows.
            _ => !self.load_depth().is_err_and(|error| may_still_grow(&error.problem)),
        }
    }

    /// Current marks of its files.
    pub fn marks(&self) -> FrameMarks {
        let FrameSource::Files(files) = &self.source else { return FrameMarks(Vec::new()) };
        let depth = files.depth.iter().flat_map(|depth| {
            std::iter::once(&depth.file).chain(depth.confidence.iter().map(|(map, _)| map))
        });
        let sources = std::iter::once(&files.color).chain(depth);
        FrameMarks(sources.filter_map(|source| FileMark::of(source.path())).collect())
    }
}

/// Modification time and size of each existing file of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMarks(Vec<FileMark>);

impl FrameMarks {
    /// Latest modification time of the files since 1970, by the file system's clock; `None` if unknown.
    pub fn last_modified(&self) -> Option<Duration> {
        self.0.iter().filter_map(|mark| mark.changed).max()
    }
}

/// Modification time and size, by which a change of a file or folder is detected.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileMark {
    bytes: u64,
    /// Time since 1970.
    changed: Option<Duration>,
}

impl FileMark {
    /// `None` if the path does not exist.
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = path.metadata().ok()?;
        let changed = metadata.modified().ok().and_then(|at| at.duration_since(UNIX_EPOCH).ok());
        Some(Self { bytes: metadata.len(), changed })
    }
}

fn is_whole(color: &ByteSource) -> bool {
    match color {
        ByteSource::File(path) => has_image_end(path).unwrap_or(false),
        // The stand-in for a missing photograph needs no file.
        ByteSource::Grey(_) => true,
        // Videos and archives are read only once the recording has ended.
        ByteSource::VideoFrame { .. } | ByteSource::Member { .. } => false,
    }
}

/// True if a PNG or JPEG has its end; `None` for files of other formats.
fn has_image_end(path: &Path) -> Option<bool> {
    let Ok(mut file) = open_file(path) else { return Some(false) };
    let mut head = Vec::new();
    if file.by_ref().take(PNG.len() as u64).read_to_end(&mut head).is_err() || head.is_empty() {
        return Some(false);
    }
    if head == PNG {
        let mut end = [0; PNG_END.len()];
        let read = file
            .seek(SeekFrom::End(-(PNG_END.len() as i64)))
            .and_then(|_| file.read_exact(&mut end));
        return Some(read.is_ok() && end == PNG_END);
    }
    if head.starts_with(&JPEG) {
        let ends = file.read_to_end(&mut head).is_ok() && decode::has_jpeg_end(&head);
        return Some(ends);
    }
    // A file shorter than the signature may become either format.
    let is_begun = PNG.starts_with(&head) || JPEG.starts_with(&head);
    (is_begun).then_some(false)
}

/// True if a defect may be caused by a file that is still being written.
fn may_still_grow(problem: &FrameProblem) -> bool {
    matches!(
        problem,
        FrameProblem::Read(_)
            | FrameProblem::Decode(_)
            | FrameProblem::DepthFile { .. }
            | FrameProblem::TruncatedJpeg
            | FrameProblem::DecoderCrash
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    /// Noise, so that every byte value and many chunk lengths occur.
    fn pixels() -> Vec<u8> {
        (0..40 * 30 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()
    }

    #[test]
    fn no_prefix_of_an_image_is_whole() {
        let (mut png, mut jpeg) = (Vec::new(), Vec::new());
        PngEncoder::new(&mut png).write_image(&pixels(), 40, 30, ExtendedColorType::Rgb8).unwrap();
        JpegEncoder::new(&mut jpeg)
            .write_image(&pixels(), 40, 30, ExtendedColorType::Rgb8)
            .unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image");
        for image in [png, jpeg] {
            for length in 0..image.len() {
                std::fs::write(&path, &image[..length]).unwrap();
                assert_eq!(has_image_end(&path), Some(false), "{length} of {} bytes", image.len());
            }
            std::fs::write(&path, &image).unwrap();
            assert_eq!(has_image_end(&path), Some(true));
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(has_image_end(&path), Some(false), "a missing file is no image");
        std::fs::write(&path, [0.5f32.to_le_bytes(); 8].as_flattened()).unwrap();
        assert_eq!(has_image_end(&path), None, "bare floats have no end");
    }

    #[test]
    fn more_may_follow_the_end_of_a_jpeg() {
        let mut jpeg = Vec::new();
        JpegEncoder::new(&mut jpeg)
            .write_image(&pixels(), 40, 30, ExtendedColorType::Rgb8)
            .unwrap();
        jpeg.extend(b"SEFT: what a phone adds");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.jpg");
        std::fs::write(&path, jpeg).unwrap();
        assert_eq!(has_image_end(&path), Some(true));
    }
}
