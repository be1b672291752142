//! TUM RGB-D: `rgb.txt` and `depth.txt` list images by time, `groundtruth.txt` poses (`t tx ty tz qx qy qz
//! qw`, camera to world, OpenCV axes). Depth is in steps of 1/5000 m and registered to colour.
//!
//! Images and poses have times of their own. A frame is a depth image, the photograph nearest in time,
//! and the pose interpolated at the depth's time: at 100° a second, the camera rotates by half a degree
//! between two poses at 100 Hz. Between depth image and photograph, up to 18 ms apart, it rotates by up
//! to two degrees, or 18 pixels. So the photograph has its own camera, placed by the trajectory at its
//! own time.
//!
//! PrimeSense cameras, recognised by their focal length, have a rolling shutter, which is corrected with
//! the trajectory. Errors of the timestamps and the camera's mount on the tracked body are estimated from
//! the images (`rig/mod.rs`).
//!
//! One list of pairs (`associations.txt` of ORB-SLAM, under any name) may replace both lists, or names of
//! files that are times; poses may be in any list of poses. Times may be in milli-, micro- or nanoseconds:
//! the unit follows from their spacing. Whole numbers may count frames in place of times.
//!
//! The recordings do not contain intrinsics. The manufacturer's default projects their depth better than
//! the calibration published for each colour camera.

