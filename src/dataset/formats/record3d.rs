//! Record3D, an app for iPhones: its `.r3d` archives and its exported folders.
//!
//! Both contain `metadata`, one JSON object. `K` is nine numbers by columns, for images of the photograph's
//! size; `poses` has one `qx qy qz qw tx ty tz` per frame, camera to world in OpenGL axes. The archive
//! contains `rgbd/N.jpg`, `rgbd/N.depth` (32-bit floats in metres, LZFSE-compressed) and `rgbd/N.conf` (0 to
//! 2); the folder contains `rgb/N.jpg` and `depth/N.exr`. `perFrameIntrinsicCoeffs` (`fx fy cx cy`) are the
//! intrinsics of each frame, which autofocus changes.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    Cameras, LIDAR_RANGE, Recording, encoding, frame_entry, metadata_error, no_poses, same_size,
};
use super::stated::parse_json;
use super::trajectory::TimedPose;
use super::{recording, stated};
use crate::dataset::archive::{Archive, MAX_MEMBERS};
use crate::dataset::bag::is_bag;
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::FrameEntry;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, relative_path};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::lengths;
use crate::dataset::matrix::describe_json;
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

struct Metadata {
    file: PathBuf,
    json: Value,
}

/// Keys that have an effect.
const USED: [&str; 6] = ["K", "w", "h", "fps", "frameTimestamps", "perFrameIntrinsicCoeffs"];
/// Largest number of depth files of which the floats are counted until one can be read.
const MOST_COUNTED: usize = 4;

struct FrameSources {
    color: ByteSource,
    depth: Option<ByteSource>,
    confidence: Option<ByteSource>,
}

impl Metadata {
    fn is_one(text: &str) -> bool {
        // The front camera has no poses.
        let is_ours = |json: Value| {
            json.get("K").is_some() && ["poses", "fps"].iter().any(|key| json.get(key).is_some())
        };
        parse_json(text).is_ok_and(is_ours)
    }

    fn new(file: PathBuf, text: &str) -> Result<Self, DatasetError> {
        match parse_json(text) {
            Ok(json) => Ok(Self { file, json }),
            Err(source) => Err(DatasetError::Json { file, source }),
        }
    }

    fn record(
        &self,
        recording: &mut Recording,
        frames: &BTreeMap<u64, FrameSources>,
        codes: CodeKind,
    ) -> Result<(), DatasetError> {
        let size = recording::photograph_size(frames.values().map(|frame| &frame.color));
        let Some(size) = recording.warn_unreadable(size) else { return Ok(()) };
        let k = self.intrinsics(size)?;
        let depth_size = self.depth_size(frames, codes, size)?;
        // Files that state their size need none.
        let is_used = self.size("dw", "dh").is_none_or(|stated| stated == depth_size);
        let sizes: &[&str] = if is_used { &["dw", "dh"] } else { &[] };
        stated::name_unused_keys(recording, &self.file, &self.json, &[&USED[..], sizes].concat());
        let poses = stated::array(&self.json, "poses");
        let is_tracked = recording.options.track;
        if poses.is_empty() && !is_tracked {
            let found = "none, as the front camera records them";
            return Err(no_poses(&self.file, "`poses`, one for each frame", found));
        }
        // No error: only the frames without a pose are skipped below.
        if poses.len() < frames.len() && !is_tracked {
            let (listed, found) = (poses.len(), frames.len());
            recording
                .note(format!("expected a pose for each of {found} frames, found {listed} poses"));
        }
        let encoding = encoding(recording.options, codes, Sensor::Lidar, LIDAR_RANGE);
        for (&number, frame) in frames {
            // A number beyond any index has no pose, so its frame is skipped.
            let index = usize::try_from(number).unwrap_or(usize::MAX);
            let name = number.to_string();
            let pose = match recording.options.pose(|| pose(poses.get(index), index)) {
                Ok(pose) => pose,
                Err(problem) => {
                    recording.skip(&name, self.file.clone(), problem);
                    continue;
                }
            };
            let cameras = self.cameras(recording, index, &k, depth_size)?;
            let depth = frame.depth.clone().map(|file| {
                recording.depth_with_confidence(file, encoding, frame.confidence.clone())
            });
            let recorded = frame_entry(name, pose, cameras, frame.color.clone(), depth);
            recording.frames.push(FrameEntry { time: self.time(index), ..recorded });
        }
        Ok(())
    }

