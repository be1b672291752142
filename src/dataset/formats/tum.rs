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
//! The recordings do not contain intrinsics. The manufacturer's default projects their depth better than
//! the calibration published for each colour camera.

use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, encoding, frame_entry, metadata_error,
};
use super::rig::{Clock, ImagePair, Mount, Rig};
use super::stated::PRIMESENSE;
use super::trajectory::{TOLERANCE, TimedPose, Trajectory, lines, not_in_time, sort_by_time};
use super::{rig, stated};
use crate::dataset::calibration::ColorCamera;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DepthSource, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{ByteSource, LoadOptions};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::dataset::video::{KINECT_COLOR, KINECT_DEPTH, RollingShutter};
use crate::math::camera::Intrinsics;
use crate::math::pose::{Pose, PoseError};
use glam::{DMat4, DVec3};
use std::path::PathBuf;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "TUM RGB-D: `rgb.txt`, `depth.txt` and `groundtruth.txt`",
    poses: PoseConvention::Opencv,
    recognise,
    parse,
};

const COLOR_LIST: &str = "rgb.txt";
const DEPTH_LIST: &str = "depth.txt";
const POSES: &str = "groundtruth.txt";
/// Maximum time, in seconds, between a depth image and a photograph that count as simultaneous.
const SIMULTANEOUS: f64 = 1e-3;
/// Maximum relative deviation of a PrimeSense camera's focal length from the manufacturer's value. In
/// TUM's calibrations, the deviation is 2 %.
const CALIBRATED: f64 = 0.03;
/// Length of one step of the depth codes, metres.
const DEPTH_UNIT: f64 = 1.0 / 5000.0;

fn recognise(folder: &Folder) -> Option<String> {
    let lists_images = |name: &str| {
        // The start of a list suffices; long recordings have thousands of lines.
        let text = folder.peek(name);
        folder.listing.has_file(name) && lines(&text).any(|(_, line)| image(line).is_some())
    };
    let is_ours = lists_images(COLOR_LIST) && lists_images(DEPTH_LIST);
    is_ours.then(|| format!("{COLOR_LIST} and {DEPTH_LIST} with times and image files"))
}

fn image(line: &str) -> Option<(f64, &str)> {
    let (time, file) = line.split_once(|c: char| c.is_whitespace() || c == ',')?;
    Some((time.parse().ok().filter(|t: &f64| t.is_finite())?, file.trim()))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let colors = images(&mut recording, COLOR_LIST)?;
    let depths = images(&mut recording, DEPTH_LIST)?;
    // Tracking needs no poses, so frames are not delayed for them.
    let trajectory = match options.track {
        false => Some(trajectory(&mut recording)?),
        true => None,
    };
    let Some((cameras, is_kinect)) = cameras(&mut recording, &colors, &depths)? else {
        return Ok(recording.finish());
    };
    let unit = CodeKind::Linear16(DEPTH_UNIT);
    let encoding = encoding(options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE);
    let is_growing = folder.is_growing();
    let poses = trajectory.as_ref().map(|trajectory| Poses {
        trajectory,
        convention: options.poses,
        is_kinect,
        rig: Rig::EXPECTED,
    });
    let taken: Vec<&TimedImage> = depths
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
        recording.add(&depth.name, &depth.path, frame);
    }
    Ok(recording.finish())
}

/// True if all data for the frame of a depth image is written. Poses and photographs are written in
/// order of time, and later ones may be nearer in time to the frame.
fn has_all_data(depth: &TimedImage, poses: Option<Poses<'_>>, colors: &[TimedImage]) -> bool {
    let has = |last: Option<f64>| last.is_some_and(|last| last >= depth.time);
    // A Kinect needs poses until the last row is read.
    let end = |poses: Poses<'_>| {
        let read = if poses.is_kinect { 0.5 * KINECT_DEPTH } else { 0.0 };
        poses.trajectory.end().map(|end| end - read)
    };
    poses.is_none_or(|poses| has(end(poses))) && has(colors.last().map(|color| color.time))
}

