//! nerfstudio: `transforms*.json` whose frames name depth files (`depth_file_path`, or `depth_path` in
//! NeRFCapture) or have cameras of their own; OpenGL axes. Every list of a folder is a split; lists of
//! file names (`train_filenames`) divide a list.
//!
//! Every camera parameter (`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1`, `k2`, `k3`, `p1`, `p2`, or
//! `distortion_params`) is given in the frame or, for all frames, at the top level. Depth along the optical
//! axis is the stored value times `depth_unit_scale_factor` (NeRFCapture: `integer_depth_scale`), by default
//! 0.001, and times `applied_scale`. Black pixels of the image `mask_path` are left out.

use super::numbered::PHOTOGRAPHS;
use super::recording::{
    ANY_RANGE, Recording, SPLIT, encoding, frame_entry, metadata_error, same_size,
};
use super::stated::{
    FrameCamera, LENS_TERMS, array, camera_keys, check_model, entry_name, first_of, flat_numbers,
    frame_lists, majority, name_keys, read_list, split_name, unused_keys,
};
use crate::dataset::decode;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DepthSource, FrameEntry, HELD_OUT, MaskSource};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, is_file};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix::{describe_json, from_json};
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::{BTreeSet, HashMap, HashSet};
use std::path::Path;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opengl, recognise, parse };

/// Names of splits that file names and keys of lists may state.
const SPLIT_NAMES: [&str; 4] = ["train", "val", "eval", "test"];
const DEPTH_KEYS: [&str; 2] = ["depth_file_path", "depth_path"];
// `k4` is refused on opening, but marks a list of this layout.
const LENS_KEYS: [&str; 6] = ["k1", "k2", "k3", "k4", "p1", "p2"];

/// Key of a list of all lens terms.
const TERM_LIST: &str = "distortion_params";
/// Key of a frame's pose.
const POSE: &str = "transform_matrix";
/// Keys of the unit of depth.
const UNITS: [&str; 2] = ["depth_unit_scale_factor", "integer_depth_scale"];

fn recognise(folder: &Folder) -> Option<String> {
    let names = lists(folder).join(", ");
    let why = || format!("{names} with frames that name depth files or have cameras of their own");
    (!names.is_empty()).then(why)
}

/// Returns the names of all frame lists of a folder, if one of them shows the layout.
fn lists(folder: &Folder) -> Vec<&str> {
    // One list decides for all: the lists for evaluation may lack depth.
    let mut is_any = false;
    let named = frame_lists(folder).filter_map(|(name, json)| {
        is_any = is_any || is_list(&json);
        // Damaged lists remain, and are reported.
        (json.is_null() || !array(&json, "frames").is_empty()).then_some(name)
    });
    let names = named.collect();
    if is_any { names } else { Vec::new() }
}

/// True for frame lists of the nerfstudio layout, false for those of NeRF-synthetic.
pub(super) fn is_list(json: &Value) -> bool {
    let frames = array(json, "frames");
    let named = |keys: &[&str], frame: &Value| keys.iter().any(|key| frame.get(key).is_some());
    let bends = |value: &Value| {
        LENS_KEYS.iter().any(|key| value.get(key).and_then(Value::as_f64).unwrap_or(0.0) != 0.0)
    };
    // NeRF-synthetic has no lens terms.
    let lens = bends(json) || frames.iter().any(bends);
    let is_posed = frames.iter().any(|frame| frame.get(POSE).is_some());
    let own = |frame: &Value| named(&DEPTH_KEYS, frame) || has_own_camera(frame);
    is_posed && (lens || frames.iter().any(own))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut parsed = ParsedFolder::default();
    let names = lists(folder);
    for name in &names {
        let (file, mut json) = read_list(folder, name)?;
        // Apart from the list, since each is dropped once it is read.
        let frames = json.get_mut("frames").map(Value::take);
        let Some(Value::Array(frames)) = frames else { continue };
        let list = FrameList { json: &json, file: &file };
        let own = split_name(name);
        let is_split = names.len() > 1 || SPLIT_NAMES.contains(&own);
        for (split, frames) in list.splits(frames, if is_split { own } else { SPLIT }, &mut parsed)
        {
            // Two lists of one name are two splits.
            let is_taken = parsed.splits.iter().any(|other| other.name == split);
            let split = if is_taken { format!("{split} of {name}") } else { split.to_owned() };
            let mut recording = Recording { split, ..Recording::new(folder, options) };
            list.name_unused_keys(&frames, &mut recording);
            list.record(frames, &mut recording)?;
            parsed.append(recording.finish());
        }
    }
    // Splits of one list name its keys again.
    parsed.unused.dedup();
    if names.len() > 1 {
        parsed.splits.retain(|split| split.name != HELD_OUT);
    }
    Ok(parsed)
}

