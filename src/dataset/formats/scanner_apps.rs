//! Apps that write one JSON file for each frame, with camera and pose (camera to world, OpenGL axes as in
//! ARKit), beside photograph, depth (millimetres) and confidence of its number.
//!
//! **Polycam**, raw data: `keyframes/` with `images/`, `cameras/`, `depth/` and `confidence/`; keys are `fx fy
//! cx cy width height timestamp`, and `t_00` to `t_23` for the rows of the pose. Where the app optimised
//! the poses, `corrected_images/` and `corrected_cameras/` belong together and replace the others.
//!
//! **3D Scanner App**, all data: `frame_00000.jpg` and `.json`, `depth_00000.png`, `conf_00000.png`; keys are
//! `intrinsics`, `cameraPoseARFrame` and `time`. It stores depth more often than photographs.

use super::arkit;
use super::lidar::{NumberedImages, StatedCamera, add_frames, camera_matrix, numbers, wrong_entry};
use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::Recording;
use super::stated::{first_of, name_keys, parse_json, unused_keys};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, read_small_text};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_check::PoseConvention;
use crate::math::pose::Pose;
use serde_json::Value;
use std::cell::RefCell;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub(super) const POLYCAM: DatasetFormat = DatasetFormat {
    poses: PoseConvention::Opengl,
    recognise: recognise_polycam,
    parse: parse_polycam,
};

pub(super) const SCANNER_3D: DatasetFormat = DatasetFormat {
    poses: PoseConvention::Opengl,
    recognise: recognise_scanner_3d,
    parse: parse_scanner_3d,
};

/// Keys that have an effect, besides the pose.
const USED: [&str; 9] =
    ["fx", "fy", "cx", "cy", "intrinsics", "width", "height", "timestamp", "time"];

/// Most JSON files that recognition reads, since the first may be damaged.
const MOST_READ: usize = 4;

/// True if a folder, whose path ends with `/`, has JSON files with intrinsics.
fn has_cameras(folder: &Folder, relative: &str, prefix: &str) -> bool {
    let is_json = |name: &&str| name.starts_with(prefix) && name.ends_with(".json");
    let is_camera = |name: &str| {
        let json = parse_json(&folder.peek(&format!("{relative}{name}"))).unwrap_or(Value::Null);
        intrinsics(&json).is_some()
    };
    folder
        .list_if_any(relative)
        .is_some_and(|listing| listing.files().filter(is_json).take(MOST_READ).any(is_camera))
}

fn intrinsics(json: &Value) -> Option<[f64; 4]> {
    numbers(json, ["fx", "fy", "cx", "cy"]).or_else(|| camera_matrix(json, "intrinsics"))
}

/// Reads the camera of a frame from the JSON of `file`.
fn camera(
    file: PathBuf,
    json: &Value,
    options: &LoadOptions,
) -> Result<StatedCamera, FrameProblem> {
    let wrong = || wrong_entry("numbers `fx`, `fy`, `cx` and `cy`, or nine in `intrinsics`", json);
    let pose = options.pose(|| {
        let no_rows =
            || wrong_entry("numbers `t_00` to `t_23`, or 16 in `cameraPoseARFrame`", json);
        let matrix = match json.get("cameraPoseARFrame") {
            Some(value) => arkit::matrix(Some(value))?,
            None => matrix::from_three_rows(numbers(json, POLYCAM_POSE).ok_or_else(no_rows)?),
        };
        Ok(Pose::from_opengl(matrix)?)
    })?;
    Ok(StatedCamera {
        file,
        intrinsics: intrinsics(json).ok_or_else(wrong)?,
        // The cast saturates: an absurd size has another shape than the images.
        size: numbers(json, ["width", "height"]).map(|[w, h]| (w as u32, h as u32)),
        pose,
        time: first_of(json, &["timestamp", "time"]).and_then(Value::as_f64),
    })
}

const POLYCAM_ROOTS: [&str; 2] = ["keyframes/", ""];
const MESH: &str = "mesh_info.json";
const POLYCAM_POSE: [&str; 12] = [
    "t_00", "t_01", "t_02", "t_03", "t_10", "t_11", "t_12", "t_13", "t_20", "t_21", "t_22", "t_23",
];