    fn size(&self, width: &str, height: &str) -> Option<(u32, u32)> {
        stated::side(&self.json, &[width]).zip(stated::side(&self.json, &[height]))
    }

    fn intrinsics(&self, size: (u32, u32)) -> Result<Intrinsics, DatasetError> {
        if let Some(stated) = self.size("w", "h") {
            same_size(stated, size, &self.file)?;
        }
        let k = self.json.get("K").and_then(|k| stated::from_json(k, size));
        k.ok_or_else(|| {
            let expected = "`K`, nine numbers of a camera matrix by columns";
            let found = self.json.get("K").map_or("no `K`".to_owned(), describe_json);
            metadata_error(&self.file, expected, found, "export the recording again")
        })
    }

    /// Returns the cameras of a frame, from the frame's own intrinsics if listed, else from those common
    /// to all frames.
    fn cameras(
        &self,
        recording: &Recording,
        index: usize,
        all: &Intrinsics,
        depth_size: (u32, u32),
    ) -> Result<Cameras, DatasetError> {
        let size = (all.width, all.height);
        let own = stated::array(&self.json, "perFrameIntrinsicCoeffs").get(index);
        let own = own.and_then(|value| stated::flat_numbers(value)?.try_into().ok());
        let own = own.map(|[fx, fy, cx, cy]: [f64; 4]| Intrinsics { fx, fy, cx, cy, ..*all });
        // Some versions of the app fill the list with zeros.
        let k = own.filter(|k| k.fx > 0.0 && k.fy > 0.0).unwrap_or(*all);
        recording.cameras_of_lens(&k, size, depth_size, &self.file)
    }

    /// Returns the size of the depth images: from the files if they state it, else from the keys `dw`
    /// and `dh`.
    fn depth_size(
        &self,
        frames: &BTreeMap<u64, FrameSources>,
        codes: CodeKind,
        color: (u32, u32),
    ) -> Result<(u32, u32), DatasetError> {
        if codes != CodeKind::BareFloats {
            let depths = frames.values().filter_map(|frame| frame.depth.as_ref());
            // Unreadable files are reported with their frames.
            return Ok(recording::depth_size(depths).ok().flatten().unwrap_or(color));
        }
        if let Some(stated) = self.size("dw", "dh") {
            return Ok(stated);
        }
        // Old versions of the app do not state the size: the floats of a frame are counted.
        let depths = frames.values().filter_map(|frame| frame.depth.as_ref());
        let counted = depths.take(MOST_COUNTED).find_map(|depth| {
            let bytes = lengths::unpacked_bytes(&depth.read().ok()?)?;
            lengths::size_of_floats(bytes, color)
        });
        // Without a readable file, the size of the app's lidar.
        Ok(counted.unwrap_or(if color.0 < color.1 { (192, 256) } else { (256, 192) }))
    }

    fn time(&self, index: usize) -> Option<f64> {
        let stamp = stated::array(&self.json, "frameTimestamps").get(index).and_then(Value::as_f64);
        let fps = self.json.get("fps").and_then(Value::as_f64).filter(|fps| *fps > 0.0);
        stamp.or_else(|| Some(index as f64 / fps?)).filter(|time| time.is_finite())
    }
}

fn pose(value: Option<&Value>, index: usize) -> Result<Pose, FrameProblem> {
    let value = value.ok_or_else(|| FrameProblem::MissingPose(format!("{index} of `poses`")))?;
    let expected = "a pose qx qy qz qw tx ty tz of finite numbers, a unit quaternion first";
    let wrong = || FrameProblem::Entry { expected, found: describe_json(value) };
    let numbers = stated::flat_numbers(value).ok_or_else(wrong)?;
    let Ok([qx, qy, qz, qw, x, y, z]) = <[f64; 7]>::try_from(numbers) else { return Err(wrong()) };
    // This file has the rotation first, `TimedPose` has the position first.
    let timed = TimedPose::new([0.0, x, y, z, qx, qy, qz, qw]).ok_or_else(wrong)?;
    Ok(Pose::from_opengl(timed.matrix())?)
}

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opengl, recognise, parse };

