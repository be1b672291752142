//! Replica as rendered by NICE-SLAM: `traj.txt` with one camera-to-world matrix per line (OpenCV axes),
//! `results/frameNNNNNN.jpg` and `results/depthNNNNNN.png`. The camera is in `cam_params.json`, in the
//! folder or, since all rooms share it, in its parent.
//!
//! Depth is rendered, in steps of 1/6553.5 m, and registered.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    ANY_RANGE, Recording, encoding, frame_entry, metadata_error, no_poses, same_size,
};
use super::stated::{KnownCamera, name_unused_keys, parse_json, side};
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, is_file, read_text};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::matrix::describe_json;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use serde_json::Value;
use std::path::PathBuf;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

const POSES: &str = "traj.txt";
const IMAGES: &str = "results";
const CAMERA: &str = "cam_params.json";
/// Depth codes per metre in NICE-SLAM's renderings, whose 16 bits span 10 m.
const CODES_PER_METRE: f64 = 6553.5;
const PUBLISHED: KnownCamera = KnownCamera {
    source: "published",
    intrinsics: Intrinsics { width: 1200, height: 680, fx: 600.0, fy: 600.0, cx: 599.5, cy: 339.5 },
};

fn recognise(folder: &Folder) -> Option<String> {
    let text = folder.peek(POSES);
    let is_matrix =
        text.lines().next().is_some_and(|line| matrix::parse_numbers::<16>(line).is_ok());
    let frames = recognise_unposed(folder).filter(|_| is_matrix)?;
    Some(format!("{POSES} with one matrix per line, and {frames}"))
}

pub(super) fn recognise_unposed(folder: &Folder) -> Option<String> {
    let has = |prefix, extensions| NumberedFiles::any(folder, IMAGES, prefix, extensions);
    let is_ours = has("frame", &PHOTOGRAPHS) && has("depth", &["png"]);
    is_ours.then(|| format!("frames and depth in {IMAGES}/"))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    // Both kinds of images are in one folder; prefixes distinguish them.
    let colors = recording.list(IMAGES, "frame", &PHOTOGRAPHS)?;
    let depths = recording.list(IMAGES, "depth", &["png"])?;
    let sizes = recording.sizes(colors.sources(folder), depths.sources(folder));
    let Some((size, depth_size)) = sizes else { return Ok(recording.finish()) };
    let (file, k, per_metre) = camera(&mut recording, size)?;
    let cameras = recording.cameras_of_lens(&k, size, depth_size, &file)?;
    let unit = CodeKind::Linear16(1.0 / per_metre);
    let encoding = encoding(options, unit, Sensor::Exact { noise: 0.0 }, ANY_RANGE);
    let (traj, text) = match options.track {
        true => (folder.path.join(IMAGES), String::new()),
        false if folder.listing.has_file(POSES) => folder.lines(POSES)?,
        false => return Err(no_poses(&folder.path.join(POSES), "a pose per line", "no such file")),
    };
    let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
    for number in NumberedFiles::union(&[&colors, &depths]) {
        let name = format!("frame{number:06}");
        if folder.was_taken(&name) {
            continue;
        }
        // Lines count frames from 0.
        let line = usize::try_from(number).ok().and_then(|i| lines.get(i));
        let pose = options.pose(|| {
            let missing = || FrameProblem::MissingPose(format!("line {} of {POSES}", number + 1));
            Ok(Pose::from_opencv(matrix::from_text(line.ok_or_else(missing)?)?)?)
        });
        let found = pose.and_then(|pose| {
            let missing = FrameProblem::MissingColor(format!("frame{number:06}.jpg"));
            let color = colors.required(folder, number, missing)?;
            let missing = FrameProblem::MissingDepth(format!("depth{number:06}.png"));
            let depth = DepthSource::new(depths.required(folder, number, missing)?, encoding);
            Ok(frame_entry(name.clone(), pose, cameras, color, Some(depth)))
        });
        recording.add(&name, &traj, found);
    }
    Ok(recording.finish())
}

fn camera(
    recording: &mut Recording,
    size: (u32, u32),
) -> Result<(PathBuf, Intrinsics, f64), DatasetError> {
    let folder = recording.folder;
    let beside = folder.path.join(CAMERA);
    // The parent lies outside the folder, but this name is fixed and not taken from the dataset.
    let above = folder.path.canonicalize().ok().and_then(|p| Some(p.parent()?.join(CAMERA)));
    let file = std::iter::once(beside.clone()).chain(above).find_map(|path| match is_file(&path) {
        Ok(true) => Some(Ok(path)),
        Ok(false) => None,
        Err(source) => Some(Err(DatasetError::Read { path, source })),
    });
    let file = file.transpose()?;
    let Some(file) = file else {
        let expected = "the renderings' own file, here or in the parent folder,";
        let (file, k) = PUBLISHED.assume(recording, size, (beside, expected))?;
        return Ok((file, k, CODES_PER_METRE));
    };
    let text =
        read_text(&file).map_err(|source| DatasetError::Read { path: file.clone(), source })?;
    let json: Value =
        parse_json(&text).map_err(|source| DatasetError::Json { file: file.clone(), source })?;
    let camera = json.get("camera").unwrap_or(&json);
    let number = |key: &str| camera.get(key).and_then(Value::as_f64);
    let all = ["fx", "fy", "cx", "cy"].map(number);
    let size_stated = ["w", "h"].map(|key| side(camera, &[key]));
    let ([Some(fx), Some(fy), Some(cx), Some(cy)], [Some(width), Some(height)]) =
        (all, size_stated)
    else {
        let expected = "`camera` with numbers w, h, fx, fy, cx, cy and scale";
        let hint = "copy the renderings' own file";
        return Err(metadata_error(&file, expected, describe_json(camera), hint));
    };
    same_size((width, height), size, &file)?;
    name_unused_keys(recording, &file, &json, &["w", "h", "fx", "fy", "cx", "cy", "scale"]);
    let scale = number("scale").unwrap_or(CODES_PER_METRE);
    // Lengths are divided by it.
    if !(scale.is_finite() && scale > 0.0) {
        let expected = "a positive `scale`, codes per metre";
        return Err(metadata_error(&file, expected, scale.to_string(), "correct it"));
    }
    Ok((file, Intrinsics { width, height, fx, fy, cx, cy }, scale))
}
