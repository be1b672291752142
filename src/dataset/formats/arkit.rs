//! ARKit packages: a file with one JSON object per line, each a frame with `camera_to_world` (OpenGL axes,
//! as in ARKit), `intrinsics` for the photograph's size or `intrinsics_depth`, and the names of three files: photograph, depth
//! (32-bit floats without header, metres) and confidence (bytes without header, 0 to 2).
//!
//! Several apps write such files: keys and the storage order of matrices differ and are recognised by
//! content. If the last four of the 16 numbers are `0 0 0 1`, a matrix is stored by rows. If every
//! fourth number forms `0 0 0 1`, it is stored by columns, as in Apple's own arrays.

use super::recording::{LIDAR_RANGE, Recording, encoding, frame_entry, own_camera, same_size};
use super::stated;
use super::stated::{first_of, flat_numbers, parse_json, side};
use crate::dataset::decode;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::entry::FrameEntry;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::lengths;
use crate::dataset::matrix::describe_json;
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DMat4;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opengl, recognise, parse };

const POSE_KEYS: [&str; 4] =
    ["camera_to_world", "cameraToWorld", "camera_transform", "cameraTransform"];
const COLOR_KEYS: [&str; 8] =
    ["image", "color", "rgb", "image_path", "color_path", "rgb_path", "file_path", "imagePath"];
const DEPTH_KEYS: [&str; 5] = ["depth", "depth_path", "depth_file_path", "depth_file", "depthPath"];
const CONFIDENCE_KEYS: [&str; 5] =
    ["confidence", "confidence_path", "confidence_file", "conf", "confidencePath"];
/// Intrinsics for the size of the depth image.
const DEPTH_LENS_KEYS: [&str; 3] = ["intrinsics_depth", "depth_intrinsics", "depthIntrinsics"];
const TIME_KEYS: [&str; 3] = ["timestamp", "time", "t"];
const WIDTH_KEYS: [&str; 3] = ["width", "image_width", "w"];
const HEIGHT_KEYS: [&str; 3] = ["height", "image_height", "h"];

/// Keys of the camera's numbers and of sizes.
const CAMERA_KEYS: [&str; 14] = [
    "intrinsics",
    "K",
    "fx",
    "fl_x",
    "fy",
    "fl_y",
    "cx",
    "ox",
    "cy",
    "oy",
    "depth_width",
    "depthWidth",
    "depth_height",
    "depthHeight",
];
const DEPTH_SIZE_KEYS: [&str; 2] = ["depth_size", "depth_resolution"];

const LINES: [&str; 2] = [".jsonl", ".ndjson"];

fn recognise(folder: &Folder) -> Option<String> {
    let names: Vec<&str> = frame_lines(folder).collect();
    (!names.is_empty()).then(|| format!("{} with one frame per line", names.join(", ")))
}

fn frame_lines(folder: &Folder) -> impl Iterator<Item = &str> {
    let is_ours = |name: &&str| {
        let text = folder.peek(name);
        // Every line is a frame, so the first one suffices.
        let first = text.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
        let json: Value = parse_json(first).unwrap_or_default();
        let has = |keys: &[&str]| first_of(&json, keys).is_some();
        has(&POSE_KEYS) || has(&COLOR_KEYS) && has(&DEPTH_KEYS)
    };
    let is_lines = |name: &&str| LINES.iter().any(|end| name.ends_with(end));
    folder.listing.files().filter(is_lines).filter(is_ours)
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut parsed = ParsedFolder::default();
    let names: Vec<&str> = frame_lines(folder).collect();
    // The default is used only if the file was removed since recognition; reading it then fails.
    let names = if names.is_empty() { vec!["frames.jsonl"] } else { names };
    for name in &names {
        let mut recording = Recording::new(folder, options);
        if names.len() > 1 {
            let stem = LINES.iter().find_map(|end| name.strip_suffix(end));
            recording.split = stem.unwrap_or(name).to_owned();
        }
        add_lines(&mut recording, name)?;
        parsed.append(recording.finish());
    }
    // Lists of one app name its unused keys again.
    parsed.unused.dedup();
    Ok(parsed)
}

