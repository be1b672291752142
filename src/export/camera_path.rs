//! Camera paths as versioned JSON files.

use crate::math::camera::{Camera, Intrinsics};
use crate::math::camera_path::{CameraPath, Keyframe};
use crate::math::pose::Pose;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use std::io;
use std::path::{Path, PathBuf};

const VERSION: u32 = 1;
/// Maximum number of pictures rendered along a path.
// One hour at 30 fps.
const MAX_PICTURES: f64 = 108_000.0;
// 10,000 keyframes take 2 MB.
const MAX_BYTES: u64 = 16 << 20;
/// Vertical field of view of keyframes without `fov_y`, in degrees.
const DEFAULT_FOV: f64 = 50.0;

/// Camera path with its frame rate.
#[derive(Clone, Debug, PartialEq)]
pub struct PacedPath {
    /// The camera path.
    pub path: CameraPath,
    /// Frames per second.
    pub fps: f64,
}

/// Error of reading a camera path.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum CameraPathError {
    /// The file could not be read.
    #[error("{}: expected a readable camera path, found: {error}; check the name and the \
             permissions", path.display())]
    Io { path: PathBuf, error: io::Error },
    /// The file is not JSON of the expected form.
    #[error(
        "{}: expected JSON such as {{\"version\": 1, \"fps\": 30, \"keyframes\": [{{\"time\": 0, \"eye\": [0, -3, 1], \"target\": [0, 0, 0]}}, …]}}, found: {error}",
        path.display()
    )]
    Json { path: PathBuf, error: serde_json::Error },
    /// A value is out of range.
    #[error("{}: {of}: expected {expected}, found {found}", path.display())]
    Value { path: PathBuf, of: String, expected: &'static str, found: String },
}

#[derive(Serialize, Deserialize)]
// A misspelt optional field would be ignored silently.
#[serde(deny_unknown_fields)]
struct FileText {
    version: u32,
    #[serde(default = "usual_fps")]
    fps: f64,
    #[serde(default, rename = "loop")]
    is_loop: bool,
    keyframes: Vec<KeyframeText>,
}

/// Keyframe in the file. The pose is given by a rotation (quaternion x, y, z, w; camera to world, OpenCV
/// axes) or by a target point.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeyframeText {
    time: f64,
    eye: [f64; 3],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rotation: Option<[f64; 4]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    target: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    up: Option<[f64; 3]>,
    #[serde(default = "usual_fov")]
    fov_y: f64,
}

fn usual_fps() -> f64 {
    30.0
}

fn usual_fov() -> f64 {
    DEFAULT_FOV
}

impl PacedPath {
    /// Reads a camera path from a JSON file. Keyframes without an up direction get `up`, a unit vector.
    ///
    /// # Errors
    /// [`CameraPathError`], which names the file.
    pub fn read(path: &Path, up: DVec3) -> Result<Self, CameraPathError> {
        let failed = |error| CameraPathError::Io { path: path.to_owned(), error };
        // Checked before reading, so that a wrong file cannot exhaust the memory.
        let found = std::fs::metadata(path).map_err(failed)?;
        if !found.is_file() || found.len() > MAX_BYTES {
            let found = match found.is_file() {
                true => format!("{} bytes", found.len()),
                // Opening a FIFO would block, and a device may never end.
                false => "a folder, FIFO or device".to_owned(),
            };
            return Err(value_error(path, "file", "a file of at most 16 MiB", found));
        }
        let bytes = std::fs::read(path).map_err(failed)?;
        let text: FileText = serde_json::from_slice(&bytes)
            .map_err(|error| CameraPathError::Json { path: path.to_owned(), error })?;
        text.path(path, up)
    }

    /// Returns the path as JSON text.
    pub fn to_json(&self) -> String {
        let keyframe = |keyframe: &Keyframe| KeyframeText {
            time: keyframe.time,
            eye: keyframe.pose.centre().to_array(),
            rotation: Some(DQuat::from_mat3(&keyframe.pose.rotation()).to_array()),
            target: None,
            up: None,
            fov_y: keyframe.fov_y.to_degrees(),
        };
        let text = FileText {
            version: VERSION,
            fps: self.fps,
            is_loop: self.path.is_loop(),
            keyframes: self.path.keyframes().iter().map(keyframe).collect(),
        };
        // Only numbers and lists: serialization cannot fail.
        serde_json::to_string_pretty(&text).unwrap_or_default()
    }

