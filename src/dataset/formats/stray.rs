//! Stray Scanner, an app for iPhones. `odometry.csv` has timestamp, frame, x, y, z, qx, qy, qz, qw (camera
//! to world, OpenCV axes) and, in newer versions, fx, fy, cx, cy of the frame, which autofocus changes;
//! `camera_matrix.csv` has the intrinsics of all other frames. Both are for the video's size. Frames are
//! `depth/NNNNNN.png` (millimetres), `confidence/NNNNNN.png` (0 to 2), and `rgb.mp4` or images extracted
//! from it to `rgb/`.
//!
//! The video is HEVC and is decoded by an installed `ffmpeg`. Without `ffmpeg`, the recording can be
//! opened with its geometry only. Videos may lack frames, so pictures belong to frames by their times:
//! the app shows each picture at its frame number times a constant step.

use super::lidar::ARKIT_VIDEO;
use super::numbered::{Correspondence, NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    LIDAR_RANGE, Recording, depth_size, encoding, frame_entry, metadata_error, no_poses,
    own_camera, photograph_size,
};
use super::stated;
use super::trajectory::{TimedPose, sort_by_time, usual_step};
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::FrameEntry;
use crate::dataset::error::{DatasetError, FrameProblem, VIDEO_BY_HAND};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::dataset::video::{Video, picture_times};
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DMat4;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

const POSES: &str = "odometry.csv";
const CAMERA: &str = "camera_matrix.csv";
const DEPTHS: &str = "depth";
const CONFIDENCES: &str = "confidence";
const COLORS: &str = "rgb";
const VIDEO: &str = "rgb.mp4";
const COLUMNS: [&str; 9] = ["timestamp", "frame", "x", "y", "z", "qx", "qy", "qz", "qw"];
const CAMERA_COLUMNS: [&str; 4] = ["fx", "fy", "cx", "cy"];

fn recognise(folder: &Folder) -> Option<String> {
    let text = folder.peek(POSES);
    let is_ours = text.lines().next().is_some_and(|head| columns(head, COLUMNS).is_some())
        && folder.listing.has_file(CAMERA);
    is_ours.then(|| format!("{POSES} with poses by frame, and {CAMERA}"))
}

pub(super) fn recognise_unposed(folder: &Folder) -> Option<String> {
    let has_colors = folder.listing.has_file(VIDEO) || folder.has_folder(COLORS);
    let is_ours = has_colors && folder.listing.has_file(CAMERA) && folder.has_folder(DEPTHS);
    is_ours.then(|| format!("{CAMERA} and {DEPTHS}/"))
}

fn columns<const N: usize>(head: &str, wanted: [&str; N]) -> Option<[usize; N]> {
    let names: Vec<&str> = head.split(',').map(str::trim).collect();
    let mut found = [0; N];
    for (place, wanted) in found.iter_mut().zip(wanted) {
        *place = names.iter().position(|name| *name == wanted)?;
    }
    Some(found)
}

/// Largest distance of a picture's time from a multiple of the usual step, in steps.
const MOST_OFF_STEP: f64 = 0.1;
/// Largest number of lost frames that a note names.
const MOST_SHOWN: usize = 12;

struct Files {
    colors: Option<NumberedFiles>,
    video: Option<Arc<Video>>,
    depths: NumberedFiles,
    confidences: Option<NumberedFiles>,
    /// Number of the picture of each frame; `None` if pictures have the numbers of frames.
    pictures: Option<BTreeMap<u64, u64>>,
}

