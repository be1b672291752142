//! Errors and warnings of a dataset and of one frame. Every message states the file, what was expected,
//! what was found and what to do.
//!
//! [`FrameProblem`] is a defect without its location, so that decoders need no frame name;
//! [`FrameError`] adds file and frame. A bad frame never makes the whole dataset unusable: only
//! [`DatasetError`] aborts opening.

use super::archive::MAX_MEMBERS;
use crate::math::foreign::displayable;
use crate::math::pose::PoseError;
use image::error::ImageFormatHint;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Shell command that extracts a recording's video, run inside its folder.
pub const VIDEO_BY_HAND: &str = "mkdir rgb && ffmpeg -noautorotate -i rgb.mp4 -fps_mode passthrough -q:v 2 -start_number 0 \
     rgb/%06d.jpg (-vsync in place of -fps_mode before ffmpeg 5.1)";

/// Reason why a whole dataset cannot be used.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// The path does not exist.
    #[error(
        "{}: expected a dataset folder, found nothing at this path; check the spelling", path.display()
    )]
    NotFound { path: PathBuf },
    /// The path is a file instead of a folder.
    #[error(
        "{}: expected a dataset folder, found a file; give the folder that holds it", path.display()
    )]
    NotAFolder { path: PathBuf },
    /// A file or folder exists but cannot be read.
    #[error("{}: expected a readable file or folder, found: {source}; check its permissions", path.display())]
    Read { path: PathBuf, source: std::io::Error },
    /// No layout matches the folder.
    #[error(
        "{}: found {found}, expected a known layout ({expected}); give the folder that directly holds its files", path.display()
    )]
    NotRecognised { path: PathBuf, expected: String, found: String },
    /// The folder is part of a recording.
    #[error(
        "{}: found a part of a recording, expected all of it; open the folder above, {}", path.display(), above.display()
    )]
    InsideRecording { path: PathBuf, above: PathBuf },
    /// A recording or model of another program, from which images can be made.
    #[error("{}: found {kind}, expected images that are read; {hint}", path.display())]
    OtherFormat { path: PathBuf, kind: &'static str, hint: &'static str },
    /// An archive that holds a recording's folder cannot be unpacked.
    #[error(
        "{}: unpacking to {}: {problem}; free space there, or unpack it yourself and open its folder", path.display(), to.display()
    )]
    Unpack { path: PathBuf, to: PathBuf, problem: Box<FrameProblem> },
    /// More than one layout matches the folder.
    #[error(
        "{}: expected one recording, found two layouts at once ({found}); give each a folder of its own", path.display()
    )]
    TwoLayouts { path: PathBuf, found: String },
    /// The text of a file is not JSON.
    #[error(
        "{}: expected JSON, found: {source}; export the file again", file.display()
    )]
    Json { file: PathBuf, source: serde_json::Error },
    /// The content of a metadata file has the wrong form.
    #[error("{}: expected {expected}, found {found}; {hint}", file.display())]
    Metadata { file: PathBuf, expected: String, found: String, hint: String },
    /// Every frame was skipped.
    #[error(
        "{}: expected at least one usable frame, found none in {skipped} listed; the first problem: {first}", path.display()
    )]
    NoUsableFrame { path: PathBuf, skipped: usize, first: Box<FrameError> },
    /// Every frame found in an ongoing recording is still being written.
    #[error("{}: expected a complete frame, found {frames} that are still being written", path.display())]
    Unfinished { path: PathBuf, frames: usize },
    /// No split has depth, which training needs.
    #[error(
        "{}: expected a split with depth images to train on, found only colour (splits: {splits}); add the depth images to one split", path.display()
    )]
    NoDepth { path: PathBuf, splits: String },
    /// The split chosen for training cannot be used.
    #[error(
        "{}: expected usable frames with depth in the split `{split}` to train on, found {found}; repair them, or choose another split", path.display()
    )]
    TrainingSplit { path: PathBuf, split: String, found: String },
    /// A split given by the user does not exist.
    #[error("{}: expected one of the splits {splits}, found `{asked}`; name one of them", path.display())]
    NoSuchSplit { path: PathBuf, asked: String, splits: String },
    /// The hold-out sector leaves too few views.
    #[error(
        "{}: --hold-out sector: expected at least 2 training frames, 1 new view and 1 view from the side, found {training}, {new_views} and {from_the_side} (recognised as {kind}, {frames} frames); {hint}, or omit the option", path.display()
    )]
    Sector {
        path: PathBuf,
        kind: &'static str,
        frames: usize,
        training: usize,
        new_views: usize,
        from_the_side: usize,
        hint: &'static str,
    },
    /// A depth scale, depth range or other option given by the user is out of range.
    #[error("setting {setting}: expected {expected}, found {found}; correct it or leave it out")]
    Option { setting: &'static str, expected: &'static str, found: String },
}

