//! Research sets recorded with Apple's lidar.
//!
//! **ARKitScenes**, raw: `lowres_wide/`, `lowres_depth/`, `confidence/` and `lowres_wide_intrinsics/` (`w h fx
//! fy cx cy`) have files of names that end with their times. `lowres_wide.traj` has time, axis times angle and
//! translation of world to camera (OpenCV axes), ten a second, so poses are interpolated. Sharper photographs
//! (`wide/`, `vga_wide/`) replace the small ones. The 3DOD subset holds all in `<id>_frames/`.
//!
//! **ScanNet++**, iPhone: `rgb/`, `depth/` and `pose_intrinsic_imu.json`, an object of frames by name with
//! `intrinsic`, `timestamp`, and `aligned_pose` (camera to world, OpenCV axes). `pose` is ARKit's own, in OpenGL
//! axes and in another world, so it is used only if no frame has an `aligned_pose`.

use super::arkit;
use super::lidar::{
    LidarImages, NumberedImages, StatedCamera, add_frames, camera_matrix, wrong_entry,
};
use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{Recording, metadata_error, no_poses};
use super::stated::{Entries, name_keys, parse_json, unused_keys};
use super::trajectory::{TimedPose, Trajectory, lines, number_in_name, usual_step};
use super::tum::{TimedFile, TimedFiles, sorted_trajectory, without_twins};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, read_small_text};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_check::PoseConvention;
use crate::math::pose::Pose;
use glam::{DMat4, DQuat, DVec3};
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

pub(super) const ARKIT_SCENES: DatasetFormat = DatasetFormat {
    poses: PoseConvention::Opencv,
    recognise: recognise_arkit_scenes,
    parse: parse_arkit_scenes,
};

pub(super) const SCANNET_PP: DatasetFormat = DatasetFormat {
    poses: PoseConvention::Opencv,
    recognise: recognise_scannet_pp,
    parse: parse_scannet_pp,
};

/// Folders of photographs through the lens of depth, the sharpest first.
const WIDE: [&str; 3] = ["wide", "vga_wide", "lowres_wide"];
/// Ratio of the times between files of two lists above which one list is sparser on purpose.
const SPARSER: f64 = 1.5;

struct Scene {
    /// Path before the names of folders.
    root: String,
    colors: &'static str,
    /// Path of the folder of intrinsics.
    cameras: String,
}

impl Scene {
    fn find(folder: &Folder) -> Option<Self> {
        let parts = folder.subfolders().into_iter().filter(|name| name.ends_with("_frames"));
        let roots = std::iter::once(String::new()).chain(parts.map(|name| format!("{name}/")));
        let mut scenes = roots.filter_map(|root| {
            let has = |name: &str, is_ours: fn(&str) -> bool| {
                let listing = folder.list_if_any(&format!("{root}{name}"));
                listing.is_some_and(|listing| listing.files().any(is_ours))
            };
            let colors = WIDE.into_iter().find(|name| has(name, |file| time(file).is_some()))?;
            // Intrinsics of the same lens state their size.
            let cameras = std::iter::once(colors).chain(WIDE).map(|n| format!("{n}_intrinsics"));
            let cameras = { cameras }.find(|name| has(name, |file| file.ends_with(".pincam")))?;
            let cameras = format!("{root}{cameras}");
            Some(Self { colors, cameras, root })
        });
        let first = scenes.next();
        // Two scenes are two worlds: the user has to choose one.
        first.filter(|_| scenes.next().is_none())
    }
}

/// Parses the time at the end of a file name, such as 6845.706 in `40000001_6845.706.png`.
fn time(name: &str) -> Option<f64> {
    let (stem, _) = name.rsplit_once('.')?;
    stem.rsplit('_').next()?.parse().ok().filter(|time: &f64| time.is_finite())
}

fn recognise_arkit_scenes(folder: &Folder) -> Option<String> {
    let Scene { root, colors, cameras } = Scene::find(folder)?;
    Some(format!("times as names in {root}{colors}/, and {cameras}/*.pincam"))
}

