//! Stray Scanner, an app for iPhones. `odometry.csv` has timestamp, frame, x, y, z, qx, qy, qz, qw (camera
//! to world, OpenCV axes) and, in newer versions, fx, fy, cx, cy of the frame, which autofocus changes;
//! `camera_matrix.csv` has the intrinsics of all other frames. Both are for the video's size. Frames are
//! `depth/NNNNNN.png` (millimetres), `confidence/NNNNNN.png` (0 to 2), and `rgb.mp4` or images extracted
//! from it to `rgb/`.
//!
//! The video is HEVC and is decoded by an installed `ffmpeg`. Without `ffmpeg`, the recording can be
//! opened with its geometry only.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    LIDAR_RANGE, Recording, depth_size, encoding, frame_entry, metadata_error, own_camera,
    photograph_size,
};
use super::stated;
use super::trajectory::{TimedPose, sort_by_time};
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::FrameEntry;
use crate::dataset::error::{DatasetError, FrameProblem, VIDEO_BY_HAND};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::dataset::video::Video;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use std::collections::BTreeSet;
use std::sync::Arc;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "Stray Scanner: `odometry.csv`, `camera_matrix.csv` and `depth/`",
    poses: PoseConvention::Opencv,
    recognise,
    parse,
};

const POSES: &str = "odometry.csv";
const CAMERA: &str = "camera_matrix.csv";
const DEPTHS: &str = "depth";
const CONFIDENCES: &str = "confidence";
const COLORS: &str = "rgb";
const VIDEO: &str = "rgb.mp4";
const COLUMNS: [&str; 9] = ["timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw"];
const CAMERA_COLUMNS: [&str; 4] = ["fx", "fy", "cx", "cy"];
// Size of the app's videos, for which it writes the camera matrix.
const VIDEO_SIZE: (u32, u32) = (1920, 1440);

fn recognise(folder: &Folder) -> Option<String> {
    let text = folder.peek(POSES);
    let is_ours = text.lines().next().is_some_and(|head| columns(head, COLUMNS).is_some())
        && folder.listing.has_file(CAMERA);
    is_ours.then(|| format!("{POSES} with poses by frame, and {CAMERA}"))
}

fn columns<const N: usize>(head: &str, wanted: [&str; N]) -> Option<[usize; N]> {
    let names: Vec<&str> = head.split(',').map(str::trim).collect();
    let mut found = [0; N];
    for (place, wanted) in found.iter_mut().zip(wanted) {
        *place = names.iter().position(|name| *name == wanted)?;
    }
    Some(found)
}

struct Files {
    colors: Option<NumberedFiles>,
    video: Option<Arc<Video>>,
    depths: NumberedFiles,
    confidences: Option<NumberedFiles>,
}

impl Files {
    fn color(&self, folder: &Folder, frame: u64) -> Option<Result<ByteSource, FrameProblem>> {
        match (&self.colors, &self.video) {
            (Some(colors), _) => colors.file(folder, frame).map(|file| file.map(Into::into)),
            (None, Some(video)) => Some(Ok(ByteSource::VideoFrame {
                video: Arc::clone(video),
                // No video has that many pictures, so only this frame fails.
                index: usize::try_from(frame).unwrap_or(usize::MAX),
            })),
            (None, None) => {
                // A grey picture has the size of the depth image.
                let depth = self.depths.file(folder, frame)?;
                Some(depth.map(ByteSource::Grey))
            }
        }
    }