/// Recordings of other programs that are not read: extensions, kind and remedy.
const OTHER_RECORDINGS: [(&[&str], &str, &str); 4] = [
    (
        &["mkv"],
        "a Matroska video, as of an Azure Kinect",
        "unpack it with Open3D's azure_kinect_mkv_reader.py and open its output with --poses track",
    ),
    (
        &["bag", "db3"],
        "a bag of ROS or RealSense",
        "convert it with `mcap convert FILE OUT.mcap`, or unpack its images to color/ and depth/ with a list of poses",
    ),
    (
        &["svo", "svo2"],
        "a video of a ZED camera",
        "export left images to color/, 16-bit depth to depth/ and the poses with the SVO export of the ZED SDK",
    ),
    (
        &["sens"],
        "a stream of ScanNet",
        "unpack it with ScanNet's SensReader (reader.py): color/, depth/, pose/ and intrinsic/",
    ),
];
/// Extensions of models and of what lies beside them.
const MODELS: [&str; 8] = ["usdz", "usd", "ply", "glb", "gltf", "obj", "mtl", "stl"];

impl DatasetError {
    /// Returns the error for a file in place of a folder, with advice if it is another program's recording.
    pub(super) fn not_a_folder(path: &Path) -> Self {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let other = Self::of_other_recording(path.parent().unwrap_or(path), &[name]);
        other.unwrap_or_else(|| Self::NotAFolder { path: path.to_owned() })
    }

    /// Returns the error for the files of a folder if one is another program's recording.
    pub(super) fn of_other_recording(folder: &Path, names: &[&str]) -> Option<Self> {
        OTHER_RECORDINGS.into_iter().find_map(|(ends, kind, hint)| {
            let name = names.iter().find(|name| has_extension(name, ends))?;
            Some(Self::OtherFormat { path: folder.join(name), kind, hint })
        })
    }

    /// Returns the error for the files of a folder if all are models.
    pub(super) fn of_models(folder: &Path, names: &[&str]) -> Option<Self> {
        let path = folder.join(names.first()?);
        let hint = "export photographs, depth and poses (raw data) from the scanning app; open the file itself to view splats";
        let is_model = names.iter().all(|name| has_extension(name, &MODELS));
        is_model.then_some(Self::OtherFormat { path, kind: "a finished model", hint })
    }

    /// Returns the defect of one frame that this error about its entry in a list describes.
    pub(super) fn of_frame(&self) -> FrameProblem {
        match self {
            Self::Metadata { expected, found, hint, .. } => FrameProblem::Intrinsics {
                expected: expected.clone(),
                found: found.clone(),
                hint: hint.clone(),
            },
            other => FrameProblem::Entry { expected: "a usable entry", found: other.to_string() },
        }
    }
}

/// Reason why one frame cannot be used: a [`Warning`] at opening, an error at loading.
#[derive(Debug, thiserror::Error)]
#[error(
    "{}: frame {}: {}", abridged(&file.display().to_string()), abridged(frame), abridged(&problem.to_string())
)]
pub struct FrameError {
    /// The faulty file.
    pub file: PathBuf,
    /// Name of the frame.
    pub frame: String,
    /// The defect.
    #[source]
    pub problem: FrameProblem,
}

/// A frame that was skipped at opening.
#[derive(Clone, Debug)]
pub struct Warning {
    /// Split that lists the frame.
    pub split: String,
    /// Frame, file and defect.
    pub error: Arc<FrameError>,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (split {})", self.error, self.split)
    }
}

