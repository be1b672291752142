//! Intrinsics stated in a recording's files, or known for its camera.

use super::recording::{Recording, SPLIT, metadata_error};
use crate::dataset::calibration::is_plausible_field_of_view;
use crate::dataset::error::DatasetError;
use crate::dataset::folder::{Folder, read_small_text};
use crate::dataset::formats::ParsedFolder;
use crate::dataset::matrix;
use crate::dataset::matrix::{describe_json, shorten};
use crate::math::camera::Intrinsics;
use crate::math::foreign::{JsonOutline, MAX_JSON_MEMORY};
use glam::DMat4;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, Error as _, MapAccess, Visitor};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fmt;
use std::path::{Path, PathBuf};

/// Manufacturer's intrinsics of PrimeSense cameras (Kinect, Xtion).
pub(super) const PRIMESENSE: KnownCamera = KnownCamera {
    source: "manufacturer's",
    intrinsics: Intrinsics { width: 640, height: 480, fx: 525.0, fy: 525.0, cx: 319.5, cy: 239.5 },
};

/// Camera that is assumed for a layout's recordings if their files state none.
pub(super) struct KnownCamera {
    /// Source of the intrinsics, for messages.
    pub source: &'static str,
    pub intrinsics: Intrinsics,
}

impl KnownCamera {
    /// Returns the known intrinsics for photographs of `size`, and adds a note that they are used.
    /// Errors name the missing `file` and its `expected` content.
    pub fn assume(
        &self,
        recording: &mut Recording,
        size: (u32, u32),
        (file, expected): (PathBuf, &str),
    ) -> Result<(PathBuf, Intrinsics), DatasetError> {
        // The user's intrinsics replace any others (`cameras_of_lens`).
        if recording.options.intrinsics.is_none() {
            let note = self.note(size, (&file, expected))?;
            recording.note(note);
        }
        Ok((file, self.intrinsics))
    }

    /// Returns the notice that this camera is used.
    ///
    /// # Errors
    /// Fails for photographs of another size.
    pub fn note(
        &self,
        size: (u32, u32),
        (file, expected): (&Path, &str),
    ) -> Result<String, DatasetError> {
        let Self { source, intrinsics: Intrinsics { width, height, fx, fy, cx, cy } } = self;
        // Focal lengths in pixels hold for one size only.
        if size != (*width, *height) {
            let expected = format!("{expected} for images of {}x{}", size.0, size.1);
            let found = format!("no such file (the {source} default is for {width}x{height})");
            return Err(metadata_error(file, &expected, found, "create it, or set the intrinsics"));
        }
        let name = file.file_name().unwrap_or_default().display();
        Ok(format!("no {name}: the {source} {fx}, {fy}, {cx}, {cy} are used"))
    }
}

/// Suffix of the names of texts with the pose of one frame.
pub(super) const POSE_SUFFIX: &str = ".pose.txt";
/// Names of text files that may contain `fx fy cx cy` or a camera matrix.
const NAMES: [&str; 5] =
    ["camera-intrinsics.txt", "intrinsics.txt", "camera.txt", "calibration.txt", "intrinsic.txt"];

/// Parses intrinsics for images of `size`: a camera matrix of 3×3 or 4×4 numbers by rows, or `fx fy cx
/// cy`.
pub(super) fn from_text(
    text: &str,
    size: (u32, u32),
    file: &Path,
) -> Result<Intrinsics, DatasetError> {
    let (width, height) = size;
    let of = |fx, fy, cx, cy| Intrinsics { width, height, fx, fy, cx, cy };
    if let Ok([fx, fy, cx, cy]) = matrix::parse_numbers::<4>(text) {
        return Ok(of(fx, fy, cx, cy));
    }
    let rows = matrix_rows(text).map_err(|found| {
        let expected = "4 numbers fx fy cx cy, or a camera matrix of 3x3 or 4x4";
        metadata_error(file, expected, found, "export the intrinsics again")
    })?;
    from_matrix(rows, size).ok_or_else(|| {
        let expected = "a camera matrix fx 0 cx, 0 fy cy, 0 0 1";
        metadata_error(file, expected, format!("{rows:?}"), "undistort to a pinhole without skew")
    })
}