fn parse_arkit_scenes(
    folder: &Folder,
    options: &LoadOptions,
) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let Some(Scene { root, colors: sharpest, cameras }) = Scene::find(folder) else {
        return Ok(recording.finish()); // removed since recognition
    };
    let other = WIDE.into_iter().chain(["ultrawide"]).filter(|name| *name != sharpest);
    let other: Vec<_> = other.filter(|name| folder.has_folder(&format!("{root}{name}"))).collect();
    if !other.is_empty() {
        recording.note(format!("photographs of {sharpest}/ are used, not of {}", other.join(", ")));
    }
    let trajectory = match options.track {
        true => None,
        false => Some(world_to_camera(&mut recording, &root)?),
    };
    let mut list = |name: &str, extensions: &[&str]| timed_files(&mut recording, name, extensions);
    let colors = list(&format!("{root}{sharpest}"), &PHOTOGRAPHS)?;
    let depths = list(&format!("{root}lowres_depth"), &["png"])?;
    let cameras = list(&cameras, &["pincam"])?;
    let maps = format!("{root}confidence");
    let maps = folder.has_folder(&maps).then(|| list(&maps, &["png"])).transpose()?;
    let maps = maps.filter(|maps| !maps.files.is_empty());
    let frames = frames_of(&colors, &depths);
    let [n_colors, n_depths] = [&colors, &depths].map(|files| files.files.len());
    if frames.len() < n_colors.max(n_depths) {
        recording.note(format!(
            "{n_colors} photographs and {n_depths} depth images: those of one time are used"
        ));
    }
    let named = frames.into_iter().map(|file| {
        let stem = file.name.rsplit_once('.').map_or(&*file.name, |(stem, _)| stem);
        (stem.to_owned(), file.time)
    });
    add_frames(&mut recording, named, &folder.path.join(&root), |_, time| {
        let near = |files: &TimedFiles| files.nearest(time).ok().map(|file| file.path.clone());
        let missing = || FrameProblem::MissingColor(format!("in {sharpest}/ at {time} s"));
        let color = near(&colors).ok_or_else(missing)?.into();
        let confidence = maps.as_ref().map(|maps| {
            near(maps).ok_or_else(|| FrameProblem::MissingConfidence(format!("at {time} s")))
        });
        let confidence = confidence.transpose()?.map(Into::into);
        let images = LidarImages { color, depth: near(&depths).map(Into::into), confidence };
        let expected = "a file of numbers `w h fx fy cx cy` at the frame's time";
        let wrong = |found| FrameProblem::Entry { expected, found };
        let file = near(&cameras).ok_or_else(|| wrong("none".to_owned()))?;
        let numbers = matrix::parse_numbers::<6>(&read_small_text(&file)?).map_err(wrong)?;
        let [width, height, fx, fy, cx, cy] = numbers;
        let pose = trajectory.as_ref().map_or(Ok(Pose::IDENTITY), |trajectory| {
            Ok::<_, FrameProblem>(Pose::from_opencv(trajectory.at(time)?)?)
        })?;
        // The cast saturates: an absurd size has another shape than the images.
        let size = Some((width as u32, height as u32));
        let intrinsics = [fx, fy, cx, cy];
        Ok((images, StatedCamera { file, intrinsics, size, pose, time: Some(time) }))
    });
    Ok(recording.finish())
}

/// Returns the files that make frames: those of the sparser list or, if both are equally dense, depth images
/// and photographs without one.
fn frames_of<'a>(colors: &'a TimedFiles, depths: &'a TimedFiles) -> Vec<&'a TimedFile> {
    let step = |files: &TimedFiles| {
        usual_step(&files.files.iter().map(|file| file.time).collect::<Vec<_>>()).unwrap_or(0.0)
    };
    // Lost files change the number or the usual step, hardly both.
    let is_sparser = |one: &TimedFiles, other: &TimedFiles| {
        let n = [one, other].map(|files| files.files.len() as f64);
        SPARSER * n[0] < n[1] && step(one) > SPARSER * step(other)
    };
    if is_sparser(colors, depths) {
        return colors.files.iter().collect();
    }
    let needs_depth = !is_sparser(depths, colors);
    let is_bare = |file: &&TimedFile| needs_depth && depths.nearest(file.time).is_err();
    depths.files.iter().chain(colors.files.iter().filter(is_bare)).collect()
}

fn timed_files(
    recording: &mut Recording,
    name: &str,
    extensions: &[&str],
) -> Result<TimedFiles, DatasetError> {
    let folder = recording.folder;
    let (relative, path) = (Path::new(name), folder.path.join(name));
    let listing = folder.list(relative).map_err(|problem| {
        metadata_error(&path, "a folder of files", problem.to_string(), "restore it")
    })?;
    let is_ours = |name: &&str| {
        let extension = name.rsplit_once('.').map(|(_, end)| end);
        extension.is_some_and(|end| extensions.iter().any(|e| e.eq_ignore_ascii_case(end)))
    };
    let mut found = Vec::new();
    for name in listing.files().filter(is_ours) {
        let Some(time) = time(name) else { continue };
        match folder.file(relative, &listing, name) {
            Ok(path) => found.push(TimedFile { time, name: name.to_owned(), path }),
            Err(problem) => recording.skip(name, path.join(name), problem),
        }
    }
    found.sort_by(|a, b| a.time.total_cmp(&b.time));
    Ok(TimedFiles::new(without_twins(recording, found, &path)))
}