fn add_lines(recording: &mut Recording, name: &str) -> Result<(), DatasetError> {
    let (folder, options) = (recording.folder, recording.options);
    let (file, text) = folder.lines(name)?;
    let encoding = encoding(options, CodeKind::BareFloats, Sensor::Lidar, LIDAR_RANGE);
    let (mut seen, mut times, mut unused) = (BTreeSet::new(), Vec::new(), BTreeSet::new());
    let used = [
        &CAMERA_KEYS[..],
        &DEPTH_LENS_KEYS,
        &DEPTH_SIZE_KEYS,
        &TIME_KEYS,
        &WIDTH_KEYS,
        &HEIGHT_KEYS,
    ];
    let used = used.concat();
    for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
        let json: Value = match parse_json(line) {
            Ok(json) => json,
            Err(error) => {
                let expected = "a JSON object";
                recording.skip_line(&file, i + 1, expected, &error.to_string());
                continue;
            }
        };
        stated::unused_keys(&json, &used, &mut unused);
        let line = FrameLine { json: &json, file: &file };
        let name = line.text(&COLOR_KEYS).map_or_else(|| format!("line {}", i + 1), str::to_owned);
        if folder.was_taken(&name) {
            continue;
        }
        if !seen.insert(name.clone()) {
            let problem = FrameProblem::Duplicate(format!("another line of `{name}`"));
            recording.skip(&name, file.clone(), problem);
            continue;
        }
        let frame = line.recorded(&name, recording, encoding)?;
        times.extend(frame.as_ref().ok().and_then(|frame| frame.time));
        recording.add(&name, &file, frame);
    }
    stated::name_keys(&mut recording.parsed, &file, &unused);
    let unordered = times.array_windows().filter(|[before, here]| here < before).count();
    if unordered > 0 {
        recording.note(format!(
            "{unordered} frames are older than the frame before; the listed order is used"
        ));
    }
    Ok(())
}

struct FrameLine<'a> {
    json: &'a Value,
    file: &'a Path,
}