/// Parses the left upper 3×3 of a matrix of 3×3 or 4×4 numbers.
fn matrix_rows(text: &str) -> Result<[f64; 9], String> {
    match matrix::parse_numbers::<16>(text) {
        Ok(m) if [m[3], m[7], m[11]] != [0.0; 3] => Err("a matrix with a translation".to_owned()),
        Ok(m) => Ok([m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]),
        Err(_) => matrix::parse_numbers::<9>(text),
    }
}

/// Reads a camera matrix. The position of the principal point shows whether the matrix is stored by
/// rows or by columns.
pub(super) fn from_matrix(m: [f64; 9], (width, height): (u32, u32)) -> Option<Intrinsics> {
    let zero = |v: f64| v.abs() < 1e-6;
    let [cx, cy] = match zero(m[2]) && zero(m[5]) {
        true => [m[6], m[7]],
        false if zero(m[6]) && zero(m[7]) => [m[2], m[5]],
        false => return None,
    };
    let is_pinhole = zero(m[1]) && zero(m[3]) && zero(m[8] - 1.0);
    is_pinhole.then_some(Intrinsics { width, height, fx: m[0], fy: m[4], cx, cy })
}

/// Reads intrinsics from JSON: nine numbers, three rows or columns of three numbers, or `fx fy cx cy`.
pub(super) fn from_json(value: &Value, size: (u32, u32)) -> Option<Intrinsics> {
    let numbers = flat_numbers(value)?;
    match numbers[..] {
        [fx, fy, cx, cy] => Some(Intrinsics { width: size.0, height: size.1, fx, fy, cx, cy }),
        _ => from_matrix(numbers.try_into().ok()?, size),
    }
}

/// Keys of lens terms.
pub(super) const LENS_TERMS: [&str; 8] = ["k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
/// Names of other keys that state a camera, a lens, a unit, a size or a time, in letters and digits.
const STATING: [&str; 13] =
    ["fx", "fy", "cx", "cy", "flx", "fly", "ox", "oy", "w", "h", "k", "dw", "dh"];
/// Parts of further such names.
const STATING_PARTS: &str = "lens distort distcoef focal intrinsic extrinsic calib shutter skew unit scale fov \
    fieldofview zoom fisheye principal projection cameraangle cameramodel cameratype cameramatrix width height \
    resolution size pixel time stamp fps framerate baseline binning crop aspect exposure aperture";
/// Names with such a part that state something else: boxes, counts and settings of viewers.
const OTHER: [&str; 3] = ["aabbscale", "autoscaleposesoverride", "mframessize"];
/// Most keys that one defect line lists.
const MOST_KEYS: usize = 6;

/// True if a key or column of this name states a camera, a lens, a unit, a size or a time.
pub(super) fn is_stating(name: &str) -> bool {
    let letters = name.chars().filter(|c| c.is_alphanumeric());
    let plain: String = letters.flat_map(char::to_lowercase).collect();
    let is_named = LENS_TERMS.iter().chain(&STATING).any(|other| *other == plain);
    let has_part = || STATING_PARTS.split(' ').any(|part| plain.contains(part));
    is_named || has_part() && !OTHER.contains(&plain.as_str())
}

/// True unless the value is empty or of zeros, which state nothing.
fn has_content(value: &Value) -> bool {
    match value {
        Value::Null => false,
        Value::Bool(is_so) => *is_so,
        Value::Number(number) => number.as_f64() != Some(0.0),
        Value::String(text) => !text.is_empty(),
        Value::Array(items) => items.iter().any(has_content),
        Value::Object(items) => items.values().any(has_content),
    }
}

/// Adds the stating keys of a JSON object, and of objects in it, that are not among the `used` ones.
pub(super) fn unused_keys(json: &Value, used: &[&str], found: &mut BTreeSet<String>) {
    for (key, value) in json.as_object().into_iter().flatten() {
        let is_used = used.contains(&key.as_str());
        if !is_used && is_stating(key) {
            found.extend(has_content(value).then(|| shorten(key)));
        } else {
            unused_keys(value, used, found);
        }
    }
}

/// Adds a defect line for keys of `file` that are not used.
pub(super) fn name_keys(parsed: &mut ParsedFolder, file: &Path, keys: &BTreeSet<String>) {
    if keys.is_empty() {
        return;
    }
    let named = keys.iter().take(MOST_KEYS).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = match keys.len().saturating_sub(MOST_KEYS) {
        0 => String::new(),
        n => format!(" and {n} more"),
    };
    let (noun, verb) = if keys.len() == 1 { ("key", "is") } else { ("keys", "are") };
    parsed.unused.push(format!("{}: the {noun} {named}{more} {verb} not used", file.display()));
}

/// Adds a defect line for the stating keys of a JSON object of `file` that are not among the `used` ones.
pub(super) fn name_unused_keys(
    recording: &mut Recording,
    file: &Path,
    json: &Value,
    used: &[&str],
) {
    let mut found = BTreeSet::new();
    unused_keys(json, used, &mut found);
    name_keys(&mut recording.parsed, file, &found);
}

/// Returns the value of the first of the keys that is present.
pub(super) fn first_of<'a>(json: &'a Value, keys: &[&str]) -> Option<&'a Value> {
    keys.iter().find_map(|key| json.get(key))
}

