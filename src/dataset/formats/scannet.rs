//! ScanNet as unpacked by its exporter: `color/N.jpg`, `depth/N.png` (millimetres), `pose/N.txt` (camera to
//! world, OpenCV axes), `intrinsic/intrinsic_color.txt` and `intrinsic_depth.txt`.
//!
//! Colour and depth are two cameras of two sizes. If tracking was lost, a pose is all `-inf`; such frames
//! are skipped and counted, unless poses are left to tracking.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, encoding, frame_entry, metadata_error,
};
use super::stated;
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, is_file, read_small_text};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use std::path::{Path, PathBuf};

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

const COLORS: &str = "color";
const DEPTHS: &str = "depth";
const POSES: &str = "pose";
const INTRINSICS: &str = "intrinsic";
const CAMERAS: [&str; 2] = ["intrinsic_color.txt", "intrinsic_depth.txt"];
const PLACES: [&str; 2] = ["extrinsic_color.txt", "extrinsic_depth.txt"];

fn recognise(folder: &Folder) -> Option<String> {
    // Numbered poses distinguish this layout from images without poses.
    let has = [COLORS, DEPTHS].iter().all(|name| folder.has_folder(name));
    let is_ours = has && NumberedFiles::any(folder, POSES, "", &["txt"]);
    is_ours.then(|| format!("numbered poses in {POSES}/, with {COLORS}/ and {DEPTHS}/"))
}

pub(super) fn recognise_unposed(folder: &Folder) -> Option<String> {
    let has = [COLORS, DEPTHS].iter().all(|name| folder.has_folder(name));
    let listing = folder.list(Path::new(INTRINSICS)).ok()?;
    let camera = CAMERAS.into_iter().find(|name| listing.has_file(name))?;
    has.then(|| format!("{INTRINSICS}/{camera}, with {COLORS}/ and {DEPTHS}/"))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let colors = recording.list(COLORS, "", &PHOTOGRAPHS)?;
    let depths = recording.list(DEPTHS, "", &["png"])?;
    let poses = match options.track {
        true => None,
        false => recording.list_optional(POSES, &["txt"])?,
    };
    let sizes = recording.sizes(colors.sources(folder), depths.sources(folder));
    let Some((color, depth)) = sizes else { return Ok(recording.finish()) };
    let cameras = cameras(&recording, color, depth)?;
    for name in PLACES {
        let text = folder.peek(&format!("{INTRINSICS}/{name}"));
        if !text.is_empty() && stated::is_offset(&text) {
            let file = folder.path.join(INTRINSICS).join(name);
            recording.unused(&file, "the transform is not used: poses are taken as both cameras'");
        }
    }
    let unit = CodeKind::Linear16(MILLIMETRE);
    let encoding = encoding(options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE);
    let lists: Vec<&NumberedFiles> = [&colors, &depths].into_iter().chain(&poses).collect();
    for number in NumberedFiles::union(&lists) {
        if folder.was_taken(&number.to_string()) {
            continue;
        }
        let pose = options.pose(|| read_pose(folder, poses.as_ref(), number));
        let found = pose.and_then(|pose| {
            let missing = FrameProblem::MissingColor(format!("{COLORS}/{number}.jpg"));
            let color = colors.required(folder, number, missing)?;
            let missing = FrameProblem::MissingDepth(format!("{DEPTHS}/{number}.png"));
            let depth = DepthSource::new(depths.required(folder, number, missing)?, encoding);
            Ok(frame_entry(number.to_string(), pose, cameras, color, Some(depth)))
        });
        let file = folder.path.join(POSES).join(format!("{number}.txt"));
        recording.add(&number.to_string(), &file, found);
    }
    Ok(recording.finish())
}

fn read_pose(
    folder: &Folder,
    poses: Option<&NumberedFiles>,
    number: u64,
) -> Result<Pose, FrameProblem> {
    let file = poses.and_then(|poses| poses.file(folder, number)).transpose()?;
    let file = file.ok_or_else(|| FrameProblem::MissingPose(format!("{POSES}/{number}.txt")))?;
    // Where tracking was lost, the pose is `-inf`; `Pose` refuses it, which becomes a warning.
    let text = read_small_text(&file)?;
    Ok(Pose::from_opencv(matrix::from_text(&text)?)?)
}

fn cameras(
    recording: &Recording,
    color: (u32, u32),
    depth: (u32, u32),
) -> Result<Cameras, DatasetError> {
    let [color_name, depth_name] = CAMERAS;
    let of_color = intrinsics(recording.folder, color_name, color)?;
    let of_depth = intrinsics(recording.folder, depth_name, depth)?;
    match (of_color, of_depth) {
        // Only size and lens differ: the exporter aligns poses to both cameras, and its extrinsics are
        // identities.
        (Some((color_file, of_color)), Some((depth_file, of_depth))) => recording
            .cameras_of_lenses((&color_file, &of_color), (&depth_file, &of_depth), color, depth),
        // Only one lens is known, so both images are taken to be through it.
        (None, Some((file, stated))) | (Some((file, stated)), None) => {
            recording.cameras_of_lens(&stated, color, depth, &file)
        }
        (None, None) => {
            let file = recording.folder.path.join(INTRINSICS).join(depth_name);
            let Some([fx, fy, cx, cy]) = recording.options.intrinsics else {
                let found = "no such file".to_owned();
                let hint = "export the intrinsics, or set them";
                return Err(metadata_error(&file, "a camera matrix", found, hint));
            };
            let stated = Intrinsics { width: depth.0, height: depth.1, fx, fy, cx, cy };
            recording.cameras_of_lens(&stated, color, depth, &file)
        }
    }
}

fn intrinsics(
    folder: &Folder,
    name: &str,
    size: (u32, u32),
) -> Result<Option<(PathBuf, Intrinsics)>, DatasetError> {
    let relative = format!("{INTRINSICS}/{name}");
    let path = folder.path.join(&relative);
    // Either file may be missing, but not unreadable.
    if !is_file(&path).map_err(|source| DatasetError::Read { path, source })? {
        return Ok(None);
    }
    let (file, text) = folder.text(&relative)?;
    let k = stated::from_text(&text, size, &file)?;
    Ok(Some((file, k)))
}
