//! RTAB-Map's export: `rgb/`, `depth/` (millimetres), `calib/*.yaml` (or `calib.yaml`, `calibration.yaml`)
//! and poses, in TUM's form (`t x y z qx qy qz qw`, optionally with the image's number) or KITTI's (twelve
//! numbers of a 3×4 matrix).
//!
//! Images are named by number or by time: a pose belongs to the image with its number, its time, or its
//! position in the list. If the calibration contains the camera's mount on the robot
//! (`local_transform`), poses are the robot's (`--poses`). They are the camera's if their file name
//! contains `camera`, as in `…_camera_poses.txt` (`--poses_camera`).

use super::recording::{
    Recording, check_intrinsics, encoding, frame_entry, metadata_error, no_poses, same_size,
};
use super::stated;
use super::trajectory::{ListedPose, lines};
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::{DepthSource, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, FolderListing};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DMat4;
use std::collections::BTreeSet;
use std::path::Path;
use std::rc::Rc;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "RTAB-Map: `rgb/`, `depth/`, a calibration `*.yaml` and poses `*.txt`",
    poses: PoseConvention::Opencv,
    recognise,
    parse,
};

/// Suffix of the name of the photographs' folder. The exporter adds the map's name as prefix, as it
/// does for depth and calibration.
const COLORS: &str = "rgb";
const DEPTHS: &str = "depth";
const CALIBRATIONS: &str = "calib";
/// Part of a file name that marks poses of the camera instead of the robot.
const OF_CAMERA: &str = "camera";
/// Interval of trusted depth, metres.
const TRUSTED_DEPTH: [f64; 2] = [0.3, 5.0];
/// Maximum difference between the rounded time in a file name and the time of its pose, seconds.
const TIME_ROUNDING: f64 = 2e-3;

fn recognise(folder: &Folder) -> Option<String> {
    let poses = pose_file(folder)?;
    recognise_unposed(folder).map(|images| format!("{poses} and {images}"))
}

pub(super) fn recognise_unposed(folder: &Folder) -> Option<String> {
    let (colors, depths) = (subfolder(folder, COLORS)?, subfolder(folder, DEPTHS)?);
    let calibration = calibration(folder)?;
    Some(format!("{calibration}, with images in {colors}/ and {depths}/"))
}

fn subfolder(folder: &Folder, suffix: &str) -> Option<String> {
    let is_one = |name: &String| {
        name.strip_suffix(suffix).is_some_and(|before| before.is_empty() || before.ends_with('_'))
    };
    folder.subfolders().into_iter().find(is_one)
}

fn calibration(folder: &Folder) -> Option<String> {
    let is_yaml = |name: &&str| [".yaml", ".yml"].iter().any(|end| name.ends_with(end));
    let holds = |relative: &str| {
        let text = folder.peek(relative);
        // Other YAML files may lie beside the calibration.
        text.contains("camera_matrix:")
    };
    if let Some(name) = subfolder(folder, CALIBRATIONS) {
        let listing = folder.list(Path::new(&name)).ok()?;
        let mut files = listing.files().filter(is_yaml).map(|file| format!("{name}/{file}"));
        return files.find(|file| holds(file));
    }
    folder.listing.files().filter(is_yaml).find(|name| holds(name)).map(str::to_owned)
}