/// Returns a width or height in pixels, from the first of the keys that is present.
pub(super) fn side(json: &Value, keys: &[&str]) -> Option<u32> {
    u32::try_from(first_of(json, keys)?.as_u64()?).ok()
}

/// Returns the items of the array `key`; empty if there is no such array.
pub(super) fn array<'a>(json: &'a Value, key: &str) -> &'a [Value] {
    json.get(key).and_then(Value::as_array).map_or(&[], Vec::as_slice)
}

/// Prefix of the names of frame lists. A damaged file with this prefix is reported instead of skipped.
const LIST_PREFIX: &str = "transforms";

/// Returns the frame lists of a folder: JSON files whose `frames` name files and poses, and files that are
/// lists by their names. The value of a damaged file is null. Only one of them is in memory.
pub(super) fn frame_lists(folder: &Folder) -> impl Iterator<Item = (&str, Value)> {
    let is_posed = |f: &Value| f.get("transform_matrix").is_some() && f.get("file_path").is_some();
    let list = move |name| {
        // Read completely: a list under another name is recognised by its content alone.
        let json = parse_json(&folder.peek_whole(name)).unwrap_or(Value::Null);
        let is_list = name.starts_with(LIST_PREFIX) || array(&json, "frames").iter().any(is_posed);
        is_list.then_some((name, json))
    };
    folder.listing.files().filter(|name| name.ends_with(".json")).filter_map(list)
}

pub(super) fn read_list(folder: &Folder, name: &str) -> Result<(PathBuf, Value), DatasetError> {
    let (file, text) = folder.text(name)?;
    match parse_json(&text) {
        Ok(json) => Ok((file, json)),
        Err(source) => Err(DatasetError::Json { file, source }),
    }
}

/// Returns the split that the file name of a frame list states: `train` for `transforms_train.json` and
/// `transforms-train.json`, `all` for `transforms.json`.
pub(super) fn split_name(file_name: &str) -> &str {
    let stem = file_name.trim_end_matches(".json");
    match stem.strip_prefix(LIST_PREFIX).unwrap_or(stem).trim_matches(['_', '-', '.']) {
        "" => SPLIT,
        split => split,
    }
}

/// Parses JSON with the bare words `NaN` and `Infinity`, which Python writes. They become texts, so that
/// only what needs their number is refused.
pub(super) fn parse_json<T: DeserializeOwned>(text: &str) -> serde_json::Result<T> {
    parse_bounded(text).or_else(|_| parse_bounded(&with_quoted_words(text)))
}

fn parse_bounded<T: DeserializeOwned>(text: &str) -> serde_json::Result<T> {
    let JsonOutline { memory, texts, .. } = JsonOutline::of(text.as_bytes());
    let memory = memory + texts + text.len();
    if memory > MAX_JSON_MEMORY {
        let limit = format_args!("at most {} MiB of values", MAX_JSON_MEMORY >> 20);
        let found = format_args!("about {} MiB of values; {limit} are read", memory >> 20);
        return Err(serde_json::Error::custom(found));
    }
    serde_json::from_str(text)
}