use super::numbered::PHOTOGRAPHS;
use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, encoding, frame_entry, metadata_error, no_poses,
};
use super::rig::{Clock, ImagePair, Mount, Rig};
use super::stated::PRIMESENSE;
use super::trajectory::{
    PoseList, TOLERANCE, TimedPose, Trajectory, are_counts, is_text, lines, matching_unit,
    not_in_time, number_in_name, pose_lists, sort_by_time, time_unit, usual_step,
};
use super::{rig, stated};
use crate::dataset::calibration::ColorCamera;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DepthSource, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, check_count};
use crate::dataset::formats::{DatasetFormat, MAX_FRAMES, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::dataset::video::{KINECT_COLOR, KINECT_DEPTH, RollingShutter};
use crate::math::camera::Intrinsics;
use crate::math::pose::{Pose, PoseError};
use glam::{DMat4, DVec3};
use std::path::{Path, PathBuf};

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

const COLOR_LIST: &str = "rgb.txt";
const DEPTH_LIST: &str = "depth.txt";
const POSES: &str = "groundtruth.txt";
const DEPTH_FOLDER: &str = "depth";
/// Maximum time, in seconds, between a depth image and a photograph that count as simultaneous.
const SIMULTANEOUS: f64 = 1e-3;
/// Maximum relative deviation of a PrimeSense camera's focal length from the manufacturer's value. In
/// TUM's calibrations, the deviation is 2 %.
const CALIBRATED: f64 = 0.03;
/// Maximum time between a depth image and its photograph, in steps between photographs.
const MOST_OF_STEP: f64 = 0.75;
/// Length of one step of the depth codes, metres.
const DEPTH_UNIT: f64 = 1.0 / 5000.0;

fn recognise(folder: &Folder) -> Option<String> {
    if has_two_lists(folder) {
        return Some(format!("{COLOR_LIST} and {DEPTH_LIST} with times and image files"));
    }
    let (name, _) = pair_list(folder)?;
    Some(format!("{name} with pairs of image files"))
}

pub(super) fn has_two_lists(folder: &Folder) -> bool {
    [COLOR_LIST, DEPTH_LIST].into_iter().all(|name| {
        // The start of a list suffices; long recordings have thousands of lines.
        let text = folder.peek(name);
        folder.listing.has_file(name) && lines(&text).any(|(_, line)| image(line).is_some())
    })
}

/// Finds a list whose lines name photograph and depth image. Also returns true if depth comes first.
fn pair_list(folder: &Folder) -> Option<(String, bool)> {
    let is_depth = |name: &str| name.to_lowercase().contains("depth");
    // A link to a folder is listed as a file.
    let texts = folder.listing.files().filter(|name| is_text(name) && !folder.has_folder(name));
    texts.into_iter().find_map(|name| {
        let text = folder.peek(name);
        let [(_, first), (_, second)] = pair(lines(&text).next()?.1)?;
        let is_pair = [first, second].iter().all(|name| is_image(name));
        (is_pair && is_depth(first) != is_depth(second)).then(|| (name.to_owned(), is_depth(first)))
    })
}

/// Parses the times and files of a line. A file without a time has the time or number in its name.
fn pair(text: &str) -> Option<[(f64, &str); 2]> {
    let (mut time, mut found) = (None, Vec::new());
    for token in text.split([' ', '\t', ',', ';']).filter(|token| !token.is_empty()) {
        match token.parse::<f64>() {
            Ok(number) if number.is_finite() => time = Some(number),
            _ => {
                let named = || time_in_name(token).or(Some(number_in_name(token)? as f64));
                found.push((time.or_else(named)?, token));
            }
        }
    }
    found.try_into().ok()
}

fn is_image(name: &str) -> bool {
    let extension = name.rsplit_once('.').map(|(_, end)| end.to_lowercase());
    extension.is_some_and(|end| PHOTOGRAPHS.contains(&end.as_str()))
}

/// Lists of a recording's images.
pub(super) enum ImageLists {
    /// One list of photographs, one of depth images.
    Two,
    /// One list of pairs, and true if depth comes first in its lines.
    Pairs(String, bool),
    /// Files whose names are times, in the folder of photographs and that of depth.
    Names([String; 2]),
}

/// Returns the folders of images if all of their names are times.
pub(super) fn timed_names(folder: &Folder, color: &str) -> Option<ImageLists> {
    let folders = [color, DEPTH_FOLDER].map(str::to_owned);
    let are_times = |name: &String| {
        let Ok(listing) = folder.list(Path::new(name)) else { return false };
        let mut names = listing.files().filter(|name| is_image(name)).peekable();
        names.peek().is_some() && names.all(|name| time_in_name(name).is_some())
    };
    folders.iter().all(are_times).then_some(ImageLists::Names(folders))
}

fn time_in_name(name: &str) -> Option<f64> {
    let stem = name.rsplit('/').next()?.rsplit_once('.')?.0;
    // Smaller whole numbers count frames.
    let is_time = |time: &f64| time.is_finite() && (stem.contains('.') || *time >= 1e9);
    stem.parse().ok().filter(is_time)
}

fn image(line: &str) -> Option<(f64, &str)> {
    let (time, file) = line.split_once(|c: char| c.is_whitespace() || c == ',')?;
    Some((time.parse().ok().filter(|t: &f64| t.is_finite())?, file.trim()))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let pairs = pair_list(folder).filter(|_| !has_two_lists(folder));
    let lists = pairs.map_or(ImageLists::Two, |(name, first)| ImageLists::Pairs(name, first));
    parse_lists(folder, options, &lists)
}

pub(super) fn parse_lists(
    folder: &Folder,
    options: &LoadOptions,
    lists: &ImageLists,
) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let mut colors = images(&mut recording, lists, false)?;
    let mut depths = images(&mut recording, lists, true)?;
    let [color_times, depth_times] = [&colors, &depths].map(|images| times(images));
    let unit = time_unit(&depth_times);
    // Tracking needs no poses, so frames are not delayed for them.
    let trajectory = match options.track {
        false => Some(trajectory(&mut recording, (&depth_times, unit))?),
        true => None,
    };
    let color_unit = matching_unit(&color_times, (&depth_times, unit)).unwrap_or(unit);
    for (what, unit) in [("depth images", unit), ("photographs", color_unit)] {
        if unit != 1.0 {
            recording
                .note(format!("times of {what} are in steps of {unit:e} s, from their spacing"));
        }
    }
    depths.iter_mut().for_each(|image| image.time *= unit);
    colors.iter_mut().for_each(|image| image.time *= color_unit);
    let colors = TimedFiles::new(colors);
    let is_counted = are_counts(&depth_times);
    let Some((cameras, is_kinect)) = cameras(&mut recording, &colors.files, &depths)? else {
        return Ok(recording.finish());
    };
    let is_kinect = is_kinect && !is_counted;
    let step = match lists {
        // TUM names its files by seconds.
        ImageLists::Names(_) if unit != 1.0 => MILLIMETRE,
        _ => DEPTH_UNIT,
    };
    let unit = CodeKind::Linear16(step);
    let encoding = encoding(options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE);
    let is_growing = folder.is_growing();
    let poses = trajectory.as_ref().map(|trajectory| Poses {
        trajectory,
        convention: options.poses,
        is_kinect,
        rig: Rig::EXPECTED,
    });
    let taken: Vec<&TimedFile> = depths
        .iter()
        // Filtered before anything is read for a frame, so that a poll of a long recording costs little.
        .filter(|depth| !folder.was_taken(frame_name(&depth.name)))
        .filter(|depth| !is_growing || has_all_data(depth, poses, &colors))
        .collect();
    let poses = match poses {
        // In a growing recording, later frames would change the estimate for the first ones. The search
        // projects photographs by the depth camera.
        Some(poses) if is_kinect && !is_growing && cameras.color.is_none() => {
            // Paths only: the search reads the few images that it needs.
            let shots = taken.iter().filter_map(|depth| shot(depth, &colors, encoding));
            let shots: Vec<ImagePair> = shots.collect();
            Some(poses.with_estimated_rig(&mut recording, &shots, cameras.depth))
        }
        poses => poses,
    };
    if poses.is_some_and(|poses| poses.is_kinect) {
        recording.note("a Kinect reads rows one by one, a photograph in 26 ms and depth in 31 ms: the rolling shutter is corrected with the trajectory");
    }
    for depth in taken {
        let frame = frame(depth, &colors, poses, cameras, encoding);
        let time =
            |frame: FrameEntry| FrameEntry { time: frame.time.filter(|_| !is_counted), ..frame };
        let frame = frame.map(time);
        recording.add(&depth.name, &depth.path, frame);
    }
    Ok(recording.finish())
}