    /// Returns the interpolated keyframe of every picture. A closed path omits its last keyframe, which
    /// equals the first.
    pub fn keyframe_per_frame(&self) -> impl ExactSizeIterator<Item = Keyframe> {
        // A path shorter than a frame still has its two ends.
        let steps = (self.path.duration() * self.fps).round().max(1.0) as usize;
        let n = if self.path.is_loop() { steps } else { steps + 1 };
        (0..n).map(|i| self.path.at(i as f64 / self.fps))
    }

    /// Returns the pinhole camera of every picture, for images of `[width, height]` pixels.
    pub fn cameras(&self, [width, height]: [u32; 2]) -> impl ExactSizeIterator<Item = Camera> {
        self.keyframe_per_frame().map(move |Keyframe { pose, fov_y, .. }| Camera {
            intrinsics: Intrinsics::from_vertical_fov(width, height, fov_y),
            pose,
        })
    }
}

impl FileText {
    fn path(self, file: &Path, up: DVec3) -> Result<PacedPath, CameraPathError> {
        let refuse =
            |of: &str, expected, found: String| Err(value_error(file, of, expected, found));
        if self.version != VERSION {
            return refuse(
                "version",
                "1; a newer program wrote the file",
                self.version.to_string(),
            );
        }
        // Negated, so that NaN is refused as well.
        if !(self.fps > 0.0 && self.fps <= 1000.0) {
            return refuse("fps", "more than 0, at most 1000", self.fps.to_string());
        }
        let mut keyframes: Vec<Keyframe> = Vec::with_capacity(self.keyframes.len());
        for (i, text) in self.keyframes.iter().enumerate() {
            let keyframe = text.keyframe(file, i, up)?;
            if keyframes.last().is_some_and(|last| last.time >= keyframe.time) {
                let of = format!("keyframes[{i}].time");
                return refuse(&of, "more than the previous keyframe's", text.time.to_string());
            }
            keyframes.push(keyframe);
        }
        let n = keyframes.len();
        let ends = keyframes.first().zip(keyframes.last()).map(|(a, b)| [a.pose, b.pose]);
        let path = CameraPath::new(keyframes, self.is_loop);
        let Some((path, [first, last])) = path.zip(ends) else {
            return refuse("keyframes", "two or more", n.to_string());
        };
        let (apart, turn) = first.offset_to(&last);
        // Relative, because coordinates far from zero are rounded more. No rotation means |w| = 1: a
        // quaternion and its negative are the same rotation.
        if self.is_loop
            && (apart.length() > 1e-6 * (1.0 + first.centre().length())
                || turn.w.abs() < 1.0 - 1e-9)
        {
            let of = format!("keyframes[{}]", n - 1);
            return refuse(
                &of,
                "the first keyframe's camera, as `loop` requires",
                "another".to_owned(),
            );
        }
        let pictures = path.duration() * self.fps;
        if pictures > MAX_PICTURES {
            let expected = "at most 108,000 pictures; lower `fps` or shorten the path";
            return refuse("fps", expected, format!("{pictures:.0}"));
        }
        Ok(PacedPath { path, fps: self.fps })
    }
}