    fn confidence(&self, folder: &Folder, frame: u64) -> Result<Option<ByteSource>, FrameProblem> {
        let Some(maps) = &self.confidences else { return Ok(None) };
        match maps.file(folder, frame).transpose()? {
            // The map may still be written.
            None if folder.is_growing() => {
                Err(FrameProblem::MissingConfidence(format!("{CONFIDENCES}/{frame:06}.png")))
            }
            map => Ok(map.map(Into::into)),
        }
    }
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let files = files(&mut recording)?;
    let size = depth_size(files.depths.sources(folder));
    let Some(depth_size) = recording.warn_unreadable(size) else { return Ok(recording.finish()) };
    let Some(size) = color_size(&mut recording, &files, depth_size) else {
        return Ok(recording.finish());
    };
    let k = camera(&mut recording, size)?;
    let file = folder.path.join(CAMERA);
    let cameras = recording.cameras_of_lens(&k, size, depth_size, &file)?;
    let unit = CodeKind::ByContent(MILLIMETRE);
    let encoding = encoding(options, unit, Sensor::Lidar, LIDAR_RANGE);
    let poses = folder.path.join(POSES);
    for line in odometry(&mut recording)? {
        let name = format!("{:06}", line.frame);
        if folder.was_taken(&name) {
            continue;
        }
        let read = |frame: u64| {
            let pose = Pose::from_opencv(line.pose.matrix())?;
            let missing = || FrameProblem::MissingColor(format!("{COLORS}/{name}.jpg"));
            let color = files.color(folder, frame).transpose()?.ok_or_else(missing)?;
            let missing = FrameProblem::MissingDepth(format!("{DEPTHS}/{name}.png"));
            let file = files.depths.required(folder, frame, missing)?;
            let confidence = files.confidence(folder, frame)?;
            let depth = Some(recording.depth_with_confidence(file, encoding, confidence));
            let cameras = line.camera.map_or(Ok(cameras), |[fx, fy, cx, cy]| {
                let own = Intrinsics { fx, fy, cx, cy, ..k };
                recording.cameras_of_lens(&own, size, depth_size, &poses).map_err(own_camera)
            })?;
            let recorded = frame_entry(name.clone(), pose, cameras, color, depth);
            Ok(FrameEntry { time: Some(line.pose.time), ..recorded })
        };
        let frame = read(line.frame);
        recording.add(&name, &poses, frame);
    }
    Ok(recording.finish())
}

fn files(recording: &mut Recording) -> Result<Files, DatasetError> {
    let folder = recording.folder;
    let depths = recording.list(DEPTHS, "", &["png", "npy"])?;
    let confidences = recording.list_optional(CONFIDENCES, &["png"])?;
    let colors = recording.list_optional(COLORS, &PHOTOGRAPHS)?;
    let has_video = folder.listing.has_file(VIDEO);
    let path = folder.path.join(VIDEO);
    let mut video = None;
    if colors.is_none() && !recording.options.geometry_only {
        if !has_video {
            let found = "neither it nor a folder rgb/".to_owned();
            let hint = "copy the video from the phone, or open the recording with geometry only";
            return Err(metadata_error(&path, "the recording's video", found, hint));
        }
        // Checked on opening: otherwise every frame would fail.
        if !Video::is_ffmpeg_available() {
            let expected = "an installed `ffmpeg` to decode this video, or images in rgb/";
            let hint = format!(
                "install ffmpeg, or run here: {VIDEO_BY_HAND}; or open the recording with geometry only"
            );
            return Err(metadata_error(&path, expected, "neither".to_owned(), &hint));
        }
        video = Some(Arc::new(Video::new(path)));
    }
    if colors.is_none() && video.is_none() {
        recording.note("geometry only: all photographs are grey");
    }
    Ok(Files { colors, video, depths, confidences })
}

/// Returns the size of the photographs, or that of depth if there are no photographs.
fn color_size(recording: &mut Recording, files: &Files, depth: (u32, u32)) -> Option<(u32, u32)> {
    let folder = recording.folder;
    if files.colors.is_none() && files.video.is_none() {
        return Some(depth);
    }
    let numbers: Vec<u64> = match &files.colors {
        Some(colors) => colors.numbers().collect(),
        // All pictures of a video have one size.
        None => vec![0],
    };
    let sources = numbers.into_iter().filter_map(|n| files.color(folder, n)?.ok());
    recording.warn_unreadable(photograph_size(sources))
}

