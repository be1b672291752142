//! Apps that write one JSON file for each frame, with camera and pose (camera to world, OpenGL axes as in
//! ARKit), beside photograph, depth (millimetres) and confidence of its number.
//!
//! **Polycam**, raw data: `keyframes/` with `images/`, `cameras/`, `depth/` and `confidence/`; keys are `fx fy
//! cx cy width height timestamp`, and `t_00` to `t_23` for the rows of the pose. Where the app optimised
//! the poses, `corrected_images/` and `corrected_cameras/` belong together and replace the others.
//!
//! **3D Scanner App**, all data: `frame_00000.jpg` and `.json`, `depth_00000.png`, `conf_00000.png`; keys are
//! `intrinsics`, `cameraPoseARFrame` and `time`. It stores depth more often than photographs.

use super::lidar::{NumberedImages, StatedCamera, add_frames, camera_matrix, numbers, pose_matrix};
use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::Recording;
use super::stated;
use super::stated::parse_json;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, read_small_text};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::matrix::describe_json;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_check::PoseConvention;
use crate::math::pose::Pose;
use serde_json::Value;
use std::path::{Path, PathBuf};

pub(super) const POLYCAM: DatasetFormat = DatasetFormat {
    identified_by: "Polycam's raw data: `keyframes/` with `images/`, `cameras/` and `depth/`",
    poses: PoseConvention::Opengl,
    recognise: recognise_polycam,
    parse: parse_polycam,
};

pub(super) const SCANNER_3D: DatasetFormat = DatasetFormat {
    identified_by: "3D Scanner App's data: `frame_N.jpg`, `frame_N.json` and `depth_N.png`",
    poses: PoseConvention::Opengl,
    recognise: recognise_scanner_3d,
    parse: parse_scanner_3d,
};

/// Reads the JSON of a frame, which is that of the file.
type ReadCamera = fn(PathBuf, &Value, &LoadOptions) -> Result<StatedCamera, FrameProblem>;

/// Most JSON files that recognition reads, since the first may be damaged.
const MOST_READ: usize = 4;

fn has_camera(
    folder: &Folder,
    relative: &str,
    prefix: &str,
    is_camera: fn(&Value) -> bool,
) -> bool {
    let is_json = |name: &&str| name.starts_with(prefix) && name.ends_with(".json");
    let path = |name: &str| match relative {
        "" => name.to_owned(),
        _ => format!("{relative}/{name}"),
    };
    folder.list_if_any(relative).is_some_and(|listing| {
        let mut files = listing.files().filter(is_json).take(MOST_READ);
        files.any(|name| is_camera(&parse_json(&folder.peek(&path(name))).unwrap_or(Value::Null)))
    })
}

const POLYCAM_ROOTS: [&str; 2] = ["keyframes/", ""];
const POLYCAM_INTRINSICS: [&str; 4] = ["fx", "fy", "cx", "cy"];
const POLYCAM_POSE: [&str; 12] = [
    "t_00", "t_01", "t_02", "t_03", "t_10", "t_11", "t_12", "t_13", "t_20", "t_21", "t_22", "t_23",
];