/// Name and content of an entry of `frames`.
type Entry = (String, Value);
type Size = (u32, u32);

/// Files and pose of an entry, and the size of its photograph.
struct Listed {
    pose: Pose,
    color: ByteSource,
    depth: Option<ByteSource>,
    mask: Option<MaskSource>,
    size: Size,
}

fn has_own_camera(frame: &Value) -> bool {
    first_of(frame, &["fl_x", "w", "camera_angle_x"]).is_some()
}

struct FrameList<'a> {
    json: &'a Value,
    file: &'a Path,
}

impl<'a> FrameList<'a> {
    fn camera<'b>(&'b self, frame: &'b Value) -> FrameCamera<'b> {
        FrameCamera { frame, list: self.json, file: self.file }
    }

    /// Divides the frames by the lists of file names in `train_filenames` and so on. Without these, all
    /// frames are of the split `whole`.
    fn splits(
        &self,
        frames: Vec<Value>,
        whole: &'a str,
        parsed: &mut ParsedFolder,
    ) -> Vec<(&'a str, Vec<Entry>)> {
        let frames = frames.into_iter().enumerate();
        let mut frames: Vec<_> = frames.map(|(i, f)| (entry_name(&f, i), f)).collect();
        let mut splits = Vec::new();
        for split in SPLIT_NAMES {
            let names = array(self.json, &format!("{split}_filenames")).iter();
            let names = names.filter_map(|name| Some(name.as_str()?.trim_start_matches("./")));
            let names: HashSet<&str> = names.collect();
            let (of_split, others) = frames
                .into_iter()
                .partition::<Vec<_>, _>(|(name, _)| names.contains(name.as_str()));
            frames = others;
            if !of_split.is_empty() {
                splits.push((split, of_split));
            }
        }
        match (splits.is_empty(), frames.len()) {
            (true, _) => splits.push((whole, frames)),
            (false, 0) => {}
            (false, n) => {
                let name = self.file.file_name().unwrap_or_default().display();
                let said = format!("{name}: {n} frames are in no list of file names; left out");
                parsed.notes.push(said);
            }
        }
        splits
    }

    fn name_unused_keys(&self, entries: &[Entry], recording: &mut Recording) {
        let frames = || entries.iter().map(|(_, frame)| frame);
        let is_stated = |key: &str| frames().chain([self.json]).any(|o| o.get(key).is_some());
        // A list of terms replaces single ones, as the first of two units the other.
        let terms = if is_stated(TERM_LIST) { &[TERM_LIST][..] } else { &LENS_TERMS };
        let unit = UNITS.into_iter().find(|key| is_stated(key));
        let mut used = camera_keys();
        used.extend(terms);
        used.extend(unit);
        used.push("applied_scale");
        let mut found = BTreeSet::new();
        unused_keys(self.json, &used, &mut found);
        used.push("timestamp");
        frames().for_each(|frame| unused_keys(frame, &used, &mut found));
        name_keys(&mut recording.parsed, self.file, &found);
    }