fn pose_file(folder: &Folder) -> Option<&str> {
    let is_ours = |name: &&str| {
        let text = folder.peek(name);
        // Other texts may begin with numbers too.
        let named = name.contains("poses") || name.contains("trajectory") || name.contains("odom");
        named
            && lines(&text)
                .next()
                .is_some_and(|(i, line)| ListedPose::from_line(i, line).matrix.is_ok())
    };
    folder.listing.files().filter(|name| name.ends_with(".txt")).find(is_ours)
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let (colors, depths) = (Images::list(folder, COLORS)?, Images::list(folder, DEPTHS)?);
    let Some((size, depth_size)) = recording.sizes(colors.sources(), depths.sources()) else {
        return Ok(recording.finish());
    };
    let name = calibration(folder).unwrap_or("calibration.yaml".to_owned());
    let (calibration_file, calibration) = folder.text(&name)?;
    let stated = read_camera(&calibration_file, &calibration)?;
    // The calibration is that of the photographs.
    same_size((stated.width, stated.height), size, &calibration_file)?;
    let cameras = recording.cameras_of_lens(&stated, size, depth_size, &calibration_file)?;
    // A phone's lidar has a lower resolution than its photographs; depth cameras do not.
    let sensor = if size == depth_size { Sensor::Kinect } else { Sensor::Lidar };
    let encoding = encoding(options, CodeKind::ByContent(MILLIMETRE), sensor, TRUSTED_DEPTH);
    let frame = |stem: String, pose| {
        let color = colors.required(&stem, FrameProblem::MissingColor)?;
        let depth = depths.required(&stem, FrameProblem::MissingDepth)?;
        let depth = Some(DepthSource::new(depth, encoding));
        Ok::<_, FrameProblem>(frame_entry(stem, pose, cameras, color, depth))
    };
    if options.track {
        for (stem, _) in colors.by_stem.iter().filter(|(stem, _)| !folder.was_taken(stem)) {
            let found = frame(stem.clone(), Pose::IDENTITY);
            // While the recording grows, the depth image may still be written.
            if found.is_ok() || !folder.is_growing() {
                recording.add(stem, &folder.path.join(DEPTHS), found);
            }
        }
        return Ok(recording.finish());
    }
    let Some(pose_name) = pose_file(folder) else {
        let expected = "poses of the images in TUM's or KITTI's form";
        return Err(no_poses(&folder.path.join("poses.txt"), expected, "no such file"));
    };
    let (file, text) = folder.lines(pose_name)?;
    let on_robot = match pose_name.contains(OF_CAMERA) {
        true => DMat4::IDENTITY,
        false => local_transform(&calibration_file, &calibration)?,
    };
    if on_robot != DMat4::IDENTITY {
        recording.note(format!(
            "{pose_name}: used as poses of the robot, with the camera mounted as {} states; name the \
             file camera_poses.txt if they are the camera's",
            calibration_file.display()
        ));
    }
    // Places in the list count only if every image has a pose.
    let total = lines(&text).count();
    let mut seen = BTreeSet::new();
    for (i, (line, content)) in lines(&text).enumerate() {
        let listed = ListedPose::from_line(line, content);
        let read = || {
            let stem = colors.stem(&listed, i, total)?;
            if folder.was_taken(&stem) {
                return Ok(None);
            }
            let pose = Pose::from_opencv(listed.matrix? * on_robot)?;
            Ok(Some(FrameEntry { time: listed.time, ..frame(stem, pose)? }))
        };
        match read() {
            Ok(None) => {}
            Ok(Some(frame)) if !seen.insert(frame.name.clone()) => {
                let problem = FrameProblem::Duplicate(format!("another pose in line {line}"));
                recording.skip(&frame.name, file.clone(), problem);
            }
            Ok(Some(frame)) => recording.frames.push(frame),
            Err(problem) => recording.skip(&format!("line {line}"), file.clone(), problem),
        }
    }
    Ok(recording.finish())
}

/// Images of a folder with their file names by stem (name without extension), ordered by number or time.
struct Images<'a> {
    folder: &'a Folder,
    name: String,
    listing: Rc<FolderListing>,
    by_stem: Vec<(String, String)>,
}

impl<'a> Images<'a> {
    fn list(folder: &'a Folder, suffix: &str) -> Result<Self, DatasetError> {
        let name = subfolder(folder, suffix).unwrap_or(suffix.to_owned());
        let listing = folder.list(Path::new(&name)).map_err(|problem| {
            let path = folder.path.join(&name);
            metadata_error(&path, "a folder of images", problem.to_string(), "restore it")
        })?;
        let stem = |name: &str| Some((name.rsplit_once('.')?.0.to_owned(), name.to_owned()));
        let mut by_stem: Vec<_> = listing.files().filter_map(stem).collect();
        // By value, because text sorts 10 before 9.
        by_stem.sort_by(|(a, _), (b, _)| value(a).total_cmp(&value(b)).then(a.cmp(b)));
        Ok(Self { folder, name, listing, by_stem })
    }

    fn sources(&self) -> impl Iterator<Item = ByteSource> {
        self.by_stem.iter().filter_map(|(_, name)| self.source(name).ok())
    }

    fn source(&self, name: &str) -> Result<ByteSource, FrameProblem> {
        Ok(self.folder.file(Path::new(&self.name), &self.listing, name)?.into())
    }