/// Fields of a JSON object in the order of the text, with doubled ones.
pub(super) struct Entries(pub Vec<(String, Value)>);

impl<'de> Deserialize<'de> for Entries {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(Self(Vec::new()))
    }
}

impl<'de> Visitor<'de> for Entries {
    type Value = Self;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<M: MapAccess<'de>>(mut self, mut map: M) -> Result<Self, M::Error> {
        while let Some(entry) = map.next_entry()? {
            self.0.push(entry);
        }
        Ok(self)
    }
}

fn with_quoted_words(text: &str) -> String {
    let (mut out, mut rest) = (String::with_capacity(text.len()), text);
    while let Some(at) = rest.find(['"', '-', 'I', 'N']) {
        let (before, from) = rest.split_at(at);
        out.push_str(before);
        let word = ["NaN", "Infinity", "-Infinity"].into_iter().find(|w| from.starts_with(w));
        let quote = if word.is_some() { "\"" } else { "" };
        let n = word.map_or_else(|| quoted_length(from), str::len);
        let (part, after) = from.split_at(n);
        out.extend([quote, part, quote]);
        rest = after;
    }
    out + rest
}

/// Returns the number of bytes of the quoted text at the start; 1 without a quotation mark there.
fn quoted_length(text: &str) -> usize {
    let Some(inner) = text.strip_prefix('"') else { return 1 };
    let mut is_escaped = false;
    let end = inner.bytes().position(|byte| {
        let is_end = byte == b'"' && !is_escaped;
        is_escaped = byte == b'\\' && !is_escaped;
        is_end
    });
    end.map_or(text.len(), |end| end + 2)
}

/// Returns the name of a frame list's entry: its path or, if it has no path, its position in the list.
pub(super) fn entry_name(entry: &Value, place: usize) -> String {
    let path = entry.get("file_path").and_then(Value::as_str);
    // Exporters differ in the leading `./`.
    path.map_or_else(|| place.to_string(), |path| path.trim_start_matches("./").to_owned())
}

pub(super) fn flat_numbers(value: &Value) -> Option<Vec<f64>> {
    match value {
        Value::Array(items) => {
            let parts: Option<Vec<_>> = items.iter().map(flat_numbers).collect();
            Some(parts?.concat())
        }
        other => Some(vec![other.as_f64()?]),
    }
}

/// Finds the camera that a text file in the folder `relative` states for images of `size`: a file of a
/// usual name or, without one, any text that is a camera matrix. Also returns the file's path.
///
/// # Errors
/// Two texts with different matrices; a file of a usual name without a camera.
pub(super) fn in_text_file(
    folder: &Folder,
    relative: &str,
    size: (u32, u32),
) -> Result<Option<(PathBuf, Intrinsics)>, DatasetError> {
    let texts = small_texts(folder, relative);
    let named = NAMES.iter().find_map(|name| texts.iter().find(|(found, _)| found == name));
    let matrices: Vec<_> =
        texts.iter().filter_map(|(n, text)| Some((n, matrix_of(text)?))).collect();
    let name = match (named, matrices.first()) {
        (Some((name, _)), _) => name,
        (None, Some((name, first))) => {
            if let Some((other, _)) = matrices.iter().find(|(_, matrix)| matrix != first) {
                return Err(two_cameras(&folder.path.join(relative).join(other), name));
            }
            name
        }
        (None, None) => return Ok(None),
    };
    let (file, text) = folder.text(&Path::new(relative).join(name).display().to_string())?;
    // The last of four numbers may lack digits; a matrix ends with a 1.
    if folder.is_growing() && !text.ends_with('\n') && matrix::parse_numbers::<4>(&text).is_ok() {
        let found = "a line that may still grow".to_owned();
        let expected = "fx fy cx cy and the end of the line";
        return Err(metadata_error(&file, expected, found, "end the line"));
    }
    let k = from_text(&text, size, &file)?;
    Ok(Some((file, k)))
}