    fn record(&self, entries: Vec<Entry>, recording: &mut Recording) -> Result<(), DatasetError> {
        let most_color = self.photograph_size(recording.folder, &entries)?;
        let mut seen = HashSet::new();
        let is_first: Vec<bool> = entries.iter().map(|(name, _)| seen.insert(name)).collect();
        let mut found = Vec::new();
        for ((name, mut frame), is_first) in entries.into_iter().zip(is_first) {
            if recording.folder.was_taken(&name) {
                continue;
            }
            let listed = match is_first {
                true => self.listed(&frame, &name, recording),
                false => Err(FrameProblem::Duplicate(format!("another entry `{name}`"))),
            };
            match listed {
                Ok(listed) => {
                    // Half of the frame's memory.
                    if let Some(keys) = frame.as_object_mut() {
                        keys.remove(POSE);
                    }
                    found.push((name, frame, listed));
                }
                Err(problem) => recording.skip(&name, self.file.to_owned(), problem),
            }
        }
        // Photographs of one size have depth of one size.
        let mut depths: HashMap<Size, Vec<&ByteSource>> = HashMap::new();
        for (_, _, Listed { size, depth, .. }) in &found {
            depths.entry(*size).or_default().extend(depth);
        }
        // Unreadable files are reported when their frames are loaded.
        let depth_size =
            |files: &[&ByteSource]| majority(files, |file| decode::depth_size(file)).ok().flatten();
        let depths: HashMap<Size, Option<Size>> =
            depths.iter().map(|(size, files)| (*size, depth_size(files))).collect();
        let mut refused = None;
        for (name, json, listed) in found {
            let depth = depths.get(&listed.size).copied().flatten();
            let frame = self.frame(&name, &json, listed, recording, [most_color, depth]);
            let frame = frame.unwrap_or_else(|error| {
                let problem = error.of_frame();
                refused.get_or_insert(error);
                Err(problem)
            });
            recording.add(&name, self.file, frame);
        }
        // What makes every frame unusable is of the list.
        match refused.filter(|_| recording.frames.is_empty()) {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }

    /// Returns the most frequent size of photographs, to which intrinsics common to all frames refer.
    ///
    /// # Errors
    /// Fails if most photographs differ from the size that the list states.
    fn photograph_size(
        &self,
        folder: &Folder,
        entries: &[Entry],
    ) -> Result<Option<Size>, DatasetError> {
        let size = majority(entries, |(name, frame)| {
            self.upright_size(frame, &photograph(folder, name)?, folder)
        });
        // Unreadable files are reported with their frames.
        let size = size.ok().flatten();
        if let Some(size) = size.filter(|_| !entries.iter().any(|(_, f)| has_own_camera(f))) {
            same_size(self.camera(&Value::Null).size(size)?, size, self.file)?;
        }
        Ok(size)
    }

    /// Returns the size of a photograph: turned by its EXIF orientation if the list states that size, or
    /// no size and depth has that shape.
    fn upright_size(
        &self,
        frame: &Value,
        color: &ByteSource,
        folder: &Folder,
    ) -> Result<Size, FrameProblem> {
        let header = decode::header(color)?;
        let (stored, upright) = ((header.width, header.height), header.upright());
        if stored == upright {
            return Ok(stored);
        }
        let camera = self.camera(frame);
        let is_wide = |(width, height): Size| width > height;
        // A wrong size of the list is reported with the camera.
        let stated = camera.size(stored).ok().filter(|_| camera.states_size());
        let is_turned = match (stated, depth_of(frame, folder)?) {
            (Some(stated), _) => stated == upright,
            (None, Some(depth)) => is_wide(decode::depth_size(&depth)?) == is_wide(upright),
            (None, None) => false,
        };
        Ok(if is_turned { upright } else { stored })
    }

    fn listed(
        &self,
        frame: &Value,
        name: &str,
        recording: &Recording,
    ) -> Result<Listed, FrameProblem> {
        let folder = recording.folder;
        let matrix = || from_json(frame.get(POSE));
        let pose = recording.options.pose(|| Ok(Pose::from_opengl(matrix()?)?))?;
        let color = photograph(folder, name)?;
        let depth = depth_of(frame, folder)?;
        let mask = frame.get("mask_path").and_then(Value::as_str).map(|text| {
            let file = file_of(folder, std::iter::once(text.to_owned()))?;
            let file = file.ok_or_else(|| FrameProblem::MissingMask(text.to_owned()))?;
            Ok::<_, FrameProblem>(MaskSource { file, hides_black: true })
        });
        let mask = mask.transpose()?;
        // The frame's own size: images of one list may differ.
        let size = self.upright_size(frame, &color, folder)?;
        Ok(Listed { pose, color, depth, mask, size })
    }

    fn encoding(
        &self,
        frame: &Value,
        options: &LoadOptions,
    ) -> Result<DepthEncoding, DatasetError> {
        let positive = |key: &str| match self.camera(frame).number(key)? {
            Some(stated) if stated <= 0.0 => {
                let expected = format!("a positive `{key}`, world units per unit");
                let hint = "correct the value";
                Err(metadata_error(self.file, &expected, stated.to_string(), hint))
            }
            stated => Ok(stated),
        };
        let [first, other] = UNITS.map(positive);
        let unit = first?.map_or(other, |unit| Ok(Some(unit)))?;
        // Poses were multiplied by it, depth files were not.
        let scale = positive("applied_scale")?.unwrap_or(1.0);
        let codes = CodeKind::ByContent(unit.unwrap_or(MILLIMETRE) * scale);
        // World units are arbitrary, so no length is beyond the sensor.
        let encoding = encoding(options, codes, Sensor::Lidar, ANY_RANGE);
        let is_given = options.depth_scale.is_some() && options.depth_range.is_some();
        let units_per_metre = if is_given { encoding.units_per_metre } else { scale };
        Ok(DepthEncoding { units_per_metre, ..encoding })
    }

    /// Creates the frame of an entry. The sizes are those of most photographs, and of most depth images
    /// of photographs of this size. The outer error concerns the camera.
    fn frame(
        &self,
        name: &str,
        frame: &Value,
        listed: Listed,
        recording: &Recording,
        [most_color, most_depth]: [Option<Size>; 2],
    ) -> Result<Result<FrameEntry, FrameProblem>, DatasetError> {
        let Listed { pose, color, depth, mask, size } = listed;
        // Focal lengths refer to one image size; an image of another size affects its own frame only.
        let most = if has_own_camera(frame) { size } else { most_color.unwrap_or(size) };
        let camera = self.camera(frame);
        let expected = camera.size(most)?;
        if size != expected {
            return Ok(Err(FrameProblem::Size { what: "an image", expected, found: size }));
        }
        check_model(&camera)?;
        let k = camera.intrinsics(size)?;
        let cameras = recording.cameras_of_lens(&k, size, most_depth.unwrap_or(size), self.file)?;
        let encoding = self.encoding(frame, recording.options)?;
        let depth = depth.map(|file| DepthSource::new(file, encoding));
        // Only a time of the frame itself: `number` would fall back to one of the list.
        let time = match frame.get("timestamp") {
            Some(_) => camera.number("timestamp")?,
            None => None,
        };
        let cameras = cameras.with_lens(self.lens(&camera)?, self.file)?;
        let mut entry = frame_entry(name.to_owned(), pose, cameras, color, depth);
        entry.add_mask(mask);
        Ok(Ok(FrameEntry { time, ..entry }))
    }

    /// Returns the lens, stated term by term or as the list `distortion_params` of k1 k2 k3 k4 p1 p2.
    fn lens(&self, camera: &FrameCamera) -> Result<Distortion, DatasetError> {
        let term = |key: &str| Ok::<_, DatasetError>(camera.number(key)?.unwrap_or(0.0));
        let listed = camera.frame.get(TERM_LIST).or_else(|| self.json.get(TERM_LIST));
        let [k1, k2, k3, p1, p2] = match listed {
            None => [term("k1")?, term("k2")?, term("k3")?, term("p1")?, term("p2")?],
            Some(listed) => match flat_numbers(listed).as_deref() {
                Some(&[k1, k2, k3, 0.0, p1, p2]) => [k1, k2, k3, p1, p2],
                _ => {
                    let expected = "`distortion_params` of k1, k2, k3, 0, p1, p2";
                    let hint = "undistort the images to a pinhole first";
                    return Err(metadata_error(self.file, expected, describe_json(listed), hint));
                }
            },
        };
        let radial = [k1, k2, k3, 0.0, 0.0, 0.0];
        Ok(Distortion { radial, tangential: [p1, p2], ..Distortion::default() })
    }
}

/// Finds the photograph `name`, which may lack the extension.
fn photograph(folder: &Folder, name: &str) -> Result<ByteSource, FrameProblem> {
    let with = PHOTOGRAPHS.iter().map(|extension| format!("{name}.{extension}"));
    file_of(folder, std::iter::once(name.to_owned()).chain(with))?
        .ok_or_else(|| FrameProblem::MissingColor(name.to_owned()))
}

fn depth_of(frame: &Value, folder: &Folder) -> Result<Option<ByteSource>, FrameProblem> {
    let Some(name) = first_of(frame, &DEPTH_KEYS).and_then(Value::as_str) else { return Ok(None) };
    let names = [name.to_owned(), format!("{name}.png")];
    let missing = || FrameProblem::MissingDepth(name.to_owned());
    file_of(folder, names.into_iter())?.ok_or_else(missing).map(Some)
}

/// Finds the first of the names that is a file.
pub(super) fn file_of(
    folder: &Folder,
    names: impl Iterator<Item = String>,
) -> Result<Option<ByteSource>, FrameProblem> {
    for name in names {
        match folder.resolve_named(&name) {
            // A folder may have the name of an image without its extension.
            Ok(path) if is_file(&path)? => return Ok(Some(path.into())),
            Ok(_) => {}
            Err(FrameProblem::Read(e)) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(problem) => return Err(problem),
        }
    }
    Ok(None)
}
