//! RTAB-Map's export: `rgb/`, `depth/` (millimetres), `calib/*.yaml` (or `calib.yaml`, `calibration.yaml`)
//! and poses, in TUM's form (`t x y z qx qy qz qw`, optionally with the image's number) or KITTI's (twelve
//! numbers of a 3×4 matrix).
//!
//! Images are named by number or by time: a pose belongs to the image with its number, its time, or its
//! position in the list. If the calibration contains the camera's mount on the robot
//! (`local_transform`), poses are the robot's (`--poses`). They are the camera's if their file name
//! contains `camera`, as in `…_camera_poses.txt` (`--poses_camera`).
//!
//! `calib/` holds a calibration of each image; an image without one has the first calibration. Versions
//! until 2024 wrote a shifted `camera_matrix`, for which the left half of `projection_matrix` serves.

use super::recording::{
    Cameras, Recording, encoding, frame_entry, metadata_error, no_poses, own_camera, same_size,
};
use super::stated;
use super::trajectory::{ListedPose, lines};
use crate::dataset::decode::CodeKind;
use crate::dataset::distortion::Distortion;
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
use std::path::{Path, PathBuf};
use std::rc::Rc;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

/// Suffix of the name of the photographs' folder. The exporter adds the map's name as prefix, as it
/// does for depth and calibration.
const COLORS: &str = "rgb";
const DEPTHS: &str = "depth";
const CALIBRATIONS: &str = "calib";
const YAML: [&str; 2] = [".yaml", ".yml"];
/// Part of a file name that marks poses of the camera instead of the robot.
const OF_CAMERA: &str = "camera";
/// Keys of a calibration that are used, or named with the reason.
const USED: [&str; 7] = [
    "image_width",
    "image_height",
    "camera_matrix",
    "distortion_model",
    "distortion_coefficients",
    "rectification_matrix",
    "projection_matrix",
];
/// Interval of trusted depth, metres.
const TRUSTED_DEPTH: [f64; 2] = [0.3, 5.0];
/// Maximum difference between the rounded time in a file name and the time of its pose, seconds.
const TIME_ROUNDING: f64 = 2e-3;

fn recognise(folder: &Folder) -> Option<String> {
    let poses = pose_files(folder).next()?;
    recognise_unposed(folder).map(|images| format!("{poses} and {images}"))
}

pub(super) fn recognise_unposed(folder: &Folder) -> Option<String> {
    let (colors, depths) = (subfolder(folder, COLORS)?, subfolder(folder, DEPTHS)?);
    let calibration = calibrations(folder).into_iter().next()?;
    Some(format!("{calibration}, with images in {colors}/ and {depths}/"))
}

fn subfolder(folder: &Folder, suffix: &str) -> Option<String> {
    let is_one = |name: &String| {
        name.strip_suffix(suffix).is_some_and(|before| before.is_empty() || before.ends_with('_'))
    };
    folder.subfolders().into_iter().find(is_one)
}

/// Finds the calibrations common to all frames; the first is the one to use.
fn calibrations(folder: &Folder) -> Vec<String> {
    let is_yaml = |name: &&str| YAML.iter().any(|end| name.ends_with(end));
    let holds = |relative: &String| {
        let text = folder.peek(relative);
        // Other YAML files may lie beside the calibration.
        text.contains("camera_matrix:")
    };
    if let Some(name) = subfolder(folder, CALIBRATIONS) {
        let Ok(listing) = folder.list(Path::new(&name)) else { return Vec::new() };
        let mut files = listing.files().filter(is_yaml).map(|file| format!("{name}/{file}"));
        // One for each frame, so a look at one suffices.
        return files.find(holds).into_iter().collect();
    }
    folder.listing.files().filter(is_yaml).map(str::to_owned).filter(holds).collect()
}