/// True if all data for the frame of a depth image is written. Poses and photographs are written in
/// order of time, and later ones may be nearer in time to the frame.
fn has_all_data(depth: &TimedFile, poses: Option<Poses<'_>>, colors: &TimedFiles) -> bool {
    let has = |last: Option<f64>| last.is_some_and(|last| last >= depth.time);
    // A Kinect needs poses until the last row is read.
    let end = |poses: Poses<'_>| {
        let read = if poses.is_kinect { 0.5 * KINECT_DEPTH } else { 0.0 };
        poses.trajectory.end().map(|end| end - read)
    };
    poses.is_none_or(|poses| has(end(poses))) && has(colors.files.last().map(|color| color.time))
}

pub(super) struct TimedFile {
    pub time: f64,
    pub name: String,
    pub path: PathBuf,
}

fn times(images: &[TimedFile]) -> Vec<f64> {
    images.iter().map(|image| image.time).collect()
}

/// Line of a list, and the time and file that it names.
type ListLine = (usize, String, Option<(f64, String)>);

/// Reads the list of photographs or of depth images. Returns its name and lines.
fn list_lines(
    folder: &Folder,
    lists: &ImageLists,
    is_depth: bool,
) -> Result<(String, Vec<ListLine>), DatasetError> {
    let in_text = |name: &str, parse: &dyn Fn(&str) -> Option<(f64, String)>| {
        let (file, text) = folder.lines(name)?;
        check_count(&file, "images", lines(&text).count(), MAX_FRAMES)?;
        let parsed = lines(&text).map(|(line, text)| (line, text.to_owned(), parse(text)));
        Ok((name.to_owned(), parsed.collect()))
    };
    match lists {
        ImageLists::Two => {
            let name = if is_depth { DEPTH_LIST } else { COLOR_LIST };
            in_text(name, &|line| image(line).map(|(time, file)| (time, file.to_owned())))
        }
        ImageLists::Pairs(name, is_depth_first) => in_text(name, &|line| {
            let [first, second] = pair(line)?;
            let (time, file) = if is_depth == *is_depth_first { first } else { second };
            Some((time, file.to_owned()))
        }),
        ImageLists::Names([color, depth]) => {
            let name = if is_depth { depth } else { color };
            let listing = folder.list(Path::new(name)).map_err(|problem| {
                let path = folder.path.join(name);
                metadata_error(&path, "a folder of images", problem.to_string(), "restore it")
            })?;
            let files =
                listing.files().filter(|file| is_image(file)).enumerate().map(|(i, file)| {
                    (
                        i + 1,
                        file.to_owned(),
                        time_in_name(file).map(|t| (t, format!("{name}/{file}"))),
                    )
                });
            Ok((name.clone(), files.collect()))
        }
    }
}