/// Returns what precedes `images` and `cameras` in the folder's paths: the root, and the prefix of
/// corrected ones.
fn keyframes(folder: &Folder) -> Option<[&'static str; 2]> {
    let parts = POLYCAM_ROOTS.into_iter().flat_map(|root| [[root, "corrected_"], [root, ""]]);
    parts.into_iter().find(|[root, kind]| {
        NumberedFiles::any(folder, &format!("{root}{kind}images"), "", &PHOTOGRAPHS)
            && has_cameras(folder, &format!("{root}{kind}cameras/"), "")
    })
}

fn recognise_polycam(folder: &Folder) -> Option<String> {
    let [root, kind] = keyframes(folder)?;
    Some(format!("{root}{kind}cameras/ with `fx` and {root}{kind}images/"))
}

fn parse_polycam(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    // The default is used only if files were removed since recognition; listing then fails.
    let [root, kind] = keyframes(folder).unwrap_or([POLYCAM_ROOTS[0], ""]);
    let [colors, depths, maps] =
        [format!("{kind}images"), "depth".to_owned(), "confidence".to_owned()]
            .map(|name| format!("{root}{name}"));
    let images = NumberedImages::list(&mut recording, [(&colors, ""), (&depths, ""), (&maps, "")])?;
    let cameras = recording.list(&format!("{root}{kind}cameras"), "", &["json"])?;
    let mut frames = NumberedFiles::union(&[&images.colors, &cameras]);
    let bare: Vec<u64> = { images.bare_depths() }.filter(|n| !frames.contains(n)).collect();
    match kind {
        "" => frames.extend(bare),
        _ if bare.is_empty() => {}
        // The app could not place these frames, whose own poses are of another world.
        _ => recording.note(format!("{} frames without corrected camera are left out", bare.len())),
    }
    if folder.listing.has_file(MESH) && folder.peek(MESH).to_lowercase().contains("transform") {
        recording.unused(&folder.path.join(MESH), "the transform of the mesh is not used");
    }
    add(&mut recording, &images, &cameras, frames);
    Ok(recording.finish())
}

fn recognise_scanner_3d(folder: &Folder) -> Option<String> {
    let is_ours = NumberedFiles::any(folder, "", "depth_", &["png"])
        && NumberedFiles::any(folder, "", "frame_", &PHOTOGRAPHS)
        && has_cameras(folder, "", "frame_");
    is_ours.then(|| "frame_N.json with `intrinsics`, and depth_N.png".to_owned())
}

fn parse_scanner_3d(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let places = [("", "frame_"), ("", "depth_"), ("", "conf_")];
    let images = NumberedImages::list(&mut recording, places)?;
    let cameras = recording.list("", "frame_", &["json"])?;
    let n_bare = images.bare_depths().count();
    if n_bare > 0 {
        recording.note(format!("{n_bare} depth images have no photograph and are left out"));
    }
    let numbers: Vec<u64> = images.colors.numbers().collect();
    add(&mut recording, &images, &cameras, numbers);
    Ok(recording.finish())
}

/// Adds the frames of the numbers. A frame that lacks a file or has a damaged one is skipped.
fn add(
    recording: &mut Recording,
    images: &NumberedImages,
    cameras: &NumberedFiles,
    numbers: impl IntoIterator<Item = u64>,
) {
    let (folder, options) = (recording.folder, recording.options);
    let json = |file: &Path| {
        let expected = "a JSON object with camera and pose";
        parse_json::<Value>(&read_small_text(file)?)
            .map_err(|error| FrameProblem::Entry { expected, found: error.to_string() })
    };
    let first = cameras.sources(folder).next();
    let unused = RefCell::new(BTreeSet::new());
    let named = numbers.into_iter().map(|number| (images.name(number), number));
    let place = first.as_ref().and_then(|file| file.path().parent()).unwrap_or(&folder.path);
    add_frames(recording, named, place, |name, number| {
        let images = images.of(folder, number)?;
        let missing = FrameProblem::MissingPose(format!("{name}.json"));
        let file = cameras.required(folder, number, missing)?.path().to_owned();
        let json = json(&file)?;
        unused_keys(&json, &USED, &mut unused.borrow_mut());
        Ok((images, camera(file, &json, options)?))
    });
    name_keys(&mut recording.parsed, place, &unused.into_inner());
}
