//! Frames of phones and tablets with lidar, each with images, a camera and a pose of its own.
//!
//! Depth is in millimetres, and shares one lens with the photograph. Intrinsics are for the size that
//! their file states. Without such a size they are for the photographs or, if these were downscaled, for
//! ARKit's video.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    Cameras, LIDAR_RANGE, Recording, check_intrinsics, depth_size, encoding, frame_entry,
    own_camera, photograph_size,
};
use super::stated;
use super::trajectory::time_unit;
use crate::dataset::decode;
use crate::dataset::decode::CodeKind;
use crate::dataset::entry::FrameEntry;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::matrix::describe_json;
use crate::dataset::options::{ByteSource, MILLIMETRE};
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Size of ARKit's video, for which apps state intrinsics.
pub(super) const ARKIT_VIDEO: (u32, u32) = (1920, 1440);

/// What a file states about the camera of one frame.
pub(super) struct StatedCamera {
    pub file: PathBuf,
    /// `fx`, `fy`, `cx` and `cy`, pixels.
    pub intrinsics: [f64; 4],
    /// Image size of the intrinsics, if stated.
    pub size: Option<(u32, u32)>,
    pub pose: Pose,
    /// In any unit.
    pub time: Option<f64>,
}

pub(super) struct LidarImages {
    pub color: ByteSource,
    pub depth: Option<ByteSource>,
    pub confidence: Option<ByteSource>,
}

/// Photographs, depth images and confidence maps by the numbers of their frames.
pub(super) struct NumberedImages {
    pub colors: NumberedFiles,
    depths: Option<NumberedFiles>,
    confidences: Option<NumberedFiles>,
}

impl NumberedImages {
    /// Lists photographs, depth images and confidence maps, each with folder and prefix of their names.
    /// Only the folder of photographs must exist.
    pub fn list(
        recording: &mut Recording,
        [colors, depths, confidences]: [(&str, &str); 3],
    ) -> Result<Self, DatasetError> {
        let colors = recording.list(colors.0, colors.1, &PHOTOGRAPHS)?;
        let mut optional = |(name, prefix): (&str, &str)| {
            let is_there = name.is_empty() || recording.folder.has_folder(name);
            is_there.then(|| recording.list(name, prefix, &["png"])).transpose()
        };
        Ok(Self { colors, depths: optional(depths)?, confidences: optional(confidences)? })
    }

    /// Returns the name of a photograph without extension, or the number.
    pub fn name(&self, number: u64) -> String {
        self.colors.stem(number).map_or_else(|| number.to_string(), str::to_owned)
    }

    /// Returns the numbers of depth images without photograph.
    pub fn bare_depths(&self) -> impl Iterator<Item = u64> {
        let depths = self.depths.iter().flat_map(NumberedFiles::numbers);
        depths.filter(|number| self.colors.stem(*number).is_none())
    }

    /// Returns the images of a frame. A depth image may be missing, because a recording may have none.
    pub fn of(&self, folder: &Folder, number: u64) -> Result<LidarImages, FrameProblem> {
        let optional = |files: &Option<NumberedFiles>| {
            let file = files.as_ref().and_then(|files| files.file(folder, number));
            file.transpose().map(|file| file.map(ByteSource::File))
        };
        let missing = FrameProblem::MissingColor(format!("number {number}"));
        let color = self.colors.required(folder, number, missing)?;
        let (depth, confidence) = (optional(&self.depths)?, optional(&self.confidences)?);
        let has_maps = || self.confidences.as_ref().is_some_and(|c| c.numbers().next().is_some());
        if depth.is_some() && confidence.is_none() && has_maps() {
            return Err(FrameProblem::MissingConfidence(format!("number {number}")));
        }
        Ok(LidarImages { color, depth, confidence })
    }
}

