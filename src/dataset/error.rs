//! What can be wrong with a dataset, and with one frame of it. Every message names the file, what
//! was expected, what was found and what to do.
//!
//! A defect of a frame is told apart from its place: [`FrameProblem`] is the defect, found by
//! whoever decodes and who need not know the frame's name; [`FrameError`] adds file and frame
//! where both are known. One bad frame never spoils the dataset, so only [`DatasetError`] ends an
//! opening.

use crate::math::pose::PoseError;
use std::path::PathBuf;
use std::sync::Arc;

/// Unpacks a recording's video, run inside its folder.
pub const VIDEO_BY_HAND: &str = "mkdir rgb && ffmpeg -noautorotate -i rgb.mp4 -fps_mode passthrough -q:v 2 -start_number 0 \
     rgb/%06d.jpg (-vsync in place of -fps_mode before ffmpeg 5.1)";

/// Why a dataset cannot be used at all.
#[derive(Debug, thiserror::Error)]
pub enum DatasetError {
    /// Nothing at that path.
    #[error(
        "{}: expected a dataset folder, found nothing at this path; check the spelling", path.display()
    )]
    NotFound {
        /// The path as it was given.
        path: PathBuf,
    },
    /// A file where a folder was needed.
    #[error(
        "{}: expected a dataset folder, found a file; give the folder that holds it", path.display()
    )]
    NotAFolder {
        /// The path as it was given.
        path: PathBuf,
    },
    /// A file or folder that exists but cannot be read.
    #[error("{}: expected a readable file or folder, found: {source}; check its permissions", path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// No format knows the folder.
    #[error(
        "{}: expected a dataset in one of the known layouts ({expected}), found {found}; give the folder that directly holds these files", path.display()
    )]
    NotRecognised {
        /// The folder that was to be opened.
        path: PathBuf,
        /// The layouts and what each is recognised by.
        expected: String,
        /// A summary of what the folder holds.
        found: String,
    },
    /// More than one format knows the folder.
    #[error(
        "{}: expected one recording, found two layouts at once ({found}); give each a folder of its own", path.display()
    )]
    TwoLayouts {
        /// The folder that was to be opened.
        path: PathBuf,
        /// The layouts and what each was recognised by.
        found: String,
    },
    /// Text that is no JSON.
    #[error(
        "{}: expected JSON, found: {source}; export the file again (JSON knows neither NaN nor infinity)", file.display()
    )]
    Json {
        /// The metadata file inside the dataset.
        file: PathBuf,
        /// Where parsing stopped and why.
        source: serde_json::Error,
    },
    /// A metadata file whose content does not have the right form.
    #[error("{}: expected {expected}, found {found}; {hint}", file.display())]
    Metadata {
        /// The metadata file inside the dataset.
        file: PathBuf,
        /// What belongs there.
        expected: String,
        /// What is there.
        found: String,
        /// What to do.
        hint: String,
    },
    /// Every frame was refused.
    #[error(
        "{}: expected at least one usable frame, found none in {skipped} listed; the first problem: {first}", path.display()
    )]
    NoUsableFrame {
        /// Folder of the dataset, or its name where it has no files.
        path: PathBuf,
        /// Frames that were refused.
        skipped: usize,
        /// The first refusal.
        first: Box<FrameError>,
    },
    /// Frames of a recording that is under way.
    #[error("{}: expected a whole frame, found {frames} that are still written", path.display())]
    Unfinished {
        /// Folder of the recording.
        path: PathBuf,
        /// How many are listed with pose and depth.
        frames: usize,
    },
    /// Training needs depth.
    #[error(
        "{}: expected a split with depth images to train on, found only colour (splits: {splits}); add the depth images to one split", path.display()
    )]
    NoDepth {
        /// Folder of the dataset, or its name where it has no files.
        path: PathBuf,
        /// Names of the splits.
        splits: String,
    },
    /// The split that should train cannot.
    #[error(
        "{}: expected usable frames with depth in the split `{split}` to train on, found {found}; mend them, or name another split", path.display()
    )]
    TrainingSplit {
        /// Folder of the dataset, or its name where it has no files.
        path: PathBuf,
        /// The split.
        split: String,
        /// What there is.
        found: String,
    },
    /// A split that the user named does not exist.
    #[error("{}: expected one of the splits {splits}, found the request `{asked}`; name one of them", path.display())]
    NoSuchSplit {
        /// Folder of the dataset, or its name where it has no files.
        path: PathBuf,
        /// What was asked for.
        asked: String,
        /// What there is.
        splits: String,
    },
    /// A sector of the camera's way leaves too few views.
    #[error(
        "{}: --hold-out sector: expected 2 frames to train on, a new view and a view from the side at least, found {training}, {new_views} and {from_the_side} (taken for {kind}, {frames} frames); {hint}, or leave the option out", path.display()
    )]
    Sector {
        /// Folder of the dataset, or its name where it has no files.
        path: PathBuf,
        /// What the poses say it is.
        kind: &'static str,
        /// Frames of the training split.
        frames: usize,
        /// Frames that would train.
        training: usize,
        /// Views on the way.
        new_views: usize,
        /// Views off the way.
        from_the_side: usize,
        /// What to do.
        hint: &'static str,
    },
    /// The depth scale or range that the user gave makes no sense.
    #[error("setting {setting}: expected {expected}, found {found}; correct it or leave it out")]
    Option {
        /// Name of the option that was overridden.
        setting: &'static str,
        /// Legal values of the option, with their unit.
        expected: &'static str,
        /// The value that was given.
        found: String,
    },
}