/// Reads the intrinsics with the image size that they refer to. It is the photographs' size or, if
/// photographs were downscaled, that of the app's video.
fn camera(recording: &mut Recording, size: (u32, u32)) -> Result<Intrinsics, DatasetError> {
    let (file, text) = recording.folder.text(CAMERA)?;
    let k = stated::from_text(&text, size, &file)?;
    // A principal point far from the centre reveals a matrix for another size.
    let is_centred = |(width, height): (u32, u32)| {
        let off = [k.cx / f64::from(width) - 0.5, k.cy / f64::from(height) - 0.5];
        off.iter().all(|off| off.abs() < 0.15)
    };
    if is_centred(size) {
        return Ok(k);
    }
    let is_grey = recording.options.geometry_only;
    let of = |(width, height): (u32, u32)| Intrinsics { width, height, ..k };
    // Aspect ratios are compared without division, hence without rounding.
    if is_centred(VIDEO_SIZE) && (is_grey || size.0 * VIDEO_SIZE.1 == size.1 * VIDEO_SIZE.0) {
        if !is_grey {
            let (width, height) = VIDEO_SIZE;
            recording.note(format!("{CAMERA} is for {width}x{height}: scaled to the images"));
        }
        return Ok(of(VIDEO_SIZE));
    }
    // The video's size is unknown: assume a centred principal point, and the shape of depth.
    let width = 2.0 * k.cx;
    let height = width * f64::from(size.1) / f64::from(size.0);
    Ok(if is_grey { of((width.round() as u32, height.round() as u32)) } else { k })
}

struct OdometryLine {
    frame: u64,
    pose: TimedPose,
    camera: Option<[f64; 4]>,
}

fn odometry(recording: &mut Recording) -> Result<Vec<OdometryLine>, DatasetError> {
    let (file, text) = recording.folder.lines(POSES)?;
    let mut lines = text.lines().enumerate();
    let head = lines.next().map_or("", |(_, head)| head);
    let places = columns(head, COLUMNS).unwrap_or_default();
    let camera_places = columns(head, CAMERA_COLUMNS);
    let is_known = |name: &&str| COLUMNS.contains(name) || CAMERA_COLUMNS.contains(name);
    let other: Vec<_> = head.split(',').map(str::trim).enumerate().collect();
    let mut other: Vec<_> = other.into_iter().filter(|(_, name)| !is_known(name)).collect();
    let mut unused = Vec::new();
    let mut found: Vec<OdometryLine> = Vec::new();
    let mut seen = BTreeSet::new();
    for (i, line) in lines.filter(|(_, line)| !line.trim().is_empty()) {
        let cells: Vec<&str> = line.split(',').map(str::trim).collect();
        let [at_time, at_frame, at_pose @ ..] = places;
        let number = |place: usize| cells.get(place)?.parse::<f64>().ok();
        let pose = || {
            let [x, y, z, qx, qy, qz, qw] = at_pose.map(number);
            TimedPose::new([number(at_time)?, x?, y?, z?, qx?, qy?, qz?, qw?])
        };
        // Newer versions write frame numbers as `000012`, older ones as 12.
        let frame = cells.get(at_frame).and_then(|cell| cell.parse::<u64>().ok());
        let Some((frame, pose)) = frame.zip(pose()) else {
            let expected =
                "a frame number and finite numbers for time, position and unit quaternion";
            recording.skip_line(&file, i + 1, expected, line);
            continue;
        };
        // A frame may lack its camera: an empty cell.
        let camera = camera_places.and_then(|places| {
            let [fx, fy, cx, cy] = places.map(number);
            Some([fx?, fy?, cx?, cy?])
        });
        unused
            .extend(other.extract_if(.., |(at, _)| cells.get(*at).is_some_and(|c| !c.is_empty())));
        match seen.insert(frame) {
            true => found.push(OdometryLine { frame, pose, camera }),
            false => {
                let problem = FrameProblem::Duplicate(format!("another line of frame {frame}"));
                recording.skip(&frame.to_string(), file.clone(), problem);
            }
        }
    }
    if !unused.is_empty() {
        let names: Vec<&str> = unused.into_iter().map(|(_, name)| name).collect();
        recording.unused(&file, format!("the columns {} are not used", names.join(", ")));
    }
    recording.note_unordered(POSES, sort_by_time(&mut found, |line| line.pose.time));
    Ok(found)
}