fn two_cameras(file: &Path, other: &str) -> DatasetError {
    let found = format!("one here and another in {other}");
    metadata_error(file, "one camera", found, "keep the file that belongs to these images")
}

/// Returns the camera matrix of which a text consists. Unlike a pose, it has focal lengths of many
/// pixels.
fn matrix_of(text: &str) -> Option<[f64; 9]> {
    let rows = matrix_rows(text).ok()?;
    from_matrix(rows, (1, 1)).is_some_and(|k| k.fx > 2.0 && k.fy > 2.0).then_some(rows)
}

/// Most texts of a folder that are searched for a camera. Frames with a text each have more.
const MOST_TEXTS: usize = 64;

/// Returns name and beginning of the texts in the folder `relative` that are not poses of frames.
fn small_texts(folder: &Folder, relative: &str) -> Vec<(String, String)> {
    let relative = Path::new(relative);
    let Ok(listing) = folder.list(relative) else { return Vec::new() };
    let is_text = |name: &&str| {
        [".txt", ".csv"].iter().any(|end| name.ends_with(end)) && !name.ends_with(POSE_SUFFIX)
    };
    let read = |name: &str| {
        let text =
            folder.file(relative, &listing, name).and_then(|path| Ok(read_small_text(&path)?));
        text.map_err(|problem| folder.record_unread(name, problem)).ok()
    };
    let names = listing.files().filter(is_text).take(MOST_TEXTS);
    names.filter_map(|name| Some((name.to_owned(), read(name)?))).collect()
}

/// Cameras in lines `key = numbers`, as in `info.txt` of BundleFusion, 12-Scenes and 3RScan.
pub(super) struct SensorInfo {
    pub file: PathBuf,
    text: String,
}

impl SensorInfo {
    /// Finds the first text in the folder `relative` that states intrinsics.
    pub fn find(folder: &Folder, relative: &str) -> Result<Option<Self>, DatasetError> {
        let texts = small_texts(folder, relative).into_iter();
        let mut infos = texts.map(|(name, text)| Self { file: name.into(), text });
        let Some(info) = infos.find(|info| info.value(&["intrinsic"]).is_some()) else {
            return Ok(None);
        };
        let (file, text) =
            folder.text(&Path::new(relative).join(info.file).display().to_string())?;
        Ok(Some(Self { file, text }))
    }

    /// Returns the value of the first key that contains all parts, in lower case.
    fn value(&self, parts: &[&str]) -> Option<&str> {
        self.text.lines().filter_map(|line| line.split_once('=')).find_map(|(key, value)| {
            let key = key.to_lowercase();
            parts.iter().all(|part| key.contains(part)).then_some(value.trim())
        })
    }

    fn number(&self, parts: &[&str]) -> Option<f64> {
        self.value(parts)?.parse().ok()
    }

    /// Returns the intrinsics of `camera` (`color` or `depth`), for the stated size or else for images
    /// of `size`; `None` if there are none.
    pub fn intrinsics(
        &self,
        camera: &str,
        size: (u32, u32),
    ) -> Result<Option<Intrinsics>, DatasetError> {
        let Some(text) = self.value(&[camera, "intrinsic"]) else { return Ok(None) };
        // The cast saturates: an absurd size has another shape than the images.
        let side = |key: &str, unless| self.number(&[camera, key]).map_or(unless, |n| n as u32);
        from_text(text, (side("width", size.0), side("height", size.1)), &self.file).map(Some)
    }

    /// Returns the length of a step of depth, metres; `None` if it is not stated.
    ///
    /// # Errors
    /// A number of steps per metre that is not positive.
    pub fn depth_unit(&self) -> Result<Option<f64>, DatasetError> {
        let Some(said) = self.value(&["depth", "shift"]) else { return Ok(None) };
        let steps = said.parse().ok().filter(|steps: &f64| steps.is_finite() && *steps > 0.0);
        let expected = "a positive depth shift, steps per metre";
        let wrong = || metadata_error(&self.file, expected, said.to_owned(), "correct it");
        Ok(Some(1.0 / steps.ok_or_else(wrong)?))
    }