fn images(
    recording: &mut Recording,
    lists: &ImageLists,
    is_depth: bool,
) -> Result<Vec<TimedFile>, DatasetError> {
    let folder = recording.folder;
    let (list, found_lines) = list_lines(folder, lists, is_depth)?;
    let file = folder.path.join(&list);
    let mut found: Vec<TimedFile> = Vec::new();
    for (line, content, image) in found_lines {
        let Some((time, name)) = image else {
            // A line of pairs is read for both of its images.
            if is_depth || !matches!(lists, ImageLists::Pairs(..)) {
                recording.skip_line(&file, line, "a time in seconds and an image file", &content);
            }
            continue;
        };
        match folder.resolve_named(&name) {
            Ok(path) => found.push(TimedFile { time, name, path }),
            Err(problem) => {
                let problem = problem.or_missing(|| match is_depth {
                    true => FrameProblem::MissingDepth(name.clone()),
                    false => FrameProblem::MissingColor(name.clone()),
                });
                recording.skip(&name, file.clone(), problem);
            }
        }
    }
    // A stable sort: of images with one time, the one listed first is used.
    recording.note_unordered(&list, sort_by_time(&mut found, |image| image.time));
    Ok(without_twins(recording, found, &file))
}

/// Keeps the first of sorted files with one time. The others become warnings about `list`.
pub(super) fn without_twins(
    recording: &mut Recording,
    sorted: Vec<TimedFile>,
    list: &Path,
) -> Vec<TimedFile> {
    let mut unique: Vec<TimedFile> = Vec::with_capacity(sorted.len());
    for image in sorted {
        match unique.last().is_some_and(|last| last.time == image.time) {
            true => {
                let problem = FrameProblem::Duplicate(format!("`{}` at that time", image.name));
                recording.skip(&image.name, list.to_owned(), problem);
            }
            false => unique.push(image),
        }
    }
    unique
}

/// Reads the poses on the clock of the depth images, whose times and unit are given.
fn trajectory(recording: &mut Recording, clock: (&[f64], f64)) -> Result<Trajectory, DatasetError> {
    let (name, mut poses) = match recording.folder.listing.has_file(POSES) {
        true => (POSES.to_owned(), ground_truth(recording)?),
        false => other_poses(recording, clock)?,
    };
    let times: Vec<f64> = poses.iter().map(|pose| pose.time).collect();
    let unit = matching_unit(&times, clock).unwrap_or(clock.1);
    poses.iter_mut().for_each(|pose| pose.time *= unit);
    Ok(sorted_trajectory(recording, &name, poses))
}

/// Sorts the poses of the list `name`. Poses out of order and doubled ones are told in notes.
pub(super) fn sorted_trajectory(
    recording: &mut Recording,
    name: &str,
    poses: Vec<TimedPose>,
) -> Trajectory {
    let (trajectory, unordered, doubled) = Trajectory::new(poses);
    recording.note_unordered(name, unordered);
    if doubled > 0 {
        recording
            .note(format!("{name}: {doubled} poses with the time of another pose are ignored"));
    }
    trajectory
}

