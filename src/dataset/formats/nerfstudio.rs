//! nerfstudio: `transforms.json` whose frames name depth files (`depth_file_path`, or `depth_path` in
//! NeRFCapture) or have cameras of their own; OpenGL axes.
//!
//! Every camera parameter (`fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1`, `k2`, `k3`, `p1`, `p2`, or
//! `distortion_params`) is given in the frame or, for all frames, at the top level. Depth along the optical
//! axis is the stored value times `depth_unit_scale_factor` (NeRFCapture: `integer_depth_scale`), by default
//! 0.001.

use super::numbered::PHOTOGRAPHS;
use super::recording::{ANY_RANGE, Recording, encoding, frame_entry, metadata_error, same_size};
use super::stated::{
    FrameCamera, LENS_TERMS, array, check_model, entry_name, first_of, flat_numbers, majority,
    name_unused_keys,
};
use crate::dataset::decode;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{DepthSource, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, is_file};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix::{describe_json, from_json};
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "nerfstudio: a JSON file whose `frames` have a `depth_file_path`, or cameras of their own",
    poses: PoseConvention::Opengl,
    recognise,
    parse,
};

const DEPTH_KEYS: [&str; 2] = ["depth_file_path", "depth_path"];
// `k4` is refused on opening, but marks a list of this layout.
const LENS_KEYS: [&str; 6] = ["k1", "k2", "k3", "k4", "p1", "p2"];

fn recognise(folder: &Folder) -> Option<String> {
    let (name, _) = frame_list(folder)?;
    Some(format!("{name} whose frames name depth files or have cameras of their own"))
}

fn frame_list(folder: &Folder) -> Option<(&str, Value)> {
    folder.listing.files().filter(|name| name.ends_with(".json")).find_map(|name| {
        let json = serde_json::from_str(&folder.peek_whole(name)).ok().filter(is_list)?;
        Some((name, json))
    })
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
    let is_posed = frames.iter().any(|frame| frame.get("transform_matrix").is_some());
    let own = |frame: &Value| named(&DEPTH_KEYS, frame) || named(&["fl_x"], frame);
    is_posed && (lens || frames.iter().any(own))
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let Some((name, json)) = frame_list(folder) else { return Ok(recording.finish()) };
    let file = folder.path.join(name);
    let list = FrameList { json: &json, file: &file };
    let encoding = list.encoding(&recording)?;
    let frames = array(&json, "frames");
    let mut seen = BTreeSet::new();
    // Lens terms are used or refused.
    let used = [&LENS_TERMS[..], &["distortion_params", "depth_unit_scale_factor"]].concat();
    for object in std::iter::once(&json).chain(frames.first()) {
        name_unused_keys(&mut recording, &file, object, &used);
    }
    let sizes = list.sizes(folder, frames)?;
    for (i, frame) in frames.iter().enumerate() {
        let name = entry_name(frame, i);
        if folder.was_taken(&name) {
            continue;
        }
        if !seen.insert(name.clone()) {
            let problem = FrameProblem::Duplicate(format!("another entry `{name}`"));
            recording.skip(&name, file.clone(), problem);
            continue;
        }
        let frame = list.recorded(frame, &name, &recording, encoding, sizes)?;
        recording.add(&name, &file, frame);
    }
    Ok(recording.finish())
}

/// Most frequent size of photographs and most frequent size of depth images; `None` if none can be read.
type Sizes = [Option<(u32, u32)>; 2];

fn has_own_camera(frame: &Value) -> bool {
    first_of(frame, &["fl_x", "w", "camera_angle_x"]).is_some()
}

struct FrameList<'a> {
    json: &'a Value,
    file: &'a Path,
}