    /// True if a stated transform between the cameras is not the identity.
    pub fn has_offset(&self) -> bool {
        let stated = |camera: &&str| self.value(&[camera, "extrinsic"]);
        ["color", "depth"].iter().filter_map(stated).any(is_offset)
    }

    /// Returns the keys that state something and have no effect.
    pub fn unused_keys(&self) -> BTreeSet<String> {
        let is_used = |key: &str| {
            let has = |parts: &[&str]| parts.iter().any(|part| key.contains(part));
            let parts = ["intrinsic", "extrinsic", "width", "height"];
            has(&["color", "depth"]) && has(&parts) || key.contains("depth") && has(&["shift"])
        };
        let keys = self.text.lines().filter_map(|line| line.split_once('='));
        let keys = keys.map(|(key, _)| key.trim());
        let keys = keys.filter(|key| is_stating(key) && !is_used(&key.to_lowercase()));
        keys.map(shorten).collect()
    }
}

/// True unless a text is the identity, a matrix of 4×4 numbers.
pub(super) fn is_offset(text: &str) -> bool {
    !matrix::from_text(text).is_ok_and(|m: DMat4| m.abs_diff_eq(DMat4::IDENTITY, 1e-6))
}

/// Reads the camera from an Open3D JSON file (`intrinsic_matrix`, `width`, `height`). Also returns the
/// file's path.
///
/// # Errors
/// Two files with different cameras, or one without a camera.
fn in_json_file(recording: &mut Recording) -> Result<Option<(PathBuf, Intrinsics)>, DatasetError> {
    let folder = recording.folder;
    let mut found: Option<(PathBuf, Intrinsics)> = None;
    for name in folder.listing.files().filter(|name| name.ends_with(".json")) {
        let (file, text) = folder.text(name)?;
        // Other JSON files, such as settings, may lie beside the camera's.
        let Ok(json) = parse_json::<Value>(&text) else { continue };
        let Some(matrix) = json.get("intrinsic_matrix") else { continue };
        let size = side(&json, &["width"]).zip(side(&json, &["height"]));
        let k = size.and_then(|size| from_json(matrix, size));
        let expected = "`width`, `height` and an `intrinsic_matrix` of nine numbers";
        let hint = "export the camera again";
        let k = k.ok_or_else(|| metadata_error(&file, expected, describe_json(&json), hint))?;
        match &found {
            Some((first, other)) if *other != k => {
                return Err(two_cameras(&file, &first.display().to_string()));
            }
            Some(_) => {}
            None => {
                name_unused_keys(recording, &file, &json, &["intrinsic_matrix", "width", "height"]);
                found = Some((file, k));
            }
        }
    }
    Ok(found)
}

/// Finds the camera that a JSON file of Open3D or else a text states for images of `size`.
pub(super) fn in_any_file(
    recording: &mut Recording,
    size: (u32, u32),
) -> Result<Option<(PathBuf, Intrinsics)>, DatasetError> {
    let in_json = in_json_file(recording)?;
    let in_text = in_text_file(recording.folder, "", size)?;
    if let Some(((json, used), (text, other))) = in_json.as_ref().zip(in_text.as_ref())
        && used.resized(size.0, size.1) != *other
    {
        let statement = format!("its camera is not used, as {} states one", json.display());
        recording.unused(text, statement);
    }
    Ok(in_json.or(in_text))
}

/// Camera parameters of a frame. Where the frame has no value, the value of the whole list applies.
#[derive(Clone, Copy)]
pub(super) struct FrameCamera<'a> {
    pub frame: &'a Value,
    pub list: &'a Value,
    pub file: &'a Path,
}