const METADATA: [&str; 2] = ["metadata", "metadata.json"];
const FRAMES: &str = "rgbd/";

fn recognise(folder: &Folder) -> Option<String> {
    let name = archive_name(folder)?;
    Some(format!("the archive {name} with `metadata` of `K` and `poses`"))
}

/// Returns the name of the opened archive, even if it is damaged, or of the only archive of this layout
/// in the dataset folder. Several archives yield `None`, as does the archive of another program.
fn archive_name(folder: &Folder) -> Option<&str> {
    if let Some(name) = folder.opened_archive() {
        let path = folder.path.join(name);
        let lacks_metadata = |archive: Archive| {
            !archive.names().iter().any(|name| METADATA.contains(&name.as_str()))
        };
        let is_other = || !name.ends_with(".r3d") && Archive::open(&path).is_ok_and(lacks_metadata);
        return (!is_bag(&path).unwrap_or(false) && !is_other()).then_some(name);
    }
    let is_ours = |name: &&str| {
        is_recording(folder, name).unwrap_or_else(|problem| {
            folder.record_unread(name, problem);
            false
        })
    };
    let mut ours = folder.listing.files().filter(|name| name.ends_with(".r3d")).filter(is_ours);
    let first = ours.next();
    // Two recordings are two scenes: the user has to choose one.
    first.filter(|_| ours.next().is_none())
}

fn is_recording(folder: &Folder, name: &str) -> Result<bool, FrameProblem> {
    let path = folder.file(Path::new(""), &folder.listing, name)?;
    if !Archive::is_zip_archive(&path)? {
        return Ok(false);
    }
    let archive = Archive::open(&path)?;
    let names = archive.names();
    for name in METADATA.into_iter().filter(|name| names.iter().any(|n| n == name)) {
        if Metadata::is_one(&archive.read_text(name)?) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let path = folder.path.join(archive_name(folder).unwrap_or_default());
    let damaged = |problem: FrameProblem| match problem {
        FrameProblem::Read(source) => DatasetError::Read { path: path.clone(), source },
        FrameProblem::ArchiveMembers => {
            let expected = format!("at most {MAX_MEMBERS} members");
            metadata_error(&path, &expected, "more".to_owned(), "record shorter pieces")
        }
        other => {
            let expected = "a recording shared by Record3D";
            metadata_error(&path, expected, other.to_string(), "share the recording again")
        }
    };
    let archive = Archive::open(&path).map_err(damaged)?;
    let archive = Arc::new(archive);
    // Sorted, because an archive lists its members in any order.
    let names: BTreeSet<String> = archive.names().into_iter().collect();
    for name in names.iter().filter(|name| relative_path(name).is_err()) {
        recording.skip(name, path.clone(), FrameProblem::OutsideFolder(name.clone()));
    }
    let Some(name) = METADATA.into_iter().find(|name| names.contains(*name)) else {
        let found = format!("{} members, none of that name", names.len());
        let hint = "share the recording again";
        return Err(metadata_error(&path, "a member `metadata`", found, hint));
    };
    let text = archive.read_text(name).map_err(damaged)?;
    let metadata = Metadata::new(path.join(name), &text)?;
    let member = |name: String| names.contains(&name).then(|| ByteSource::member(&archive, &name));
    let mut frames = BTreeMap::new();
    for name in &names {
        // Photographs define the frames, so depth without one would vanish silently.
        let alone = name.strip_prefix(FRAMES).and_then(|n| n.strip_suffix(".depth"));
        if let Some(stem) = alone.filter(|stem| !names.contains(&format!("{FRAMES}{stem}.jpg"))) {
            let problem = FrameProblem::MissingColor(format!("{FRAMES}{stem}.jpg"));
            recording.skip(stem, path.clone(), problem);
        }
        let Some(stem) = name.strip_prefix(FRAMES).and_then(|n| n.strip_suffix(".jpg")) else {
            continue;
        };
        let Ok(number) = stem.parse::<u64>() else { continue };
        let sources = FrameSources {
            color: ByteSource::member(&archive, name),
            depth: member(format!("{FRAMES}{stem}.depth")),
            confidence: member(format!("{FRAMES}{stem}.conf")),
        };
        // `1.jpg` and `01.jpg` have the same number.
        match frames.contains_key(&number) {
            true => {
                let problem = FrameProblem::Duplicate(format!("`{name}`"));
                recording.skip(stem, path.clone(), problem);
            }
            false => drop(frames.insert(number, sources)),
        }
    }
    metadata.record(&mut recording, &frames, CodeKind::BareFloats)?;
    Ok(recording.finish())
}

pub(super) const FOLDER: DatasetFormat = DatasetFormat {
    poses: PoseConvention::Opengl,
    recognise: recognise_folder,
    parse: parse_folder,
};

const FOLDER_METADATA: [&str; 2] = ["metadata.json", "metadata"];
const COLORS: &str = "rgb";
const DEPTHS: &str = "depth";
const CONFIDENCES: [&str; 2] = ["confidence", "conf"];

fn recognise_folder(folder: &Folder) -> Option<String> {
    let name = metadata(folder)?;
    let is_ours = folder.has_folder(COLORS);
    is_ours.then(|| format!("{name} with `K` and `poses`, and images in {COLORS}/"))
}

fn metadata(folder: &Folder) -> Option<&'static str> {
    FOLDER_METADATA
        .into_iter()
        .find(|name| folder.listing.has_file(name) && Metadata::is_one(&folder.peek_whole(name)))
}