impl KeyframeText {
    fn keyframe(&self, file: &Path, i: usize, up: DVec3) -> Result<Keyframe, CameraPathError> {
        let refuse = |of: &str, expected, found: String| {
            value_error(file, &format!("keyframes[{i}].{of}"), expected, found)
        };
        let numbers = [Some(&self.eye), self.target.as_ref(), self.up.as_ref()];
        if let Some(found) = numbers.into_iter().flatten().find(|v| !is_in_range(v)) {
            return Err(refuse("eye", "numbers up to 1e9 on every axis", format!("{found:?}")));
        }
        if !(self.time.is_finite() && self.time.abs() <= 1e6) {
            return Err(refuse("time", "seconds, up to 1e6", self.time.to_string()));
        }
        // Negated, so that NaN is refused as well.
        if !(self.fov_y > 1.0 && self.fov_y < 170.0) {
            let expected = "more than 1 and less than 170 degrees";
            return Err(refuse("fov_y", expected, self.fov_y.to_string()));
        }
        let eye = DVec3::from_array(self.eye);
        let pose = match (self.rotation, self.target) {
            (Some(rotation), None) if self.up.is_none() => {
                let turn = DQuat::from_array(rotation);
                let length = turn.length();
                if !(length > 1e-3 && length < 1e3) {
                    let expected = "a quaternion x, y, z, w of length 1";
                    return Err(refuse("rotation", expected, format!("{rotation:?}")));
                }
                Pose::IDENTITY.attached_camera(eye, turn)
            }
            (None, Some(target)) => {
                let up = self.up.map_or(up, DVec3::from_array);
                let pose = Pose::look_at(eye, DVec3::from_array(target), up);
                let expected = "a point away from the eye, not straight above or below it";
                pose.ok_or_else(|| refuse("target", expected, format!("{target:?}")))?
            }
            (rotation, _) => {
                let expected = "either `rotation`, or `target` with or without `up`";
                let found = if rotation.is_some() { "both" } else { "neither" };
                return Err(refuse("rotation", expected, found.to_owned()));
            }
        };
        Ok(Keyframe { time: self.time, pose, fov_y: self.fov_y.to_radians() })
    }
}

fn is_in_range(place: &[f64; 3]) -> bool {
    // False for NaN as well.
    place.iter().all(|x| x.abs() <= 1e9)
}