impl FrameCamera<'_> {
    pub fn number(&self, key: &str) -> Result<Option<f64>, DatasetError> {
        let Some(value) = self.frame.get(key).or_else(|| self.list.get(key)) else {
            return Ok(None);
        };
        let number = value.as_f64().filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| {
            let expected = format!("a number as `{key}`");
            metadata_error(self.file, &expected, describe_json(value), "correct the value")
        })
    }

    pub fn states_size(&self) -> bool {
        ["w", "h"].iter().any(|key| first_of(self.frame, &[key]).or(self.list.get(key)).is_some())
    }

    /// Returns the stated width and height. A missing value is replaced by that of `unless`.
    pub fn size(&self, unless: (u32, u32)) -> Result<(u32, u32), DatasetError> {
        // The cast saturates: an absurd size fails the comparison with the images.
        let side = |n: Option<f64>, unless: u32| n.map_or(unless, |n| n as u32);
        Ok((side(self.number("w")?, unless.0), side(self.number("h")?, unless.1)))
    }

    /// Returns the intrinsics (`dataset.md`, Frames of reference). The focal length is stated in pixels
    /// or as a field of view. The principal point is at the image centre unless it is stated.
    pub fn intrinsics(&self, (width, height): (u32, u32)) -> Result<Intrinsics, DatasetError> {
        let (fx, mut fy) = match (self.number("fl_x")?, self.number("camera_angle_x")?) {
            // Pixels are square unless `fl_y` follows.
            (Some(fx), _) => (fx, fx),
            (None, Some(angle)) => {
                let fx = self.focal_length(width, angle)?;
                let tall = self.number("camera_angle_y")?;
                (fx, tall.map_or(Ok(fx), |angle| self.focal_length(height, angle))?)
            }
            (None, None) => {
                let expected = "a number `camera_angle_x` (or `fl_x`)";
                let hint =
                    "add the horizontal field of view in radians, or the focal length in pixels";
                return Err(metadata_error(self.file, expected, describe_json(self.frame), hint));
            }
        };
        fy = self.number("fl_y")?.unwrap_or(fy);
        let cx = self.number("cx")?.unwrap_or(0.5 * f64::from(width));
        let cy = self.number("cy")?.unwrap_or(0.5 * f64::from(height));
        Ok(Intrinsics { width, height, fx, fy, cx, cy })
    }

    fn focal_length(&self, side: u32, radians: f64) -> Result<f64, DatasetError> {
        let degrees = radians.to_degrees();
        if is_plausible_field_of_view(degrees) {
            // Serves the vertical angle too: only the length of its side matters.
            return Ok(Intrinsics::from_horizontal_fov(side, side, radians).fx);
        }
        // Up to 180, the value is probably an angle in degrees.
        let hint = if radians > 3.0 && radians < 180.0 {
            format!("is this in degrees? then write {:.6}", radians.to_radians())
        } else {
            "write the horizontal field of view of the camera in radians".to_owned()
        };
        let expected = "`camera_angle_x` in radians, between 0.1 and 179 degrees";
        let found = format!("{radians} ({degrees:.3} degrees)");
        Err(metadata_error(self.file, expected, found, &hint))
    }
}

/// Camera models whose distortion has at most the parameters `k1`, `k2`, `k3`, `p1` and `p2`.
const KNOWN_MODELS: [&str; 7] = [
    "OPENCV",
    "PINHOLE",
    "SIMPLE_PINHOLE",
    "RADIAL",
    "SIMPLE_RADIAL",
    "PERSPECTIVE",
    "FULL_OPENCV",
];
const OTHER_TERMS: [&str; 6] = ["k4", "k5", "k6", "skew", "sk_x", "sk_y"];
const OTHER_FLAGS: [&str; 2] = ["is_fisheye", "fisheye"];
/// Keys of frame lists that [`FrameCamera`] uses or [`check_model`] refuses.
pub(super) fn camera_keys() -> Vec<&'static str> {
    let used =
        ["fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x", "camera_angle_y", "camera_model"];
    [&used[..], &OTHER_TERMS, &OTHER_FLAGS].concat()
}