/// Defect of a frame.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum FrameProblem {
    /// The frame has no colour image.
    #[error("expected a colour image {0}, found none; restore it or remove the frame")]
    MissingColor(String),
    /// The frame has no depth image although its split has depth.
    #[error(
        "expected a depth image {0}, found none; the frame is skipped: restore its depth or remove the frame"
    )]
    MissingDepth(String),
    /// The frame has no confidence map yet, although the recording contains such maps.
    #[error("expected a confidence map {0}, found none yet; record it with the frame's depth")]
    MissingConfidence(String),
    /// The mask that a frame names does not exist.
    #[error("expected a mask {0}, found none; restore it or remove its name from the frame")]
    MissingMask(String),
    /// The frame has no pose.
    #[error(
        "expected a pose file {0}, found none; restore it, remove the frame, or estimate all poses with --poses track"
    )]
    MissingPose(String),
    /// A sequence listed in a split file does not exist.
    #[error(
        "expected a folder {0} with frames, found none; unpack the sequence beside the split file"
    )]
    MissingSequence(String),
    /// The file cannot be read.
    #[error("expected a readable file, found: {0}; check the file and its permissions")]
    Read(#[from] std::io::Error),
    /// The file is not an image, or is damaged.
    #[error("expected a whole PNG or JPEG image, found: {0}; copy or export the file again")]
    Decode(image::ImageError),
    /// An image whose pixels take too much memory.
    #[error(
        "found {}x{} pixels that take {mib} MiB decoded, expected at most {} MiB; export the image smaller, or as JPEG that is not progressive", size.0, size.1, MAX_PICTURE_MIB
    )]
    TooLarge { size: (u32, u32), mib: u64 },
    /// A large JPEG of other colours than grey and RGB.
    #[error("found a large JPEG of CMYK or 16 bits, expected RGB; export it as an RGB JPEG")]
    JpegColors,
    /// An image with too much data besides its pixels.
    #[error(
        "found more than {} MiB besides the pixels, such as a profile of colours, expected less; export the image again without it",
        MAX_EXTRA_MIB
    )]
    ExtraData,
    /// An image of a kind that is not read.
    #[error(
        "found {0:?}, expected PNG or JPEG, or depth as EXR, TIFF, NPY or NPZ; convert it to PNG"
    )]
    ImageKind(image::ImageFormat),
    /// A damaged depth file, or one of an unknown format.
    #[error("expected {expected}, found {found}; copy or export the file again")]
    DepthFile { expected: &'static str, found: String },
    /// An archive whose directory or member is damaged.
    #[error("expected a whole zip archive, found: {0}; copy or export the recording again")]
    Archive(String),
    /// An archive of too many members.
    #[error(
        "found more members in the archive, expected at most {MAX_MEMBERS} members; record shorter pieces"
    )]
    ArchiveMembers,
    /// A member of an archive that is larger than stated, or compressed implausibly well.
    #[error(
        "expected a member of the size that the archive states and at most 256 MiB, found {packed} bytes that unpack to {unpacked} or more; do not trust this archive"
    )]
    ZipBomb { packed: u64, unpacked: u64 },
    /// A video that cannot be decoded.
    #[error(
        "expected a video that ffmpeg can decode, found: {0}; extract its frames by hand: {hand}", hand = VIDEO_BY_HAND
    )]
    Video(String),
    /// Two files or two lines describe the same frame.
    #[error("expected one of each frame, found {0} as well; the first is used: remove the other")]
    Duplicate(String),
    /// No pose or photograph is close to the time of a depth image.
    #[error(
        "expected {what} within {tolerance_ms} ms of {time:.6} s, found {found}; the frame is skipped: record {what} for it or remove it"
    )]
    NotInTime { what: &'static str, time: f64, tolerance_ms: f64, found: String },
    /// A malformed line of a trajectory.
    #[error("expected {expected}, found {found} in line {line}; correct the line or remove it")]
    Line { expected: &'static str, found: String, line: usize },
    /// A truncated JPEG; decoders would silently fill the rest with grey.
    #[error(
        "expected a whole JPEG image, found no end-of-image marker: the file is truncated; copy or export it again"
    )]
    TruncatedJpeg,
    /// A file that makes the decoder panic.
    #[error(
        "expected a whole PNG or JPEG image, found one that crashes its decoder; copy or export the file again"
    )]
    DecoderCrash,
    /// A depth image of another pixel format.
    #[error("expected {expected} depth, found {found}; {hint}")]
    DepthFormat { expected: &'static str, found: String, hint: &'static str },
    /// An image differs in size from the frame's camera. The size of the camera is that of other images
    /// of the split, or is stated in metadata.
    #[error(
        "expected {what} of the camera's size {}x{}, found {}x{}; export all images of a split at one size", expected.0, expected.1, found.0, found.1
    )]
    Size { what: &'static str, expected: (u32, u32), found: (u32, u32) },
    /// A matrix that is not a camera pose.
    #[error("pose: {0}; export the pose again or remove the frame")]
    Pose(#[from] PoseError),
    /// A pose that is not 16 numbers.
    #[error(
        "pose: expected 4 rows of 4 finite numbers, found {0}; export the pose again or remove the frame"
    )]
    PoseShape(String),
    /// A frame entry with missing or malformed fields.
    #[error("expected {expected}, found {found}; export the frame list again or remove the frame")]
    Entry { expected: &'static str, found: String },
    /// A path that leads outside the dataset.
    #[error(
        "expected a path inside the dataset folder, found `{0}` which leads outside; copy the file into the folder and use a relative path"
    )]
    OutsideFolder(String),
    /// A depth image in which every pixel is a hole.
    #[error(
        "expected depth values, found only holes (0) in the whole image; the frame is skipped: export its depth again"
    )]
    NoDepthValues,
    /// Implausible camera of one frame.
    #[error("camera: expected {expected}, found {found}; {hint}")]
    Intrinsics { expected: String, found: String, hint: String },
    /// An in-memory buffer whose size differs from that of the camera's image.
    #[error(
        "expected {expected} {what} for the camera's {}x{} pixels, found {found}; pass whole images without padding between rows", size.0, size.1
    )]
    BufferSize { what: &'static str, size: (u32, u32), expected: usize, found: usize },
    /// The trusted interval of depth is empty.
    #[error(
        "trusted depth: expected 0 ≤ near < far in world units, found {near} to {far}; correct it"
    )]
    TrustedDepth { near: f64, far: f64 },
    /// Points were requested from a frame without depth.
    #[error("expected a frame with depth, found colour only; choose a split with depth")]
    NoDepth,
    /// The frame number is out of range.
    #[error("expected a frame number below {available}, found {asked}; choose another frame")]
    NoSuchFrame { available: usize, asked: usize },
}

