//! nerfstudio: `transforms.json` whose frames name their depth (`depth_file_path`, or `depth_path` of
//! NeRFCapture) or have a camera of their own; OpenGL axes.
//!
//! Every number about the camera (`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1`, `k2`, `k3`, `p1`, `p2`)
//! stands in the frame or, for all frames, beside the list. Depth is along the optical axis, stored
//! times `depth_unit_scale_factor` (NeRFCapture: `integer_depth_scale`), .001 without one.

use super::format::{DatasetFormat, ParsedFolder};
use super::recording::{RecordedFrame, Recording, same_size, wrong};
use crate::dataset::decode::{self, CodeKind, DepthEncoding};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::matrix::{describe, from_json};
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_convention::PoseConvention;
use crate::dataset::source::ByteSource;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    looks_for: "nerfstudio: a JSON file whose `frames` have a `depth_file_path`, or cameras of their own",
    poses: PoseConvention::Opengl,
    recognise,
    parse,
    known_calibration: |_| None,
};

const DEPTH_KEYS: [&str; 2] = ["depth_file_path", "depth_path"];
const LENS_KEYS: [&str; 6] = ["k1", "k2", "k3", "k4", "p1", "p2"];
/// World units per one of a depth file that states none.
const DEPTH_UNIT: f64 = 0.001;
const IMAGE_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

fn recognise(folder: &Folder) -> Option<String> {
    let (name, _) = frame_list(folder)?;
    Some(format!("{name} whose frames name depth files or have cameras of their own"))
}

/// The JSON file in the root that is a frame list of this layout, and what it holds.
fn frame_list(folder: &Folder) -> Option<(&str, Value)> {
    folder.listing.files().filter(|name| name.ends_with(".json")).find_map(|name| {
        let (_, text) = folder.text(name).ok()?;
        let json = serde_json::from_str(&text).ok().filter(is_list)?;
        Some((name, json))
    })
}

/// Whether a JSON value is a frame list of this layout, and not of NeRF-synthetic.
pub(super) fn is_list(json: &Value) -> bool {
    let frames = json.get("frames").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let named = |keys: &[&str], frame: &Value| keys.iter().any(|key| frame.get(key).is_some());
    let lens =
        LENS_KEYS.iter().any(|key| json.get(key).and_then(Value::as_f64).unwrap_or(0.0) != 0.0);
    let is_posed = frames.iter().any(|frame| frame.get("transform_matrix").is_some());
    let own = |frame: &Value| named(&DEPTH_KEYS, frame) || named(&["fl_x"], frame);
    is_posed && (lens || frames.iter().any(own))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let Some((name, json)) = frame_list(folder) else { return Ok(recording.finish()) };
    let file = folder.path.join(name);
    let list = FrameList { json: &json, file: &file };
    list.check_model()?;
    let encoding = list.encoding(&recording)?;
    let frames = json.get("frames").and_then(Value::as_array).map_or(&[][..], Vec::as_slice);
    let mut seen = BTreeSet::new();
    let mut depth_size = None;
    for (i, frame) in frames.iter().enumerate() {
        let name = frame.get("file_path").and_then(Value::as_str);
        let name = name.map_or_else(|| i.to_string(), |n| n.trim_start_matches("./").to_owned());
        if folder.has_taken(&name) {
            continue;
        }
        if !seen.insert(name.clone()) {
            let problem = FrameProblem::Doubled(format!("another entry `{name}`"));
            recording.skip(&name, file.clone(), problem);
            continue;
        }
        match list.recorded(frame, &name, &recording, encoding, &mut depth_size) {
            Ok(Ok(frame)) => recording.push(frame),
            Ok(Err(problem)) => recording.skip(&name, file.clone(), problem),
            Err(error) => return Err(error),
        }
    }
    Ok(recording.finish())
}

/// The list and the numbers that stand for all frames.
struct FrameList<'a> {
    json: &'a Value,
    file: &'a Path,
}