pub(super) fn check_model(camera: &FrameCamera) -> Result<(), DatasetError> {
    let said = |key: &str| camera.frame.get(key).or_else(|| camera.list.get(key));
    let model = said("camera_model").and_then(Value::as_str);
    let other_model = model.filter(|model| !KNOWN_MODELS.contains(model));
    let other_term = OTHER_TERMS.iter().find(|key| {
        // A value that is not a number does not count as zero.
        said(key).is_some_and(|value| value.as_f64() != Some(0.0))
    });
    let other_flag =
        OTHER_FLAGS.iter().find(|key| said(key).and_then(Value::as_bool) == Some(true));
    let found = match (other_model, other_term.or(other_flag)) {
        (Some(model), _) => format!("`camera_model` {model}"),
        (None, Some(key)) => format!("`{key}` {}", said(key).unwrap_or(&Value::Null)),
        (None, None) => return Ok(()),
    };
    let expected = "a perspective camera with k1, k2, k3, p1, p2";
    Err(metadata_error(camera.file, expected, found, "undistort the images to a pinhole first"))
}

const SAMPLED_FILES: usize = 9;

/// Returns the most frequent result of `ask` in a sample of the files; among equally frequent results,
/// the one that occurs first. Returns `None` if there are no files.
///
/// # Errors
/// Returns the first error if no file can be read.
pub(super) fn majority<S, T: Copy + PartialEq, E>(
    files: &[S],
    ask: impl Fn(&S) -> Result<T, E>,
) -> Result<Option<T>, E> {
    // Retried once: a passing disk error would change the result for all frames silently.
    let ask = |file: &S| ask(file).or_else(|_| ask(file));
    let n = files.len().min(SAMPLED_FILES);
    // Evenly spaced: an odd frame, even the first, costs only itself.
    let is_sampled = |(at, _): &(usize, &S)| (0..n).any(|i| i * files.len() / n == *at);
    let (sampled, others): (Vec<_>, Vec<_>) = files.iter().enumerate().partition(is_sampled);
    let (mut answers, mut error) = (Vec::new(), None);
    for (_, file) in sampled {
        match ask(file) {
            Ok(answer) => answers.push(answer),
            Err(e) => drop(error.get_or_insert(e)),
        }
    }
    let n_votes = |answer: &&T| answers.iter().filter(|other| *other == *answer).count();
    // `max_by_key` returns the last of equals, which is the first file's in reverse.
    let most = answers.iter().rev().max_by_key(n_votes).copied();
    // If no sampled file is readable, any other one decides: damaged images must not cost the recording.
    match most.or_else(|| others.into_iter().find_map(|(_, file)| ask(file).ok())) {
        Some(answer) => Ok(Some(answer)),
        None => error.map_or(Ok(None), Err),
    }
}

#[cfg(test)]
mod json_tests {
    use super::*;

    #[test]
    fn bare_words_become_texts_and_texts_stay() {
        let text = r#"{"a\\\"NaN": [NaN, -Infinity, -1, Infinity], "N": "\\", "ä": "I-NaN"}"#;
        let json: Value = parse_json(text).unwrap_or_default();
        assert_eq!(json["a\\\"NaN"], serde_json::json!(["NaN", "-Infinity", -1, "Infinity"]));
        assert_eq!((&json["N"], &json["ä"]), (&"\\".into(), &"I-NaN".into()));
        for broken in ["[NaN", "[NaNa]", "[\"NaN]", "[-]", "[Inf]"] {
            assert!(parse_json::<Value>(broken).is_err(), "{broken}");
        }
    }
}

#[cfg(test)]
mod majority_tests {
    use super::*;

    fn most(files: &[Option<u32>]) -> Result<Option<u32>, &'static str> {
        majority(files, |file| file.ok_or("damaged"))
    }

    #[test]
    fn the_odd_one_is_outvoted_wherever_it_stands() {
        for odd in 0..4 {
            let mut files = [Some(7); 4];
            files[odd] = Some(5);
            assert_eq!(most(&files), Ok(Some(7)), "{odd}");
        }
        assert_eq!(most(&[Some(5), Some(7)]), Ok(Some(5)), "as many of each");
        assert_eq!(most(&[]), Ok(None));
        assert_eq!(most(&[None, None]), Err("damaged"));
        assert_eq!(most(&[None, Some(5), Some(7), Some(7)]), Ok(Some(7)));
    }

    #[test]
    fn a_file_that_can_be_read_is_found_among_many_that_cannot() {
        let mut files = [None; 100];
        files[1] = Some(7);
        assert_eq!(most(&files), Ok(Some(7)));
    }
}