    /// Returns the images whose number or time is at least `least`.
    fn from(&self, least: f64) -> &[(String, String)] {
        self.by_stem.split_at(self.by_stem.partition_point(|(stem, _)| value(stem) < least)).1
    }

    fn find(&self, stem: &str) -> Option<&str> {
        // `1` and `01` have the same value.
        let mut equal =
            self.from(value(stem)).iter().take_while(|(other, _)| value(other) == value(stem));
        equal.find(|(other, _)| other == stem).map(|(_, name)| name.as_str())
    }

    fn required(
        &self,
        stem: &str,
        missing: fn(String) -> FrameProblem,
    ) -> Result<ByteSource, FrameProblem> {
        self.source(self.find(stem).ok_or_else(|| missing(stem.to_owned()))?)
    }

    fn stem(&self, pose: &ListedPose, place: usize, total: usize) -> Result<String, FrameProblem> {
        let by_number = pose.number.map(|n| n.to_string());
        if let Some(stem) = by_number.filter(|n| self.find(n).is_some()) {
            return Ok(stem);
        }
        let at = |time: f64| self.from(time - TIME_ROUNDING).first();
        if let Some((stem, _)) = pose.time.and_then(at)
            && pose.time.is_some_and(|time| (value(stem) - time).abs() < TIME_ROUNDING)
        {
            return Ok(stem.clone());
        }
        // A number without an image means that the image is missing, so the place does not apply. While the
        // recording grows, places are not final either.
        let is_counted =
            pose.number.is_none() && total == self.by_stem.len() && !self.folder.is_growing();
        let by_place = self.by_stem.get(place).filter(|_| is_counted);
        by_place.map(|(stem, _)| stem.clone()).ok_or_else(|| {
            let images = self.by_stem.len();
            FrameProblem::MissingColor(format!("of pose {place} of {total} (there are {images})"))
        })
    }
}

/// Parses the number or time in a file name. Other names yield infinity and are sorted last.
fn value(stem: &str) -> f64 {
    stem.parse().ok().filter(|value: &f64| value.is_finite()).unwrap_or(f64::INFINITY)
}

/// Reads the camera from OpenCV's YAML. It is not valid YAML, because it begins with `%YAML:1.0` and
/// tags matrices.
fn read_camera(file: &Path, text: &str) -> Result<Intrinsics, DatasetError> {
    // Only these lines are read, so no YAML parser is needed.
    let number = |key: &str| {
        let line = text.lines().find_map(|line| line.trim().strip_prefix(key))?;
        line.strip_prefix(':')?.trim().parse::<u32>().ok()
    };
    let matrix =
        data(text, "camera_matrix:").and_then(|data| matrix::parse_numbers::<9>(data).ok());
    let size = number("image_width").zip(number("image_height"));
    let k = matrix.zip(size).and_then(|(m, size)| stated::from_matrix(m, size));
    let Some(k) = k else {
        let expected = "`image_width`, `image_height` and a `camera_matrix` of 3x3";
        let hint = "export the calibration again";
        return Err(metadata_error(file, expected, beginning(text), hint));
    };
    check_intrinsics(&k, file)?;
    Ok(k)
}

/// Reads the transform from camera to robot; identity if the file does not state it.
fn local_transform(file: &Path, text: &str) -> Result<DMat4, DatasetError> {
    const KEY: &str = "local_transform:";
    if !text.contains(KEY) {
        return Ok(DMat4::IDENTITY);
    }
    let said = data(text, KEY).unwrap_or_default();
    let motion = matrix::parse_numbers::<12>(said).ok().map(matrix::from_three_rows);
    let rigid = motion.filter(|motion| Pose::from_opencv(*motion).is_ok());
    rigid.ok_or_else(|| {
        let expected = "a rigid `local_transform` of 3x4 numbers";
        metadata_error(file, expected, beginning(said), "export the calibration again")
    })
}

/// Returns the text between the brackets of the `data` of matrix `key`.
fn data<'a>(text: &'a str, key: &str) -> Option<&'a str> {
    let (_, rest) = text.split_once(key)?.1.split_once("data:")?;
    Some(rest.split_once('[')?.1.split_once(']')?.0)
}

fn beginning(text: &str) -> String {
    // A message must not reproduce a damaged file.
    text.lines().next().unwrap_or("an empty file").chars().take(40).collect()
}