struct TimedImage {
    time: f64,
    name: String,
    path: PathBuf,
}

fn images(recording: &mut Recording, list: &str) -> Result<Vec<TimedImage>, DatasetError> {
    let folder = recording.folder;
    let (file, text) = folder.lines(list)?;
    let mut found: Vec<TimedImage> = Vec::new();
    for (line, content) in lines(&text) {
        let Some((time, name)) = image(content) else {
            recording.skip_line(&file, line, "a time in seconds and an image file", content);
            continue;
        };
        match folder.resolve_named(name) {
            Ok(path) => found.push(TimedImage { time, name: name.to_owned(), path }),
            Err(problem) => {
                let problem = problem.or_missing(|| match list == DEPTH_LIST {
                    true => FrameProblem::MissingDepth(name.to_owned()),
                    false => FrameProblem::MissingColor(name.to_owned()),
                });
                recording.skip(name, file.clone(), problem);
            }
        }
    }
    // A stable sort: of images with one time, the one listed first is used.
    recording.note_unordered(list, sort_by_time(&mut found, |image| image.time));
    let mut unique: Vec<TimedImage> = Vec::with_capacity(found.len());
    for image in found {
        match unique.last().is_some_and(|last| last.time == image.time) {
            true => {
                let problem = FrameProblem::Duplicate(format!("`{}` at that time", image.name));
                recording.skip(&image.name, file.clone(), problem);
            }
            false => unique.push(image),
        }
    }
    Ok(unique)
}

fn trajectory(recording: &mut Recording) -> Result<Trajectory, DatasetError> {
    if !recording.folder.listing.has_file(POSES) {
        let expected = "poses, lines of t tx ty tz qx qy qz qw";
        let file = recording.folder.path.join(POSES);
        let hint = "add the recording's trajectory with times on the images' clock, or estimate the poses with --poses track";
        return Err(metadata_error(&file, expected, "no such file".to_owned(), hint));
    }
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
    let (trajectory, unordered, doubled) = Trajectory::new(poses);
    recording.note_unordered(POSES, unordered);
    if doubled > 0 {
        recording
            .note(format!("{POSES}: {doubled} poses with the time of another pose are ignored"));
    }
    Ok(trajectory)
}

/// Determines the cameras from an option, a file or the known intrinsics. Also returns whether they are
/// a Kinect's. Returns `None` if no image can be read.
fn cameras(
    recording: &mut Recording,
    colors: &[TimedImage],
    depths: &[TimedImage],
) -> Result<Option<(Cameras, bool)>, DatasetError> {
    let source = |image: &TimedImage| ByteSource::File(image.path.clone());
    let sizes = recording.sizes(colors.iter().map(source), depths.iter().map(source));
    let Some((size, depth_size)) = sizes else { return Ok(None) };
    let file = recording.folder.path.join("camera-intrinsics.txt");
    let (file, k) = match stated::in_text_file(recording.folder, "", size)? {
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
    depth: &TimedImage,
    colors: &[TimedImage],
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
    let color = nearest(colors, depth.time)?;
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

fn shot(depth: &TimedImage, colors: &[TimedImage], encoding: DepthEncoding) -> Option<ImagePair> {
    // A missing photograph is reported when the frame itself is made.
    let color = nearest(colors, depth.time).ok()?;
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

fn nearest(colors: &[TimedImage], time: f64) -> Result<&TimedImage, FrameProblem> {
    // Photographs are sorted by time, so only two are candidates.
    let after = colors.partition_point(|image| image.time < time);
    let around = [after.checked_sub(1).and_then(|i| colors.get(i)), colors.get(after)];
    let distance = |image: &&TimedImage| (image.time - time).abs();
    let best = around.into_iter().flatten().min_by(|a, b| distance(a).total_cmp(&distance(b)));
    best.filter(|image| distance(image) <= TOLERANCE)
        .ok_or_else(|| not_in_time("a colour image", time, best.as_ref().map(distance)))
}