impl FrameList<'_> {
    /// A number of a frame, or of all.
    fn number(&self, frame: &Value, key: &str) -> Result<Option<f64>, DatasetError> {
        let Some(value) = frame.get(key).or_else(|| self.json.get(key)) else { return Ok(None) };
        let number = value.as_f64().filter(|number| number.is_finite());
        number.map(Some).ok_or_else(|| {
            let expected = format!("a number as `{key}`");
            wrong(self.file, &expected, describe(value), "correct the value")
        })
    }

    /// Lenses that are no pinhole behind Brown and Conrady's terms.
    fn check_model(&self) -> Result<(), DatasetError> {
        let model = self.json.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
        let known =
            ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "RADIAL", "SIMPLE_RADIAL", "PERSPECTIVE"];
        let fourth = self.number(&Value::Null, "k4")?.unwrap_or(0.0);
        if known.contains(&model) && fourth == 0.0 {
            return Ok(());
        }
        let found = match fourth == 0.0 {
            true => format!("`camera_model` {model}"),
            false => format!("`k4` {fourth}"),
        };
        let expected = "a perspective camera with k1, k2, k3, p1, p2";
        Err(wrong(self.file, expected, found, "undistort the images to a pinhole first"))
    }

    fn encoding(&self, recording: &Recording) -> Result<DepthEncoding, DatasetError> {
        let mut unit = DEPTH_UNIT;
        for key in ["depth_unit_scale_factor", "integer_depth_scale"] {
            if let Some(stated) = self.number(&Value::Null, key)? {
                if stated <= 0.0 {
                    let expected = format!("a positive `{key}`, world units for one");
                    let hint = "correct the value";
                    return Err(wrong(self.file, &expected, stated.to_string(), hint));
                }
                unit = stated;
                break;
            }
        }
        let trusted = [0.0, f64::INFINITY];
        Ok(recording.encoding(CodeKind::ByContent(unit), Sensor::Lidar, trusted))
    }

    /// The outer error is one of the whole list, the inner one of this frame.
    fn recorded(
        &self,
        frame: &Value,
        name: &str,
        recording: &Recording,
        encoding: DepthEncoding,
        depth_size: &mut Option<(u32, u32)>,
    ) -> Result<Result<RecordedFrame, FrameProblem>, DatasetError> {
        let read = || {
            let pose = Pose::from_opengl(from_json(frame.get("transform_matrix"))?)?;
            let color = photograph(recording.folder, name)?;
            let depth = DEPTH_KEYS.iter().find_map(|key| frame.get(key)).and_then(Value::as_str);
            let depth = depth.map(|text| depth_file(recording.folder, text)).transpose()?;
            let header = decode::header(&color)?;
            Ok::<_, FrameProblem>((pose, color, depth, (header.width, header.height)))
        };
        let (pose, color, depth, size) = match read() {
            Ok(found) => found,
            Err(problem) => return Ok(Err(problem)),
        };
        let k = self.intrinsics(frame, size)?;
        // All depth of a list is of one size, as that of one sensor is: it is asked once.
        if depth_size.is_none() {
            *depth_size = depth.as_ref().and_then(|file| decode::depth_size(file).ok());
        }
        let cameras = recording.one_lens(&k, size, depth_size.unwrap_or(size), self.file)?;
        let depth = depth.map(|file| DepthSource { file, encoding, confidence: None });
        let (lens, time) = (self.lens(frame)?, self.time(frame)?);
        let name = name.to_owned();
        Ok(Ok(RecordedFrame { name, time, pose, cameras, color, depth, lens }))
    }

    fn intrinsics(&self, frame: &Value, size: (u32, u32)) -> Result<Intrinsics, DatasetError> {
        let (width, height) = size;
        let side = |n: Option<f64>, found: u32| n.map_or(found, |n| n as u32);
        let stated =
            (side(self.number(frame, "w")?, width), side(self.number(frame, "h")?, height));
        same_size(stated, size, self.file)?;
        let fx = match (self.number(frame, "fl_x")?, self.number(frame, "camera_angle_x")?) {
            (Some(fx), _) => fx,
            (None, Some(angle)) => Intrinsics::from_horizontal_fov(width, height, angle).fx,
            (None, None) => {
                let found = describe(frame);
                let hint = "add the focal length in pixels";
                return Err(wrong(self.file, "a number `fl_x`", found, hint));
            }
        };
        Ok(Intrinsics {
            width,
            height,
            fx,
            fy: self.number(frame, "fl_y")?.unwrap_or(fx),
            cx: self.number(frame, "cx")?.unwrap_or(0.5 * f64::from(width)),
            cy: self.number(frame, "cy")?.unwrap_or(0.5 * f64::from(height)),
        })
    }

    fn lens(&self, frame: &Value) -> Result<Distortion, DatasetError> {
        let term = |key: &str| Ok::<_, DatasetError>(self.number(frame, key)?.unwrap_or(0.0));
        Ok(Distortion {
            radial: [term("k1")?, term("k2")?, term("k3")?],
            tangential: [term("p1")?, term("p2")?],
        })
    }

    fn time(&self, frame: &Value) -> Result<Option<f64>, DatasetError> {
        match frame.get("timestamp") {
            Some(_) => self.number(frame, "timestamp"),
            None => Ok(None),
        }
    }
}

/// The photograph, whose name may lack the extension.
fn photograph(folder: &Folder, name: &str) -> Result<ByteSource, FrameProblem> {
    let with = IMAGE_EXTENSIONS.iter().map(|extension| format!("{name}.{extension}"));
    file_of(folder, std::iter::once(name.to_owned()).chain(with))?
        .ok_or_else(|| FrameProblem::MissingColor(name.to_owned()))
}

fn depth_file(folder: &Folder, name: &str) -> Result<ByteSource, FrameProblem> {
    let names = [name.to_owned(), format!("{name}.png")];
    file_of(folder, names.into_iter())?.ok_or_else(|| FrameProblem::MissingDepth(name.to_owned()))
}

fn file_of(
    folder: &Folder,
    names: impl Iterator<Item = String>,
) -> Result<Option<ByteSource>, FrameProblem> {
    let is_file = |path: &PathBuf| path.is_file();
    for name in names {
        match folder.named(&name) {
            Ok(path) if is_file(&path) => return Ok(Some(path.into())),
            Ok(_) => {}
            Err(FrameProblem::Read(e)) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(problem) => return Err(problem),
        }
    }
    Ok(None)
}