fn value_error(path: &Path, of: &str, expected: &'static str, found: String) -> CameraPathError {
    CameraPathError::Value { path: path.to_owned(), of: of.to_owned(), expected, found }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<PacedPath, String> {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("way.json");
        std::fs::write(&file, text).unwrap();
        PacedPath::read(&file, DVec3::Z).map_err(|error| error.to_string())
    }

    fn with(keyframes: &str) -> Result<PacedPath, String> {
        read(&format!(r#"{{"version": 1, "fps": 10, "keyframes": [{keyframes}]}}"#))
    }

    const FIRST: &str = r#"{"time": 0, "eye": [0, -3, 1], "target": [0, 0, 0]}"#;
    const LAST: &str =
        r#"{"time": 2, "eye": [3, 0, 1], "rotation": [0.5, -0.5, 0.5, -0.5], "fov_y": 40}"#;

    #[test]
    fn what_is_written_is_read_again() {
        let paced = with(&format!("{FIRST}, {LAST}")).unwrap();
        assert_eq!((paced.keyframe_per_frame().len(), paced.path.duration()), (21, 2.0));
        let again = read(&paced.to_json()).unwrap();
        for (a, b) in paced.keyframe_per_frame().zip(again.keyframe_per_frame()) {
            assert!(a.pose.centre().distance(b.pose.centre()) < 1e-9);
            assert!(a.pose.forward().distance(b.pose.forward()) < 1e-9);
            assert!((a.fov_y - b.fov_y).abs() < 1e-9);
        }
        let open = paced.to_json().replace("false", "true");
        assert!(read(&open).unwrap_err().contains(
            "keyframes[1]: expected the first keyframe's \
                                                   camera"
        ));
        let back = FIRST.replace("\"time\": 0", "\"time\": 4");
        let round = with(&format!("{FIRST}, {LAST}, {back}")).unwrap().to_json();
        let round = read(&round.replace("false", "true")).unwrap();
        assert_eq!(round.keyframe_per_frame().len(), 40, "the last keyframe is the first");
    }

    #[test]
    fn wrong_files_are_refused_with_what_is_wrong() {
        let at =
            |time: &str, rest: &str| format!(r#"{{"time": {time}, "eye": [0, -3, 1], {rest}}}"#);
        for (keyframes, parts) in [
            (FIRST.to_owned(), ["keyframes", "two or more", "found 1"]),
            (format!("{FIRST}, {FIRST}"), ["keyframes[1].time", "more than", "found 0"]),
            (
                at("0", r#""target": [0, -3, 9]"#),
                ["keyframes[0].target", "away", "[0.0, -3.0, 9.0]"],
            ),
            (at("0", r#""rotation": [0, 0, 0, 0]"#), ["keyframes[0].rotation", "length 1", "0.0"]),
            (at("0", r#""fov_y": 40"#), ["keyframes[0].rotation", "either", "neither"]),
            (at("0", r#""target": [0, 0, 1e300]"#), ["keyframes[0].eye", "1e9", "1e300"]),
            (at("1e9", r#""target": [0, 0, 1]"#), ["keyframes[0].time", "seconds", "1000000000"]),
            (at("0", r#""target": [0, 0, 1], "fov_y": 0"#), ["fov_y", "170", "found 0"]),
            (at("0", r#""target": [0, 0, 1], "roll": 0"#), ["way.json", "unknown field", "roll"]),
            (format!("{FIRST}, {}", LAST.replace("2,", "20000,")), ["fps", "108,000", "200000"]),
        ] {
            let said = with(&keyframes).unwrap_err();
            assert!(parts.iter().all(|part| said.contains(part)), "{parts:?}: {said}");
            assert!(said.contains("way.json"), "{said}");
        }
        let newer = read(r#"{"version": 2, "keyframes": []}"#).unwrap_err();
        assert!(newer.contains("version: expected 1"), "{newer}");
        let still = read(r#"{"version": 1, "fps": 0, "keyframes": []}"#).unwrap_err();
        assert!(still.contains("fps: expected more than 0"), "{still}");
        assert!(read("no json").unwrap_err().contains("expected JSON such as"));
    }

    #[test]
    fn a_closed_path_ends_where_it_begins() {
        let camera = |time: u32, x: f64, turn: &str| {
            format!(r#"{{"time": {time}, "eye": [{x}, 0, 0], "rotation": [{turn}]}}"#)
        };
        let closed = |x: f64, last: f64, turn: &str| {
            let keyframes =
                [camera(0, x, "0, 0, 0, 1"), camera(1, x, "0, 0, 1, 1"), camera(2, last, turn)];
            let keyframes = keyframes.join(", ");
            read(&format!(r#"{{"version": 1, "loop": true, "keyframes": [{keyframes}]}}"#))
        };
        let paced = closed(0.0, 0.0, "0, 0, 0, -1").unwrap();
        assert_eq!((paced.fps, paced.keyframe_per_frame().len()), (30.0, 60));
        // Relative to the distance from zero.
        for (x, last) in [(0.0, 5e-7), (0.0, 1e-6), (1000.0, 1000.0005)] {
            assert!(closed(x, last, "0, 0, 0, 1").is_ok(), "{x} {last}");
        }
        for (x, last, turn) in
            [(0.0, 0.0, "0, 0, 1, 1"), (0.0, 1.0, "0, 0, 0, 1"), (1000.0, 1000.002, "0, 0, 0, 1")]
        {
            assert!(
                closed(x, last, turn).unwrap_err().contains("keyframes[2]: expected the first")
            );
        }
    }

    #[test]
    fn limits_are_exact() {
        let keyframe = |rest: &str| format!(r#"{{"time": 0, "eye": [0, -3, 1], {rest}}}"#);
        for (rest, parts) in [
            (r#""target": [0, 0, 0], "fov_y": 1"#, ["fov_y", "more than 1", "found 1"]),
            (r#""target": [0, 0, 0], "fov_y": 170"#, ["fov_y", "less than 170", "found 170"]),
            (r#""rotation": [0, 0, 0, 1], "up": [0, 0, 1]"#, ["rotation", "either", "both"]),
            (r#""rotation": [0, 0, 0, 0.001]"#, ["rotation", "length 1", "0.001"]),
            (r#""rotation": [0, 0, 0, 1000]"#, ["rotation", "length 1", "1000.0"]),
        ] {
            let found = with(&format!("{}, {LAST}", keyframe(rest))).unwrap_err();
            assert!(parts.iter().all(|part| found.contains(part)), "{parts:?}: {found}");
        }
        let longest = with(&format!("{FIRST}, {}", LAST.replace("2,", "10800,"))).unwrap();
        assert_eq!(longest.keyframe_per_frame().len(), 108_001);
        let folder = tempfile::tempdir().unwrap();
        let found = |path: &Path| PacedPath::read(path, DVec3::Z).unwrap_err().to_string();
        assert!(found(folder.path()).contains("at most 16 MiB, found a folder"));
        let path = folder.path().join("large.json");
        for (bytes, expected) in
            [(MAX_BYTES, "expected JSON such as"), (MAX_BYTES + 1, "found 16777217 bytes")]
        {
            std::fs::File::create(&path).unwrap().set_len(bytes).unwrap();
            assert!(found(&path).contains(expected), "{bytes}");
        }
    }
}