fn ground_truth(recording: &mut Recording) -> Result<Vec<TimedPose>, DatasetError> {
    let (file, text) = recording.folder.lines(POSES)?;
    let mut poses = Vec::new();
    for (line, content) in lines(&text) {
        match matrix::parse_numbers::<8>(content).map(TimedPose::new) {
            Ok(Some(pose)) => poses.push(pose),
            Ok(None) | Err(_) => {
                let expected = "finite t tx ty tz and a unit quaternion qx qy qz qw";
                recording.skip_line(&file, line, expected, content);
            }
        }
    }
    Ok(poses)
}

/// Reads the poses from a list under another name: with times among those of the depth images or, in its
/// order, as many as depth images.
fn other_poses(
    recording: &mut Recording,
    clock @ (depth_times, _): (&[f64], f64),
) -> Result<(String, Vec<TimedPose>), DatasetError> {
    let folder = recording.folder;
    let is_timed = |list: &PoseList| {
        let times: Vec<f64> = list.poses.iter().filter_map(|pose| pose.time).collect();
        matching_unit(&times, clock).is_some()
    };
    // The last line of a growing list may lack digits, and its count is not final.
    let fits = |list: &PoseList| {
        is_timed(list) || list.poses.len() == depth_times.len() && !folder.is_growing()
    };
    let (fitting, others): (Vec<_>, Vec<_>) =
        pose_lists(folder).into_iter().partition(|(_, list)| fits(list));
    let Some((name, list)) = fitting.into_iter().next() else {
        let expected = "poses, lines of t tx ty tz qx qy qz qw";
        let (file, found) = match others.first() {
            None => (POSES, "no such file".to_owned()),
            Some((name, list)) => {
                let (n, n_depths) = (list.poses.len(), depth_times.len());
                let form = list.form;
                (
                    name.as_str(),
                    format!("{n} poses ({form}) without times for {n_depths} depth images"),
                )
            }
        };
        return Err(no_poses(&folder.path.join(file), expected, &found));
    };
    let list = match folder.is_growing() {
        true => PoseList::parse(&folder.lines(&name)?.1).unwrap_or(list),
        false => list,
    };
    let (file, is_timed) = (folder.path.join(&name), is_timed(&list));
    let paired = if is_timed { "by time" } else { "by their order" };
    recording.note(format!("poses are those of {name} ({}), paired {paired}", list.form));
    stated::name_keys(&mut recording.parsed, &file, &list.unused);
    let mut poses = Vec::new();
    for (place, listed) in list.poses.into_iter().enumerate() {
        let time = if is_timed { listed.time } else { depth_times.get(place).copied() };
        let pose = listed.matrix.and_then(|matrix| Ok(Pose::from_opencv(matrix)?.to_opencv()));
        match (time, pose) {
            (Some(time), Ok(matrix)) => poses.push(TimedPose::from_matrix(time, matrix)),
            (_, Err(problem)) => {
                recording.skip(&format!("line {}", listed.line), file.clone(), problem);
            }
            (None, Ok(_)) => {
                let found = "a pose without time";
                recording.skip_line(&file, listed.line, "a time with each pose", found);
            }
        }
    }
    Ok((name, poses))
}

/// Determines the cameras from an option, a file or the known intrinsics. Also returns whether they are
/// a Kinect's. Returns `None` if no image can be read.
fn cameras(
    recording: &mut Recording,
    colors: &[TimedFile],
    depths: &[TimedFile],
) -> Result<Option<(Cameras, bool)>, DatasetError> {
    let source = |image: &TimedFile| ByteSource::File(image.path.clone());
    let sizes = recording.sizes(colors.iter().map(source), depths.iter().map(source));
    let Some((size, depth_size)) = sizes else { return Ok(None) };
    let file = recording.folder.path.join("camera-intrinsics.txt");
    let (file, k) = match stated::in_any_file(recording, size)? {
        Some(stated) => stated,
        None => PRIMESENSE.assume(recording, size, (file, "fx fy cx cy"))?,
    };
    let cameras = recording.cameras_of_lens(&k, size, depth_size, &file)?;
    Ok(Some((cameras, is_kinect(&cameras.depth))))
}