/// Finds the lists of poses; the first is the one to use.
fn pose_files(folder: &Folder) -> impl Iterator<Item = &str> {
    let is_ours = |name: &&str| {
        let text = folder.peek(name);
        // Other texts may begin with numbers too.
        let named = name.contains("poses") || name.contains("trajectory") || name.contains("odom");
        named
            && lines(&text)
                .next()
                .is_some_and(|(i, line)| ListedPose::from_line(i, line).matrix.is_ok())
    };
    folder.listing.files().filter(|name| name.ends_with(".txt")).filter(is_ours)
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let (colors, depths) = (Images::list(folder, COLORS)?, Images::list(folder, DEPTHS)?);
    let Some((size, depth_size)) = recording.sizes(colors.sources(), depths.sources()) else {
        return Ok(recording.finish());
    };
    let mut found = calibrations(folder).into_iter();
    let name = found.next().unwrap_or("calibration.yaml".to_owned());
    recording.name_unused_files("calibrations", found);
    let common = Calibration::read(folder, &name)?;
    let sizes = (size, depth_size);
    let cameras = common.cameras(&recording, sizes)?;
    common.name_unused(&mut recording);
    // A phone's lidar has a lower resolution than its photographs; depth cameras do not.
    let sensor = if size == depth_size { Sensor::Kinect } else { Sensor::Lidar };
    let encoding = encoding(options, CodeKind::ByContent(MILLIMETRE), sensor, TRUSTED_DEPTH);
    let frame = |stem: String, pose, cameras| {
        let color = colors.required(&stem, FrameProblem::MissingColor)?;
        let depth = depths.required(&stem, FrameProblem::MissingDepth)?;
        let depth = Some(DepthSource::new(depth, encoding));
        Ok::<_, FrameProblem>(frame_entry(stem, pose, cameras, color, depth))
    };
    if options.track {
        for (stem, _) in colors.by_stem.iter().filter(|(stem, _)| !folder.was_taken(stem)) {
            let found = frame(stem.clone(), Pose::IDENTITY, cameras);
            // While the recording grows, the depth image may still be written.
            if found.is_ok() || !folder.is_growing() {
                recording.add(stem, &folder.path.join(DEPTHS), found);
            }
        }
        return Ok(recording.finish());
    }
    let mut pose_names = pose_files(folder);
    let Some(pose_name) = pose_names.next() else {
        let expected = "poses of the images in TUM's or KITTI's form";
        return Err(no_poses(&folder.path.join("poses.txt"), expected, "no such file"));
    };
    recording.name_unused_files("lists of poses", pose_names.map(str::to_owned));
    let (file, text) = folder.lines(pose_name)?;
    let mount = |calibration: &Calibration| match pose_name.contains(OF_CAMERA) {
        true => Ok(DMat4::IDENTITY),
        false => calibration.local_transform(),
    };
    let on_robot = mount(&common)?;
    if on_robot != DMat4::IDENTITY {
        recording.note(format!(
            "{pose_name}: used as poses of the robot, with the camera mounted as {} states; name the \
             file camera_poses.txt if they are the camera's",
            common.file.display()
        ));
    }
    // One file for all images has another name than theirs.
    let own = name.rsplit_once('/').map(|(parent, _)| parent);
    let own = |stem: &str| {
        let listing = folder.list(Path::new(own?)).ok()?;
        let name = YAML.iter().map(|end| format!("{stem}{end}")).find(|n| listing.has_file(n))?;
        Some(format!("{}/{name}", own?))
    };
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
            let (cameras, on_robot) = match own(&stem).filter(|own| *own != name) {
                None => (cameras, on_robot),
                Some(own) => Calibration::read(folder, &own)
                    .and_then(|own| Ok((own.cameras(&recording, sizes)?, mount(&own)?)))
                    .map_err(own_camera)?,
            };
            let pose = Pose::from_opencv(listed.matrix? * on_robot)?;
            Ok(Some(FrameEntry { time: listed.time, ..frame(stem, pose, cameras)? }))
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

/// OpenCV's YAML. It is not valid YAML, because it begins with `%YAML:1.0` and tags matrices.
struct Calibration {
    file: PathBuf,
    text: String,
}

impl Calibration {
    fn read(folder: &Folder, name: &str) -> Result<Self, DatasetError> {
        let (file, text) = folder.text(name)?;
        Ok(Self { file, text })
    }

    // Only some lines are read, so no YAML parser is needed.
    fn value(&self, key: &str) -> Option<&str> {
        let line = self.text.lines().find_map(|line| line.trim().strip_prefix(key))?;
        Some(line.strip_prefix(':')?.trim().trim_matches('"'))
    }

    fn numbers<const N: usize>(&self, key: &str) -> Option<[f64; N]> {
        matrix::parse_numbers(data(&self.text, key)?).ok()
    }

    /// Returns the cameras for images of the sizes of photographs and depth.
    fn cameras(
        &self,
        recording: &Recording,
        (color, depth): ((u32, u32), (u32, u32)),
    ) -> Result<Cameras, DatasetError> {
        let stated = self.intrinsics()?;
        // The calibration is that of the photographs.
        same_size((stated.width, stated.height), color, &self.file)?;
        let cameras = recording.cameras_of_lens(&stated, color, depth, &self.file)?;
        cameras.with_lens(self.lens()?, &self.file)
    }

    fn intrinsics(&self) -> Result<Intrinsics, DatasetError> {
        let k = self.size().and_then(|size| self.own(size).or_else(|| self.projection(size)));
        k.ok_or_else(|| {
            let expected = "`image_width`, `image_height` and a `camera_matrix` of 3x3";
            let hint = "export the calibration again";
            metadata_error(&self.file, expected, beginning(&self.text), hint)
        })
    }

    fn size(&self) -> Option<(u32, u32)> {
        let side = |key: &str| self.value(key)?.parse::<u32>().ok();
        side("image_width").zip(side("image_height"))
    }

    fn own(&self, size: (u32, u32)) -> Option<Intrinsics> {
        stated::from_matrix(self.numbers("camera_matrix:")?, size)
    }

    fn projection(&self, size: (u32, u32)) -> Option<Intrinsics> {
        let p = self.numbers::<12>("projection_matrix:")?;
        stated::from_matrix([p[0], p[1], p[2], p[4], p[5], p[6], p[8], p[9], p[10]], size)
    }

    /// Returns the lens of OpenCV's terms `k1 k2 p1 p2 k3 k4 k5 k6`; those at the end may be missing.
    fn lens(&self) -> Result<Distortion, DatasetError> {
        let said = data(&self.text, "distortion_coefficients:").unwrap_or_default();
        let terms = said.split(',').map(str::trim).filter(|term| !term.is_empty());
        let terms: Option<Vec<f64>> =
            terms.map(|t| t.parse().ok().filter(|t: &f64| t.is_finite())).collect();
        let model = self.value("distortion_model").unwrap_or("plumb_bob");
        let is_perspective = ["", "plumb_bob", "rational_polynomial"].contains(&model);
        let is_zero = terms.as_ref().is_some_and(|terms| terms.iter().all(|term| *term == 0.0));
        let known = terms.filter(|terms| is_zero || is_perspective && terms.len() <= 8);
        let Some(known) = known else {
            let expected = "at most 8 `distortion_coefficients` of a perspective lens";
            let found = format!("{} of the model {model}", beginning(said));
            let hint = "undistort the images to a pinhole first";
            return Err(metadata_error(&self.file, expected, found, hint));
        };
        Ok(Distortion::of_opencv(&known))
    }

    /// Returns the transform from camera to robot; identity if the file does not state it.
    fn local_transform(&self) -> Result<DMat4, DatasetError> {
        const KEY: &str = "local_transform:";
        if !self.text.contains(KEY) {
            return Ok(DMat4::IDENTITY);
        }
        let motion = self.numbers(KEY).map(matrix::from_three_rows);
        let rigid = motion.filter(|motion| Pose::from_opencv(*motion).is_ok());
        rigid.ok_or_else(|| {
            let expected = "a rigid `local_transform` of 3x4 numbers";
            let found = beginning(data(&self.text, KEY).unwrap_or_default());
            metadata_error(&self.file, expected, found, "export the calibration again")
        })
    }

    fn name_unused(&self, recording: &mut Recording) {
        const RECTIFIED: &str = "rectification_matrix:";
        stated::name_keys(&mut recording.parsed, &self.file, &self.unused_keys());
        let turn = self.numbers::<9>(RECTIFIED);
        if turn.is_some_and(|turn| turn != [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]) {
            let statement = "`rectification_matrix` is not used: poses are those of the raw camera";
            recording.unused(&self.file, statement);
        }
        let Some(size) = self.size() else { return };
        match (self.own(size), self.projection(size)) {
            (None, _) => recording.note(format!(
                "{}: `camera_matrix` is shifted: `projection_matrix` is used",
                self.file.display()
            )),
            (Some(own), Some(p)) if !is_near(&own, &p) => {
                let statement = format!(
                    "`projection_matrix` (focal length {}) is not used: the images have `camera_matrix` ({})",
                    p.fx, own.fx
                );
                recording.unused(&self.file, statement);
            }
            _ => {}
        }
    }

    fn unused_keys(&self) -> BTreeSet<String> {
        // Lines of matrices are indented.
        let keys = self.text.lines().filter_map(|line| Some(line.split_once(':')?.0));
        let keys = keys.filter(|key| stated::is_stating(key) && !USED.contains(key));
        keys.filter(|key| !key.starts_with(' ')).map(matrix::shorten).collect()
    }
}

/// True if the numbers of two cameras agree within 1 %.
fn is_near(one: &Intrinsics, other: &Intrinsics) -> bool {
    let pairs = [(one.fx, other.fx), (one.fy, other.fy), (one.cx, other.cx), (one.cy, other.cy)];
    pairs.iter().all(|(a, b)| (a / b - 1.0).abs() <= 0.01)
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