impl Files {
    fn color(&self, folder: &Folder, frame: u64) -> Option<Result<ByteSource, FrameProblem>> {
        let picture = match &self.pictures {
            Some(pictures) => pictures.get(&frame).copied(),
            None => Some(frame),
        };
        match (&self.colors, &self.video) {
            (Some(colors), _) => colors.file(folder, picture?).map(|file| file.map(Into::into)),
            (None, Some(video)) => Some(Ok(ByteSource::VideoFrame {
                video: Arc::clone(video),
                // No video has that many pictures, so only this frame fails.
                index: usize::try_from(picture?).unwrap_or(usize::MAX),
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
    let mut files = files(&mut recording)?;
    let lines = match options.track {
        true => untracked(folder, &files.depths)?,
        false => odometry(&mut recording)?,
    };
    files.pictures = pictures(&mut recording, &files, &lines)?;
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
    for line in lines {
        let name = format!("{:06}", line.frame);
        if folder.was_taken(&name) {
            continue;
        }
        let read = |frame: u64| {
            let pose = Pose::from_opencv(line.matrix)?;
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
            Ok(FrameEntry { time: line.time, ..recorded })
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
        let inside = folder.file(Path::new(""), &folder.listing, VIDEO).map_err(|problem| {
            let expected = "the recording's video in its folder";
            metadata_error(&path, expected, problem.to_string(), "copy the video into the folder")
        })?;
        video = Some(Arc::new(Video::new(inside)));
    }
    if colors.is_none() && video.is_none() {
        recording.note("geometry only: all photographs are grey");
    }
    Ok(Files { colors, video, depths, confidences, pictures: None })
}

/// Pairs the frames with the pictures of the video, or of the folder of images. Returns `None` if
/// pictures have the numbers of frames.
fn pictures(
    recording: &mut Recording,
    files: &Files,
    lines: &[OdometryLine],
) -> Result<Option<BTreeMap<u64, u64>>, DatasetError> {
    let folder = recording.folder;
    let frames: Vec<u64> = files.depths.numbers().collect();
    let has_video = folder.listing.has_file(VIDEO);
    let times = has_video.then(|| picture_times(&folder.path.join(VIDEO))).flatten();
    let colors: Option<Vec<u64>> = files.colors.as_ref().map(|colors| colors.numbers().collect());
    if folder.is_growing() || colors.is_none() && files.video.is_none() {
        return Ok(None);
    }
    let is_gapless = |n: &Vec<u64>| n.array_windows().all(|[a, b]| b - a == 1);
    // Images extracted from the video have no gaps where the video lacks frames.
    let extracted = colors
        .as_ref()
        .filter(|n| is_gapless(n) && times.as_ref().is_some_and(|times| times.len() == n.len()));
    let (name, n_pictures, found) = match (&times, &colors) {
        (Some(times), _) if colors.is_none() || extracted.is_some() => {
            let first = extracted.and_then(|numbers| numbers.first()).copied().unwrap_or(0);
            let found = frames_of_pictures(times, &frames, lines);
            let numbered = found.map(|found| (first..).zip(found).map(|(n, f)| (f, n)).collect());
            (VIDEO, times.len(), numbered)
        }
        (_, Some(colors)) => {
            if is_gapless(colors) && colors.len() < frames.len() && is_gapless(&frames) {
                recording.note(format!(
                    "{COLORS}/ has {} images without a gap for {} depth images: if they are of a video with lost frames, copy {VIDEO} beside them, whose times pair them",
                    colors.len(), frames.len()
                ));
            }
            let found = Correspondence::of(colors, &frames);
            if found == Some(Correspondence::Numbers(0)) {
                return Ok(None);
            }
            let found = found.map(|found| {
                let pairs = found.pairs(colors, &frames).into_iter();
                pairs.filter_map(|(color, frame)| Some((frame, color?))).collect()
            });
            (COLORS, colors.len(), found)
        }
        (_, None) => {
            recording.note(format!(
                "{VIDEO}: the times of its pictures cannot be read: paired by count"
            ));
            return Ok(None);
        }
    };
    let pictures: BTreeMap<u64, u64> = found.ok_or_else(|| {
        let expected =
            format!("a picture for each of {} depth images, or times that pair them", frames.len());
        let hint = "number images in rgb/ as those in depth/";
        metadata_error(&folder.path.join(name), &expected, format!("{n_pictures} pictures"), hint)
    })?;
    let lost: Vec<String> =
        frames.iter().filter(|n| !pictures.contains_key(n)).map(u64::to_string).collect();
    if name == VIDEO && !lost.is_empty() {
        let shown = lost.iter().take(MOST_SHOWN).cloned().collect::<Vec<_>>().join(", ");
        let more = if lost.len() > MOST_SHOWN { ", …" } else { "" };
        recording.note(format!(
            "{VIDEO} lacks {} of {} frames, by the times of its pictures: {shown}{more}",
            lost.len(),
            frames.len()
        ));
    }
    Ok(Some(pictures))
}

/// Returns the frame of each picture of a video, from the times of the pictures.
fn frames_of_pictures(times: &[f64], frames: &[u64], lines: &[OdometryLine]) -> Option<Vec<u64>> {
    let last = lines.iter().map(|line| line.frame).chain(frames.iter().copied()).max()?;
    let is_ascending = |found: &Vec<u64>| found.array_windows().all(|[a, b]| a < b);
    let step = usual_step(times).unwrap_or(1.0);
    // The app shows each picture at a multiple of a step.
    let counted = times.iter().map(|time| {
        let number = (time / step).round();
        let is_whole = (time / step - number).abs() < MOST_OFF_STEP && number >= 0.0;
        is_whole.then_some(number as u64)
    });
    // Other versions show them at the times of their poses.
    let poses: Vec<(f64, u64)> =
        lines.iter().filter_map(|line| Some((line.time?, line.frame))).collect();
    let start = poses.first().map_or(0.0, |(time, _)| *time);
    let recorded = times.iter().map(|time| {
        let after = poses.partition_point(|(at, _)| at - start < *time);
        let near = poses.get(after.saturating_sub(1)..)?.iter().take(2);
        let off = |(at, _): &(f64, u64)| (at - start - time).abs();
        let best = near.min_by(|a, b| off(a).total_cmp(&off(b)))?;
        (off(best) < 0.5 * step).then_some(best.1)
    });
    // Beyond the last frame, the gaps are those of a clock, not of lost pictures.
    let is_count = |found: &Vec<u64>| {
        is_ascending(found) && found.last().is_some_and(|n| *n <= last || *n < found.len() as u64)
    };
    let counted = counted.collect::<Option<Vec<u64>>>().filter(is_count);
    let by_time = counted.or_else(|| recorded.collect::<Option<Vec<u64>>>().filter(is_ascending));
    by_time.or_else(|| (times.len() == frames.len()).then(|| frames.to_vec()))
}

/// Returns the size of the photographs, or that of depth if there are no photographs.
fn color_size(recording: &mut Recording, files: &Files, depth: (u32, u32)) -> Option<(u32, u32)> {
    let folder = recording.folder;
    if files.colors.is_none() && files.video.is_none() {
        return Some(depth);
    }
    let numbers: Vec<u64> = match &files.colors {
        Some(_) => files.depths.numbers().collect(),
        // All pictures of a video have one size.
        None => vec![files.pictures.as_ref().and_then(|p| p.keys().next().copied()).unwrap_or(0)],
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
    if is_centred(ARKIT_VIDEO) && (is_grey || size.0 * ARKIT_VIDEO.1 == size.1 * ARKIT_VIDEO.0) {
        if !is_grey {
            let (width, height) = ARKIT_VIDEO;
            recording.note(format!("{CAMERA} is for {width}x{height}: scaled to the images"));
        }
        return Ok(of(ARKIT_VIDEO));
    }
    // The video's size is unknown: assume a centred principal point, and the shape of depth.
    let width = 2.0 * k.cx;
    let height = width * f64::from(size.1) / f64::from(size.0);
    Ok(if is_grey { of((width.round() as u32, height.round() as u32)) } else { k })
}

struct OdometryLine {
    frame: u64,
    time: Option<f64>,
    matrix: DMat4,
    camera: Option<[f64; 4]>,
}

/// Returns the frames with depth. Of the poses' file only the times are used, if there is one.
fn untracked(folder: &Folder, depths: &NumberedFiles) -> Result<Vec<OdometryLine>, DatasetError> {
    let text = match folder.listing.has_file(POSES) {
        true => folder.lines(POSES)?.1,
        false => String::new(),
    };
    let mut lines = text.lines();
    let times: BTreeMap<u64, f64> = match lines.next().and_then(|head| columns(head, COLUMNS)) {
        Some([at_time, at_frame, ..]) => lines
            .filter_map(|line| {
                let cells: Vec<&str> = line.split(',').map(str::trim).collect();
                let time =
                    cells.get(at_time)?.parse().ok().filter(|time: &f64| time.is_finite())?;
                Some((cells.get(at_frame)?.parse().ok()?, time))
            })
            .collect(),
        None => BTreeMap::new(),
    };
    let line = |frame| OdometryLine {
        frame,
        time: times.get(&frame).copied(),
        matrix: DMat4::IDENTITY,
        camera: None,
    };
    Ok(depths.numbers().map(line).collect())
}

fn odometry(recording: &mut Recording) -> Result<Vec<OdometryLine>, DatasetError> {
    if !recording.folder.listing.has_file(POSES) {
        let file = recording.folder.path.join(POSES);
        return Err(no_poses(&file, "a pose for each frame", "no such file"));
    }
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
            true => found.push(OdometryLine {
                frame,
                time: Some(pose.time),
                matrix: pose.matrix(),
                camera,
            }),
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
    recording.note_unordered(POSES, sort_by_time(&mut found, |line| line.time.unwrap_or_default()));
    Ok(found)
}