fn is_kinect(k: &Intrinsics) -> bool {
    let is_near = |focal: f64, makers: f64| (focal / makers - 1.0).abs() < CALIBRATED;
    let makers = PRIMESENSE.intrinsics;
    (k.width, k.height) == (makers.width, makers.height)
        && is_near(k.fx, makers.fx)
        && is_near(k.fy, makers.fy)
}

#[derive(Clone, Copy)]
struct Poses<'a> {
    trajectory: &'a Trajectory,
    /// Pose convention set by the user; `None` for the layout's convention.
    convention: Option<PoseConvention>,
    /// True for cameras with a rolling shutter.
    is_kinect: bool,
    rig: Rig,
}

impl Poses<'_> {
    fn at(&self, time: f64) -> Option<Pose> {
        let matrix = self.trajectory.at(time).ok()?;
        self.mounted(matrix).ok()
    }

    /// Returns the pose as [`Self::at`] does, but in the layout's pose convention. Opening the dataset
    /// replaces this convention by the user's.
    fn stated_at(&self, time: f64) -> Result<Pose, FrameProblem> {
        let matrix = self.trajectory.at(time)?;
        let pose = self.mounted(matrix)?;
        match self.convention {
            None => Ok(pose),
            // Undoes the convention that opening applies afterwards.
            Some(asked) => Ok(FORMAT.poses.pose(asked.matrix(&pose))?),
        }
    }

    fn mounted(&self, matrix: DMat4) -> Result<Pose, PoseError> {
        let convention = self.convention.unwrap_or(FORMAT.poses);
        Ok(self.rig.mount.camera_pose(&convention.pose(matrix)?))
    }

    fn with_estimated_rig(
        self,
        recording: &mut Recording<'_>,
        shots: &[ImagePair],
        intrinsics: Intrinsics,
    ) -> Self {
        let tracked = &|time| self.at(time);
        let [depth_reading, color_reading] = [KINECT_DEPTH, KINECT_COLOR];
        let clock = Clock { tracked, mount: None, intrinsics, depth_reading, color_reading };
        let rig = rig::find(shots, &clock);
        for (what, delay) in [("depth was", rig.depth_delay), ("photographs were", rig.color_delay)]
        {
            if delay != 0.0 {
                recording.note(format!(
                    "{what} taken {:.0} ms {} the recorded times, estimated from the images and the trajectory; cameras are placed accordingly",
                    1e3 * delay.abs(),
                    if delay < 0.0 { "before" } else { "after" }
                ));
            }
        }
        if rig.mount != Mount::default() {
            recording.note(format!(
                "the camera is mounted {:.1} cm from the tracked body and rotated by {:.1} degrees relative to it, estimated from depth; cameras are placed accordingly",
                100.0 * rig.mount.shift.length(),
                rig.mount.turn.length().to_degrees()
            ));
        }
        Self { is_kinect: rig.reads_rows, rig, ..self }
    }

    /// Returns the camera rotation during the readout of an image. The middle row is read at `time`; the
    /// readout takes `seconds`.
    fn shutter(&self, time: f64, seconds: f64) -> RollingShutter {
        let ends = (self.at(time - 0.5 * seconds), self.at(time + 0.5 * seconds));
        let turn = match ends {
            (Some(first), Some(last)) => first.offset_to(&last).1.to_scaled_axis(),
            // At the ends of the trajectory the rotation is unknown and stays uncorrected.
            _ => DVec3::ZERO,
        };
        RollingShutter { rotation: turn }
    }

    fn lens(&self, [depth, color]: [f64; 2]) -> Distortion {
        match self.is_kinect {
            true => Distortion {
                color: self.shutter(color, KINECT_COLOR),
                depth: self.shutter(depth, KINECT_DEPTH),
                ..Distortion::default()
            },
            false => Distortion::default(),
        }
    }

    /// Places the colour camera at its pose at the photograph's time. The cameras are unchanged if the
    /// trajectory has no pose at one of the two times.
    fn cameras_at_times(&self, cameras: Cameras, size: [u32; 2], times: [f64; 2]) -> Cameras {
        // One pose suffices, and colours stay registered to depth.
        if (times[0] - times[1]).abs() < SIMULTANEOUS {
            return cameras;
        }
        let (Some(depth), Some(color)) = (self.at(times[0]), self.at(times[1])) else {
            return cameras;
        };
        let lens = cameras
            .color
            .unwrap_or_else(|| ColorCamera::from_depth_intrinsics(&cameras.depth, size));
        Cameras { color: Some(lens.with_extrinsics_between(&depth, &color)), ..cameras }
    }
}