/// Adds the frames that `read` makes from their names and other data. A problem costs its frame and is
/// reported for `file`.
pub(super) fn add_frames<T>(
    recording: &mut Recording,
    listed: impl IntoIterator<Item = (String, T)>,
    file: &Path,
    read: impl Fn(&str, T) -> Result<(LidarImages, StatedCamera), FrameProblem>,
) {
    let mut frames = Vec::new();
    for (name, data) in listed {
        if recording.folder.was_taken(&name) {
            continue;
        }
        match read(&name, data) {
            Ok((images, camera)) => frames.push((name, images, camera)),
            Err(problem) => recording.skip(&name, file.to_owned(), problem),
        }
    }
    let colors = frames.iter().map(|(_, images, _)| &images.color);
    let Some(size) = recording.warn_unreadable(photograph_size(colors)) else { return };
    let depths: Vec<_> = frames.iter().filter_map(|(_, images, _)| images.depth.as_ref()).collect();
    // Photographs alone have no depth image of any size.
    let depth_size = match depths.is_empty() {
        true => Some(size),
        false => recording.warn_unreadable(depth_size(depths)),
    };
    let Some(depth_size) = depth_size else { return };
    let times: Vec<f64> = frames.iter().filter_map(|(_, _, camera)| camera.time).collect();
    let unit = time_unit(&times);
    let codes = CodeKind::ByContent(MILLIMETRE);
    let encoding = encoding(recording.options, codes, Sensor::Lidar, LIDAR_RANGE);
    let mut rescaled = None;
    for (name, LidarImages { color, depth, confidence }, camera) in frames {
        let cameras = cameras(recording, &color, &camera, [size, depth_size]);
        let frame = cameras.map(|(cameras, sizes)| {
            rescaled = rescaled.or(Some(sizes).filter(|[stated, found]| stated != found));
            let depth = depth.map(|d| recording.depth_with_confidence(d, encoding, confidence));
            let time = camera.time.map(|time| time * unit);
            FrameEntry { time, ..frame_entry(name.clone(), camera.pose, cameras, color, depth) }
        });
        recording.add(&name, &camera.file, frame);
    }
    if let Some([stated, photographs]) = rescaled {
        let [stated, found] = [stated, photographs].map(|(w, h)| format!("{w}x{h}"));
        recording.note(format!(
            "cameras are stated for images of {stated} and scaled to photographs of {found}"
        ));
    }
}

/// Returns the cameras of a frame, and the sizes of its intrinsics and of its photograph. `usual` is the size
/// of most photographs, `depth` that of most depth images.
fn cameras(
    recording: &Recording,
    color: &ByteSource,
    camera: &StatedCamera,
    [usual, depth]: [(u32, u32); 2],
) -> Result<(Cameras, [(u32, u32); 2]), FrameProblem> {
    let [fx, fy, cx, cy] = camera.intrinsics;
    let of = |(width, height)| Intrinsics { width, height, fx, fy, cx, cy };
    let photograph = match camera.size.is_some_and(|stated| stated != usual) {
        // A frame may differ from the others.
        true => decode::header(color).map(|header| (header.width, header.height))?,
        false => usual,
    };
    let fits = |size: &(u32, u32)| check_intrinsics(&of(*size), &camera.file).is_ok();
    let likely = || [photograph, ARKIT_VIDEO].into_iter().find(fits);
    let stated = camera.size.or_else(likely).unwrap_or(photograph);
    let cameras = recording.cameras_of_lens(&of(stated), photograph, depth, &camera.file);
    Ok((cameras.map_err(own_camera)?, [stated, photograph]))
}

/// Returns the values of the keys; `None` unless all are numbers.
pub(super) fn numbers<const N: usize>(json: &Value, keys: [&str; N]) -> Option<[f64; N]> {
    let mut found = [0.0; N];
    for (number, key) in found.iter_mut().zip(keys) {
        *number = json.get(key)?.as_f64()?;
    }
    Some(found)
}

/// Returns `fx`, `fy`, `cx` and `cy` of the camera matrix under a key.
pub(super) fn camera_matrix(json: &Value, key: &str) -> Option<[f64; 4]> {
    // The size has no effect on the numbers.
    let k = stated::from_json(json.get(key)?, (0, 0))?;
    Some([k.fx, k.fy, k.cx, k.cy])
}

/// Returns the problem of a frame whose JSON lacks usable numbers under its keys.
pub(super) fn wrong_entry(expected: &'static str, json: &Value) -> FrameProblem {
    FrameProblem::Entry { expected, found: describe_json(json) }
}