/// Returns what precedes `images` and `cameras` in the folder's paths: the root, and the prefix of
/// corrected ones.
fn keyframes(folder: &Folder) -> Option<[&'static str; 2]> {
    let is_camera = |json: &Value| numbers(json, POLYCAM_INTRINSICS).is_some();
    let parts = POLYCAM_ROOTS.into_iter().flat_map(|root| [[root, "corrected_"], [root, ""]]);
    parts.into_iter().find(|[root, kind]| {
        NumberedFiles::any(folder, &format!("{root}{kind}images"), "", &PHOTOGRAPHS)
            && has_camera(folder, &format!("{root}{kind}cameras"), "", is_camera)
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
    name_mesh_transform(&mut recording);
    add(&mut recording, &images, (&cameras, polycam_camera), frames);
    Ok(recording.finish())
}

/// Names the transform of the app's mesh, in whose coordinates the frames are not.
fn name_mesh_transform(recording: &mut Recording) {
    const MESH: &str = "mesh_info.json";
    if !recording.folder.listing.has_file(MESH) {
        return;
    }
    let json = parse_json(&recording.folder.peek(MESH)).unwrap_or(Value::Null);
    let is_transform = |key: &&String| key.to_lowercase().contains("transform");
    if let Some(key) = json.as_object().into_iter().flat_map(|mesh| mesh.keys()).find(is_transform)
    {
        let file = recording.folder.path.join(MESH);
        recording.unused(&file, format!("`{}` of the mesh is not used", matrix::shorten(key)));
    }
}

fn polycam_camera(
    file: PathBuf,
    json: &Value,
    options: &LoadOptions,
) -> Result<StatedCamera, FrameProblem> {
    let wrong = |expected| FrameProblem::Entry { expected, found: describe_json(json) };
    let intrinsics = numbers(json, POLYCAM_INTRINSICS)
        .ok_or_else(|| wrong("numbers `fx`, `fy`, `cx` and `cy`"))?;
    let pose = options.pose(|| {
        let rows = numbers(json, POLYCAM_POSE);
        let rows = rows.ok_or_else(|| wrong("numbers `t_00` to `t_23`, three rows of a pose"))?;
        Ok(Pose::from_opengl(matrix::from_three_rows(rows))?)
    })?;
    // The cast saturates: an absurd size has another shape than the images.
    let size = numbers(json, ["width", "height"]).map(|[w, h]| (w as u32, h as u32));
    let time = json.get("timestamp").and_then(Value::as_f64);
    Ok(StatedCamera { file, intrinsics, size, pose, time })
}

fn recognise_scanner_3d(folder: &Folder) -> Option<String> {
    let is_camera = |json: &Value| camera_matrix(json, "intrinsics").is_ok();
    let is_ours = NumberedFiles::any(folder, "", "depth_", &["png"])
        && NumberedFiles::any(folder, "", "frame_", &PHOTOGRAPHS)
        && has_camera(folder, "", "frame_", is_camera);
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
    add(&mut recording, &images, (&cameras, scanner_3d_camera), numbers);
    Ok(recording.finish())
}

fn scanner_3d_camera(
    file: PathBuf,
    json: &Value,
    options: &LoadOptions,
) -> Result<StatedCamera, FrameProblem> {
    let pose = || Ok(Pose::from_opengl(pose_matrix(json, "cameraPoseARFrame")?)?);
    Ok(StatedCamera {
        file,
        intrinsics: camera_matrix(json, "intrinsics")?,
        size: None,
        pose: options.pose(pose)?,
        time: json.get("time").and_then(Value::as_f64),
    })
}

/// Adds the frames of the numbers. A frame that lacks a file or has a damaged one is skipped.
fn add(
    recording: &mut Recording,
    images: &NumberedImages,
    (cameras, read): (&NumberedFiles, ReadCamera),
    numbers: impl IntoIterator<Item = u64>,
) {
    let (folder, options) = (recording.folder, recording.options);
    let json = |file: &Path| {
        let expected = "a JSON object with camera and pose";
        parse_json::<Value>(&read_small_text(file)?)
            .map_err(|error| FrameProblem::Entry { expected, found: error.to_string() })
    };
    // All files have the same keys.
    let first = cameras.sources(folder).next();
    if let Some((file, Ok(json))) = first.as_ref().map(|file| (file.path(), json(file.path()))) {
        stated::name_unused_keys(recording, file, &json, &["intrinsics"]);
    }
    let named = numbers.into_iter().map(|number| (images.name(number), number));
    add_frames(recording, named, &folder.path, |name, number| {
        let images = images.of(folder, number)?;
        let missing = FrameProblem::MissingPose(format!("{name}.json"));
        let file = cameras.required(folder, number, missing)?.path().to_owned();
        let json = json(&file)?;
        Ok((images, read(file, &json, options)?))
    });
}