impl From<image::ImageError> for FrameProblem {
    fn from(error: image::ImageError) -> Self {
        match &error {
            image::ImageError::Unsupported(kind) => match kind.format_hint() {
                ImageFormatHint::Exact(format) if !format.reading_enabled() => {
                    Self::ImageKind(format)
                }
                _ => Self::Decode(error),
            },
            image::ImageError::Limits(_) => Self::ExtraData,
            _ => Self::Decode(error),
        }
    }
}

/// Size limit for the pixels of a decoded image, MiB: 54 megapixels of a photograph.
pub(super) const MAX_PICTURE_MIB: u64 = 208;
/// Size limit for what an image contains besides pixels, unpacked, MiB.
pub(super) const MAX_EXTRA_MIB: u64 = 32;

impl FrameProblem {
    /// Returns `missing()` in place of a system error about a file that does not exist. Returns any
    /// other problem unchanged.
    pub(super) fn or_missing(self, missing: impl FnOnce() -> Self) -> Self {
        match self {
            Self::Read(e) if e.kind() == std::io::ErrorKind::NotFound => missing(),
            other => other,
        }
    }
}

fn has_extension(name: &str, ends: &[&str]) -> bool {
    let end = name.rsplit_once('.').map(|(_, end)| end);
    end.is_some_and(|end| ends.iter().any(|other| other.eq_ignore_ascii_case(end)))
}

/// Shortens text from files for a message: escapes control characters, and keeps only the start and end
/// of long text.
fn abridged(text: &str) -> String {
    const MOST: usize = 400;
    // Messages have one line.
    let text = displayable(text).replace('\n', "\\n").replace('\t', "\\t");
    let plain: Vec<char> = text.chars().collect();
    if plain.len() <= MOST {
        return text;
    }
    // More of the start: it holds the folder and what was expected.
    let (start, end) = (plain.iter().take(2 * MOST / 3), plain.iter().skip(plain.len() - MOST / 3));
    start.chain(&['…']).chain(end).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_cannot_fill_messages_with_themselves() {
        assert_eq!(abridged("rgb/1.png"), "rgb/1.png");
        assert_eq!(abridged("a\nb"), "a\\nb");
        let long = abridged(&format!("begin{}end", "ä".repeat(5000)));
        assert!(long.starts_with("begin") && long.ends_with("end") && long.contains('…'), "{long}");
        assert_eq!(long.chars().count(), 400);
        let error = FrameError {
            file: "x/".repeat(3000).into(),
            frame: "y".repeat(3000),
            problem: FrameProblem::MissingColor("z".repeat(3000)),
        };
        let text = error.to_string();
        assert!(text.len() < 1300 && text.ends_with("or remove the frame"), "{text}");
    }
}