impl FrameList<'_> {
    fn camera<'a>(&'a self, frame: &'a Value) -> FrameCamera<'a> {
        FrameCamera { frame, list: self.json, file: self.file }
    }

    /// Returns the most frequent size of photographs and that of depth images. Intrinsics common to all
    /// frames refer to the photographs' size.
    ///
    /// # Errors
    /// Fails if most photographs differ from the size that the list states.
    fn sizes(&self, folder: &Folder, frames: &[Value]) -> Result<Sizes, DatasetError> {
        let named = |keys: &[&str]| -> Vec<&str> {
            frames.iter().filter_map(|frame| first_of(frame, keys)?.as_str()).collect()
        };
        let color = majority(&named(&["file_path"]), |name| {
            decode::header(&photograph(folder, name)?).map(|header| (header.width, header.height))
        });
        let depth =
            majority(&named(&DEPTH_KEYS), |name| decode::depth_size(&depth_file(folder, name)?));
        // Unreadable files are reported with their frames.
        let (color, depth) = (color.ok().flatten(), depth.ok().flatten());
        if let Some(size) = color.filter(|_| !frames.iter().any(has_own_camera)) {
            same_size(self.camera(&Value::Null).size(size)?, size, self.file)?;
        }
        Ok([color, depth])
    }

    fn encoding(&self, recording: &Recording) -> Result<DepthEncoding, DatasetError> {
        let mut unit = MILLIMETRE;
        for key in ["depth_unit_scale_factor", "integer_depth_scale"] {
            if let Some(stated) = self.camera(&Value::Null).number(key)? {
                if stated <= 0.0 {
                    let expected = format!("a positive `{key}`, world units per unit");
                    let hint = "correct the value";
                    return Err(metadata_error(self.file, &expected, stated.to_string(), hint));
                }
                unit = stated;
                break;
            }
        }
        // World units are arbitrary, so no length is beyond the sensor.
        Ok(encoding(recording.options, CodeKind::ByContent(unit), Sensor::Lidar, ANY_RANGE))
    }

    /// Creates the frame of an entry. The outer error aborts opening the dataset; the inner error skips
    /// the frame.
    fn recorded(
        &self,
        frame: &Value,
        name: &str,
        recording: &Recording,
        encoding: DepthEncoding,
        [most_color, most_depth]: Sizes,
    ) -> Result<Result<FrameEntry, FrameProblem>, DatasetError> {
        let read = || {
            let pose = Pose::from_opengl(from_json(frame.get("transform_matrix"))?)?;
            let color = photograph(recording.folder, name)?;
            let depth = first_of(frame, &DEPTH_KEYS).and_then(Value::as_str);
            let depth = depth.map(|text| depth_file(recording.folder, text)).transpose()?;
            // The frame's own size: images of one list may differ.
            let header = decode::header(&color)?;
            Ok::<_, FrameProblem>((pose, color, depth, (header.width, header.height)))
        };
        let (pose, color, depth, size) = match read() {
            Ok(found) => found,
            Err(problem) => return Ok(Err(problem)),
        };
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
        let depth = depth.map(|file| DepthSource::new(file, encoding));
        // Only a time of the frame itself: `number` would fall back to one of the list.
        let time = match frame.get("timestamp") {
            Some(_) => camera.number("timestamp")?,
            None => None,
        };
        let cameras = cameras.with_lens(self.lens(&camera)?, self.file)?;
        let frame = frame_entry(name.to_owned(), pose, cameras, color, depth);
        Ok(Ok(FrameEntry { time, ..frame }))
    }

    /// Returns the lens, stated term by term or as the list `distortion_params` of k1 k2 k3 k4 p1 p2.
    fn lens(&self, camera: &FrameCamera) -> Result<Distortion, DatasetError> {
        const LIST: &str = "distortion_params";
        let term = |key: &str| Ok::<_, DatasetError>(camera.number(key)?.unwrap_or(0.0));
        let [k1, k2, k3, p1, p2] = match camera.frame.get(LIST).or_else(|| self.json.get(LIST)) {
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

fn depth_file(folder: &Folder, name: &str) -> Result<ByteSource, FrameProblem> {
    let names = [name.to_owned(), format!("{name}.png")];
    file_of(folder, names.into_iter())?.ok_or_else(|| FrameProblem::MissingDepth(name.to_owned()))
}

fn file_of(
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