impl<'a> FrameLine<'a> {
    fn text(&self, keys: &[&str]) -> Option<&'a str> {
        keys.iter().find_map(|key| self.json.get(key).and_then(Value::as_str))
    }

    /// Creates the frame described by this line. The outer error aborts opening the dataset; the inner
    /// error skips the frame.
    fn recorded(
        &self,
        name: &str,
        recording: &Recording,
        encoding: DepthEncoding,
    ) -> Result<Result<FrameEntry, FrameProblem>, DatasetError> {
        let (pose, color, depth, confidence, size) = match self.read(recording) {
            Ok(found) => found,
            Err(problem) => return Ok(Err(problem)),
        };
        if let Some(stated) = side(self.json, &WIDTH_KEYS).zip(side(self.json, &HEIGHT_KEYS)) {
            same_size(stated, size, self.file)?;
        }
        let depth_size = match depth.as_ref().map(|file| self.depth_size(file, size)) {
            None => size,
            Some(Ok(size)) => size,
            Some(Err(problem)) => return Ok(Err(problem)),
        };
        let cameras = match (self.intrinsics(size), self.depth_intrinsics(depth_size)) {
            (Some(k), Some(of_depth)) => {
                let [photograph, depth] = [(self.file, &k), (self.file, &of_depth)];
                recording.cameras_of_lenses(photograph, depth, size, depth_size)
            }
            (Some(k), None) | (None, Some(k)) => {
                recording.cameras_of_lens(&k, size, depth_size, self.file)
            }
            (None, None) => {
                let expected = "`intrinsics`, a camera matrix or fx, fy, cx, cy of the photograph";
                return Ok(Err(FrameProblem::Entry { expected, found: describe_json(self.json) }));
            }
        };
        // Each frame has its own camera, so a bad one costs its frame.
        let cameras = match cameras {
            Ok(cameras) => cameras,
            Err(error) => return Ok(Err(own_camera(error))),
        };
        // Some packages convert depth to images; the content decides.
        let is_image = depth.as_ref().is_some_and(|file| decode::depth_size(file).is_ok());
        let codes = CodeKind::ByContent(recording.options.depth_scale.unwrap_or(MILLIMETRE));
        let encoding = if is_image { DepthEncoding { codes, ..encoding } } else { encoding };
        let depth = depth.map(|file| recording.depth_with_confidence(file, encoding, confidence));
        Ok(Ok(FrameEntry {
            time: first_of(self.json, &TIME_KEYS).and_then(Value::as_f64),
            ..frame_entry(name.to_owned(), pose, cameras, color, depth)
        }))
    }

    #[expect(clippy::type_complexity, reason = "taken apart at once by its only caller")]
    fn read(
        &self,
        recording: &Recording,
    ) -> Result<(Pose, ByteSource, Option<ByteSource>, Option<ByteSource>, (u32, u32)), FrameProblem>
    {
        let matrix = || matrix(first_of(self.json, &POSE_KEYS));
        let pose = recording.options.pose(|| Ok(Pose::from_opengl(matrix()?)?))?;
        let path = |text| (text, recording.folder.resolve_named(text));
        let named = |keys: &[&str]| self.text(keys).map(path);
        let missing = |text: &str, problem: FrameProblem, kind: fn(String) -> FrameProblem| {
            problem.or_missing(|| kind(text.to_owned()))
        };
        let (text, path) =
            named(&COLOR_KEYS).ok_or_else(|| FrameProblem::MissingColor("`image`".to_owned()))?;
        let color: ByteSource =
            path.map_err(|problem| missing(text, problem, FrameProblem::MissingColor))?.into();
        let depth = named(&DEPTH_KEYS).map(|(text, path)| {
            path.map_err(|problem| missing(text, problem, FrameProblem::MissingDepth))
        });
        let depth = depth.transpose()?.map(ByteSource::File);
        let confidence = named(&CONFIDENCE_KEYS).map(|(_, path)| path).transpose()?;
        // Each frame has its own camera, which refers to its own photograph.
        let header = decode::header(&color)?;
        Ok((pose, color, depth, confidence.map(Into::into), (header.width, header.height)))
    }

    fn intrinsics(&self, size: (u32, u32)) -> Option<Intrinsics> {
        let value = self.json.get("intrinsics").or_else(|| self.json.get("K"));
        if let Some(k) = value.and_then(|value| stated::from_json(value, size)) {
            return Some(k);
        }
        // Numbers by name, in an object of their own or in the frame's object.
        let object = value.filter(|value| value.is_object()).unwrap_or(self.json);
        let number = |keys: [&str; 2]| first_of(object, &keys).and_then(Value::as_f64);
        let (fx, fy) = (number(["fx", "fl_x"])?, number(["fy", "fl_y"])?);
        let (cx, cy) = (number(["cx", "ox"])?, number(["cy", "oy"])?);
        Some(Intrinsics { width: size.0, height: size.1, fx, fy, cx, cy })
    }

    fn depth_intrinsics(&self, size: (u32, u32)) -> Option<Intrinsics> {
        stated::from_json(first_of(self.json, &DEPTH_LENS_KEYS)?, size)
    }

    /// Returns the size of a depth image as stated by the line or the image file. For floats without
    /// header, derives it from their number and the photograph's aspect ratio.
    fn depth_size(&self, file: &ByteSource, color: (u32, u32)) -> Result<(u32, u32), FrameProblem> {
        let pair = |key: &str| {
            let value = self.json.get(key).and_then(flat_numbers);
            value.and_then(|v| <[f64; 2]>::try_from(v).ok()).map(|[w, h]| (w as u32, h as u32))
        };
        let stated = side(self.json, &["depth_width", "depthWidth"]);
        let stated = stated.zip(side(self.json, &["depth_height", "depthHeight"]));
        if let Some(stated) = stated.or_else(|| DEPTH_SIZE_KEYS.into_iter().find_map(pair)) {
            return Ok(stated);
        }
        // An image states its size itself; bare floats do not.
        if let Ok(size) = decode::depth_size(file) {
            return Ok(size);
        }
        let bytes = std::fs::metadata(file.path())?.len();
        lengths::size_of_floats(bytes, color).ok_or_else(|| FrameProblem::DepthFile {
            expected: "`depth_width` and `depth_height`, or depth of the photograph's aspect ratio",
            found: format!("{bytes} bytes of floats for a photograph of {}x{}", color.0, color.1),
        })
    }
}

/// Parses a matrix of 16 numbers, stored by rows or by columns, as a nested or flat array.
pub(super) fn matrix(value: Option<&Value>) -> Result<DMat4, FrameProblem> {
    let shape = |found: String| FrameProblem::PoseShape(found);
    let value = value.ok_or_else(|| shape("no matrix".to_owned()))?;
    let numbers = flat_numbers(value).ok_or_else(|| shape(describe_json(value)))?;
    let n = numbers.len();
    let m: [f64; 16] = numbers.try_into().map_err(|_| shape(format!("{n} numbers")))?;
    let is_by_columns = [m[3], m[7], m[11]] == [0.0; 3] && m[15] == 1.0;
    let is_by_rows = m[12..] == [0.0, 0.0, 0.0, 1.0];
    let by_columns = DMat4::from_cols_array(&m);
    // Without a translation both hold: rows, as JSON writers nest them.
    Ok(if is_by_columns && !is_by_rows { by_columns } else { by_columns.transpose() })
}