fn parse_folder(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let (file, text) = folder.text(metadata(folder).unwrap_or(FOLDER_METADATA[0]))?;
    let metadata = Metadata::new(file, &text)?;
    let colors = recording.list(COLORS, "", &PHOTOGRAPHS)?;
    let depths = recording.list_optional(DEPTHS, &["exr", "png", "tiff", "tif", "npy"])?;
    let name = CONFIDENCES.into_iter().find(|name| folder.has_folder(name));
    let confidences = recording.list_optional(name.unwrap_or_default(), &["png", "conf", "bin"])?;
    let mut frames = BTreeMap::new();
    let lists: Vec<&NumberedFiles> = [&colors].into_iter().chain(&depths).collect();
    let taken = |number: &u64| folder.was_taken(&number.to_string());
    for number in NumberedFiles::union(&lists).into_iter().filter(|number| !taken(number)) {
        match sources(folder, [Some(&colors), depths.as_ref(), confidences.as_ref()], number) {
            Ok(sources) => drop(frames.insert(number, sources)),
            Err(problem) => {
                recording.skip(&number.to_string(), folder.path.join(COLORS), problem);
            }
        }
    }
    // By name: the unit must not depend on whether a file can be read.
    let is_codes = depths
        .as_ref()
        .is_some_and(|d| d.numbers().next().is_some_and(|n| d.has_extension(n, "png")));
    // Float files are in metres.
    let unit = CodeKind::ByContent(if is_codes { MILLIMETRE } else { 1.0 });
    metadata.record(&mut recording, &frames, unit)?;
    Ok(recording.finish())
}

fn sources(
    folder: &Folder,
    [colors, depths, confidences]: [Option<&NumberedFiles>; 3],
    number: u64,
) -> Result<FrameSources, FrameProblem> {
    let file = |files: Option<&NumberedFiles>| {
        files.and_then(|files| files.file(folder, number)).transpose()
    };
    let missing = || {
        FrameProblem::MissingColor(Path::new(COLORS).join(number.to_string()).display().to_string())
    };
    let confidence = file(confidences)?;
    // While the recording grows, a missing map may still be written; afterwards there is none.
    if folder.is_growing() && confidences.is_some() && confidence.is_none() {
        return Err(FrameProblem::MissingConfidence(number.to_string()));
    }
    Ok(FrameSources {
        color: file(colors)?.ok_or_else(missing)?.into(),
        depth: file(depths)?.map(Into::into),
        confidence: confidence.map(Into::into),
    })
}