fn world_to_camera(recording: &mut Recording, root: &str) -> Result<Trajectory, DatasetError> {
    let folder = recording.folder;
    let listing = folder.list_if_any(root);
    let name = listing.iter().flat_map(|l| l.files()).find(|name| name.ends_with(".traj"));
    let Some(name) = name.map(|name| format!("{root}{name}")) else {
        let expected = "poses, lines of time, axis times angle and translation";
        let file = folder.path.join(format!("{root}lowres_wide.traj"));
        return Err(no_poses(&file, expected, "no such file"));
    };
    let (file, text) = folder.lines(&name)?;
    let mut poses = Vec::new();
    for (line, content) in lines(&text) {
        match matrix::parse_numbers::<7>(content).ok().filter(|n| n.iter().all(|n| n.is_finite())) {
            Some([time, a, b, c, x, y, z]) => {
                let turn = DQuat::from_scaled_axis(DVec3::new(a, b, c));
                let matrix = DMat4::from_rotation_translation(turn, DVec3::new(x, y, z)).inverse();
                poses.push(TimedPose::from_matrix(time, matrix));
            }
            None => {
                let expected = "seven finite numbers: time, axis times angle, translation";
                recording.skip_line(&file, line, expected, content);
            }
        }
    }
    Ok(sorted_trajectory(recording, &name, poses).between_sparse_poses())
}

const SCANNET_PP_ROOTS: [&str; 2] = ["iphone/", ""];
const SCANNET_PP_LIST: &str = "pose_intrinsic_imu.json";

fn scannet_pp_root(folder: &Folder) -> Option<&'static str> {
    SCANNET_PP_ROOTS
        .into_iter()
        .find(|root| folder.peek(&format!("{root}{SCANNET_PP_LIST}")).contains("\"intrinsic\""))
}

fn recognise_scannet_pp(folder: &Folder) -> Option<String> {
    let root = scannet_pp_root(folder)?;
    Some(format!("{root}{SCANNET_PP_LIST} with `intrinsic` of frames"))
}

fn parse_scannet_pp(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let root = scannet_pp_root(folder).unwrap_or_default();
    let [colors, depths, maps] = ["rgb", "depth", "confidence"].map(|name| format!("{root}{name}"));
    if !folder.has_folder(&colors) || !folder.has_folder(&depths) {
        let expected = "photographs in rgb/ and depth images in depth/";
        let found = "not both, as in a set that is still packed (rgb.mkv, depth.bin)".to_owned();
        let hint = "unpack it with the set's toolkit: python -m iphone.prepare_iphone_data iphone/configs/prepare_iphone_data.yml";
        return Err(metadata_error(&folder.path.join(root), expected, found, hint));
    }
    let places = [(&*colors, "frame"), (&*depths, "frame"), (&*maps, "frame")];
    let images = NumberedImages::list(&mut recording, places)?;
    let (file, text) = folder.text(&format!("{root}{SCANNET_PP_LIST}"))?;
    let Entries(entries) =
        parse_json(&text).map_err(|source| DatasetError::Json { file: file.clone(), source })?;
    let is_aligned =
        entries.iter().any(|(_, e)| e.get("aligned_pose").is_some_and(|pose| !pose.is_null()));
    if !is_aligned && !options.track {
        recording.note("no frame has an `aligned_pose`: ARKit's own `pose` is used");
    }
    let mut numbers = NumberedFiles::union(&[&images.colors]);
    numbers.extend(images.bare_depths());
    let (mut listed, mut n_bare) = (BTreeMap::new(), 0);
    for (name, entry) in &entries {
        let Some(number) = number_in_name(name) else { continue };
        n_bare += usize::from(!numbers.contains(&number));
        match listed.contains_key(&number) {
            true => {
                let problem = FrameProblem::Duplicate(format!("another entry of `{name}`"));
                recording.skip(name, file.clone(), problem);
            }
            false => drop(listed.insert(number, entry)),
        }
    }
    if n_bare > 0 {
        recording.note(format!("{n_bare} of {} listed frames have no images", entries.len()));
    }
    let mut unused = BTreeSet::new();
    for entry in listed.values() {
        unused_keys(entry, &["intrinsic", "timestamp"], &mut unused);
    }
    name_keys(&mut recording.parsed, &file, &unused);
    let named = numbers.into_iter().map(|number| (images.name(number), number));
    add_frames(&mut recording, named, &file, |_, number| {
        let images = images.of(folder, number)?;
        let missing = || wrong_entry("an entry for this frame", &Value::Null);
        let entry: &Value = listed.get(&number).copied().ok_or_else(missing)?;
        let pose = options.pose(|| match is_aligned {
            true => Ok(Pose::from_opencv(arkit::matrix(entry.get("aligned_pose"))?)?),
            false => Ok(Pose::from_opengl(arkit::matrix(entry.get("pose"))?)?),
        })?;
        let wrong = || wrong_entry("`intrinsic`, nine numbers of a camera matrix", entry);
        let intrinsics = camera_matrix(entry, "intrinsic").ok_or_else(wrong)?;
        let time = entry.get("timestamp").and_then(Value::as_f64);
        Ok((images, StatedCamera { file: file.clone(), intrinsics, size: None, pose, time }))
    });
    Ok(recording.finish())
}