/// Why one frame cannot be used. At opening it becomes a [`Warning`], at loading an error.
#[derive(Debug, thiserror::Error)]
#[error(
    "{}: frame {}: {}", abridged(&file.display().to_string()), abridged(frame), abridged(&problem.to_string())
)]
pub struct FrameError {
    /// The file at fault.
    pub file: PathBuf,
    /// Name of the frame.
    pub frame: String,
    /// What is wrong.
    #[source]
    pub problem: FrameProblem,
}

/// A frame that was skipped at opening.
#[derive(Clone, Debug)]
pub struct Warning {
    /// Split that lists the frame.
    pub split: String,
    /// The frame, the file and what is wrong with it.
    pub error: Arc<FrameError>,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (split {})", self.error, self.split)
    }
}

/// The defects a frame can have.
#[derive(Debug, thiserror::Error)]
pub enum FrameProblem {
    /// No colour image.
    #[error("expected a colour image {0}, found none; restore it or remove the frame")]
    MissingColor(String),
    /// No depth image although the split has them.
    #[error(
        "expected a depth image {0}, found none; the frame is skipped: restore its depth or remove the frame"
    )]
    MissingDepth(String),
    /// No map of confidence yet, although the recording has them.
    #[error("expected a map of confidence {0}, found none yet; record it with the frame's depth")]
    MissingConfidence(String),
    /// A frame without a pose file.
    #[error("expected a pose file {0}, found none; restore it or remove the frame")]
    MissingPose(String),
    /// A sequence that a split file lists.
    #[error(
        "expected a folder {0} with frames, found none; unpack the sequence beside the split file"
    )]
    MissingSequence(String),
    /// The file cannot be read.
    #[error("expected a readable file, found: {0}; check the file and its permissions")]
    Read(#[from] std::io::Error),
    /// Not an image, or a damaged one.
    #[error("expected a whole PNG or JPEG image, found: {0}; copy or export the file again")]
    Decode(#[from] image::ImageError),
    /// A depth file of floats, or an image, that is damaged or of an unknown kind.
    #[error("expected {expected}, found {found}; copy or export the file again")]
    DepthFile {
        /// What belongs there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// An archive whose directory or member is damaged.
    #[error("expected a whole zip archive, found: {0}; copy or export the recording again")]
    Archive(String),
    /// A member of an archive that is larger than it says, or absurdly packed.
    #[error(
        "expected a member of the size that the archive states and at most 256 MiB, found {packed} bytes that unpack to {unpacked} or more; do not trust this archive"
    )]
    ZipBomb {
        /// Bytes inside the archive.
        packed: u64,
        /// Bytes that it says it has, or that it turned out to have.
        unpacked: u64,
    },
    /// A video that cannot be unpacked.
    #[error(
        "expected a video that ffmpeg unpacks, found: {0}; unpack it by hand: {hand}", hand = VIDEO_BY_HAND
    )]
    Video(String),
    /// Two files or lines for one frame.
    #[error("expected one of each frame, found {0} too; the first is used: remove the other")]
    Doubled(String),
    /// No pose near the time of a frame.
    #[error(
        "expected a pose within {tolerance_ms} ms of {time:.6} s, found {found}; the frame is skipped: record poses for it or remove it"
    )]
    NoPoseInTime {
        /// Of the frame's depth, seconds.
        time: f64,
        /// Largest difference, milliseconds.
        tolerance_ms: f64,
        /// The nearest pose, in words.
        found: String,
    },
    /// No photograph near the time of a depth image.
    #[error(
        "expected a colour image within {tolerance_ms} ms of {time:.6} s, found {found}; the frame is skipped"
    )]
    NoColorInTime {
        /// Of the depth image, seconds.
        time: f64,
        /// Largest difference, milliseconds.
        tolerance_ms: f64,
        /// The nearest image, in words.
        found: String,
    },
    /// A line of a trajectory that is none.
    #[error("expected {expected}, found {found} in line {line}; correct the line or remove it")]
    Line {
        /// What belongs there.
        expected: &'static str,
        /// What is there.
        found: String,
        /// Number of the line, from 1.
        line: usize,
    },
    /// A JPEG that stops early; decoders fill the rest with grey and say nothing.
    #[error(
        "expected a whole JPEG image, found no end-of-image marker: the file is truncated; copy or export it again"
    )]
    TruncatedJpeg,
    /// A file on which the decoder panics.
    #[error(
        "expected a whole PNG or JPEG image, found one that crashes its decoder; copy or export the file again"
    )]
    DecoderCrash,
    /// A depth image of another pixel format.
    #[error("expected {expected} depth, found {found}; {hint}")]
    DepthFormat {
        /// What the rest of the split has.
        expected: &'static str,
        /// What this file has.
        found: String,
        /// What to do.
        hint: &'static str,
    },
    /// Depth is not of the size that the frame's camera has.
    #[error(
        "expected depth of the camera's size {}x{}, found {}x{}; export both at one size", camera.0, camera.1, depth.0, depth.1
    )]
    SizeMismatch {
        /// Width and height that the split's other images, or its metadata, give the camera.
        camera: (u32, u32),
        /// Width and height of the depth image.
        depth: (u32, u32),
    },
    /// An image does not fit the camera.
    #[error(
        "expected an image of the camera's size {}x{}, found {}x{}; export all frames of a split at one size", expected.0, expected.1, found.0, found.1
    )]
    CameraSize {
        /// Of the camera.
        expected: (u32, u32),
        /// Of the file.
        found: (u32, u32),
    },
    /// Numbers that are no camera pose.
    #[error("pose: {0}; export the pose again or remove the frame")]
    Pose(#[from] PoseError),
    /// Not even 16 numbers.
    #[error(
        "pose: expected 4 rows of 4 finite numbers, found {0}; export the pose again or remove the frame"
    )]
    PoseShape(String),
    /// A frame entry without its fields.
    #[error("expected {expected}, found {found}; export the frame list again or remove the frame")]
    Entry {
        /// What belongs there.
        expected: &'static str,
        /// What is there.
        found: String,
    },
    /// A path that leads out of the dataset.
    #[error(
        "expected a path inside the dataset folder, found `{0}` which leads outside; copy the file into the folder and use a relative path"
    )]
    Escapes(String),
    /// A depth image without a single surface.
    #[error(
        "expected depth values, found only holes (0) in the whole image; the frame is skipped: export its depth again"
    )]
    NoDepthValues,
    /// Intrinsics of a frame in memory that no camera has.
    #[error("camera: expected {expected}, found {found}; {hint}")]
    Intrinsics {
        /// What a camera has.
        expected: String,
        /// What was given.
        found: String,
        /// What to do.
        hint: &'static str,
    },
    /// A buffer in memory that does not hold the pixels of the camera's image.
    #[error(
        "expected {expected} {what} for the camera's {}x{} pixels, found {found}; hand over whole images without padding between rows", size.0, size.1
    )]
    BufferSize {
        /// What the buffer holds.
        what: &'static str,
        /// Width and height of the camera's image, pixels.
        size: (u32, u32),
        /// Values that belong into it.
        expected: usize,
        /// Values that it holds.
        found: usize,
    },
    /// A trusted interval of depth that holds no length.
    #[error(
        "trusted depth: expected 0 ≤ near < far in world units, found {near} to {far}; correct it"
    )]
    TrustedDepth {
        /// Lower end of the interval, world units.
        near: f64,
        /// Upper end of the interval, world units.
        far: f64,
    },
    /// Points were asked of a frame without depth.
    #[error("expected a frame with depth, found colour only; choose a split with depth")]
    NoDepth,
    /// A frame that is not there.
    #[error("expected a frame number below {available}, found {asked}; choose another frame")]
    NoSuchFrame {
        /// Frames in the split.
        available: usize,
        /// What was asked for.
        asked: usize,
    },
}

/// Text that a dataset's files put into a message, which they may not fill: on one line, and of a long one
/// its beginning and end.
fn abridged(text: &str) -> String {
    const MOST: usize = 400;
    let plain: Vec<char> = text.chars().flat_map(on_one_line).collect();
    if plain.len() <= MOST {
        return plain.into_iter().collect();
    }
    let (start, end) = (plain.iter().take(2 * MOST / 3), plain.iter().skip(plain.len() - MOST / 3));
    start.chain(&['…']).chain(end).collect()
}

fn on_one_line(c: char) -> impl Iterator<Item = char> {
    let escaped = c.is_control().then(|| c.escape_default());
    let kept = escaped.is_none().then_some(c);
    escaped.into_iter().flatten().chain(kept)
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