fn frame(
    depth: &TimedFile,
    colors: &TimedFiles,
    poses: Option<Poses<'_>>,
    cameras: Cameras,
    encoding: DepthEncoding,
) -> Result<FrameEntry, FrameProblem> {
    let rig = poses.map_or(Rig::EXPECTED, |poses| poses.rig);
    let measured = depth.time + rig.depth_delay;
    let pose = match poses {
        Some(poses) => poses.stated_at(measured)?,
        None => Pose::IDENTITY,
    };
    let color = colors.nearest(depth.time)?;
    let size = [cameras.depth.width, cameras.depth.height];
    let times = [measured, color.time + rig.color_delay];
    let lens = poses.map_or(Distortion::default(), |poses| poses.lens(times));
    let cameras = poses.map_or(cameras, |poses| poses.cameras_at_times(cameras, size, times));
    let depth_source = Some(DepthSource::new(ByteSource::File(depth.path.clone()), encoding));
    let name = frame_name(&depth.name).to_owned();
    let cameras = Cameras { lens, ..cameras };
    let frame = frame_entry(name, pose, cameras, color.path.clone().into(), depth_source);
    Ok(FrameEntry { time: Some(depth.time), ..frame })
}

fn shot(depth: &TimedFile, colors: &TimedFiles, encoding: DepthEncoding) -> Option<ImagePair> {
    // A missing photograph is reported when the frame itself is made.
    let color = colors.nearest(depth.time).ok()?;
    let file = ByteSource::File(depth.path.clone());
    Some(ImagePair {
        name: frame_name(&depth.name).into(),
        depth: (depth.time, DepthSource::new(file, encoding)),
        color: (color.time, ByteSource::File(color.path.clone())),
    })
}

/// Returns the name of the depth file without folder and extension.
fn frame_name(depth: &str) -> &str {
    depth.rsplit('/').next().unwrap_or(depth).trim_end_matches(".png")
}

/// Files in the order of their times.
pub(super) struct TimedFiles {
    pub files: Vec<TimedFile>,
    /// Maximum time between a file and what belongs to it, seconds.
    tolerance: f64,
}

impl TimedFiles {
    pub fn new(files: Vec<TimedFile>) -> Self {
        // Less than a step: a neighbour must not replace a lost photograph.
        let step = usual_step(&times(&files)).map_or(f64::INFINITY, |step| MOST_OF_STEP * step);
        Self { files, tolerance: step.min(TOLERANCE) }
    }

    pub fn nearest(&self, time: f64) -> Result<&TimedFile, FrameProblem> {
        // Files are sorted by time, so only two are candidates.
        let after = self.files.partition_point(|file| file.time < time);
        let before = after.checked_sub(1).and_then(|i| self.files.get(i));
        let around = [before, self.files.get(after)];
        let distance = |file: &&TimedFile| (file.time - time).abs();
        let best = around.into_iter().flatten().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let nearest = best.as_ref().map(distance);
        best.filter(|file| distance(file) <= self.tolerance)
            .ok_or_else(|| not_in_time("a colour image", time, self.tolerance, nearest))
    }
}
