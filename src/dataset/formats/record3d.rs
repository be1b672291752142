//! Record3D, an app for iPhones: its `.r3d` archives and its exported folders.
//!
//! Both contain `metadata`, one JSON object. `K` is nine numbers by columns, for images of the photograph's
//! size; `poses` has one `qx qy qz qw tx ty tz` per frame, camera to world in OpenGL axes. The archive
//! contains
//! `rgbd/N.jpg`, `rgbd/N.depth` (32-bit floats in metres, LZFSE-compressed) and `rgbd/N.conf` (0 to 2); the
//! folder contains `rgb/N.jpg` and `depth/N.exr`. `perFrameIntrinsicCoeffs` (`fx fy cx cy`) are the
//! intrinsics of each frame, which autofocus changes.

use super::recording::{self, Cameras, RecordedFrame, Recording, metadata_error, same_size};
use super::stated;
use super::trajectory::TimedPose;
use crate::dataset::decode::CodeKind;
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::matrix::describe_json;
use crate::dataset::source::ByteSource;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::PathBuf;

/// Metres; beyond it, the depth is inferred from the photograph and not measured by the lidar.
const TRUSTED_DEPTH: [f64; 2] = [0.1, 5.0];

/// Metadata of a recording.
pub(super) struct Metadata {
    pub file: PathBuf,
    json: Value,
}

pub(super) struct FrameSources {
    pub color: ByteSource,
    pub depth: Option<ByteSource>,
    pub confidence: Option<ByteSource>,
}

impl Metadata {
    /// True for JSON text of this app.
    pub fn is_one(text: &[u8]) -> bool {
        serde_json::from_slice::<Value>(text)
            .is_ok_and(|json| json.get("K").is_some() && json.get("poses").is_some())
    }

    pub fn new(file: PathBuf, text: &[u8]) -> Result<Self, DatasetError> {
        match serde_json::from_slice(text) {
            Ok(json) => Ok(Self { file, json }),
            Err(source) => Err(DatasetError::Json { file, source }),
        }
    }

    /// Adds the numbered frames to the recording; `codes` is their depth encoding.
    pub fn record(
        &self,
        recording: &mut Recording,
        frames: &BTreeMap<u64, FrameSources>,
        codes: CodeKind,
    ) -> Result<(), DatasetError> {
        let colors = frames.values().map(|frame| &frame.color);
        let size = match recording::photograph_size(colors) {
            Ok(Some(size)) => size,
            Ok(None) => return Ok(()),
            Err((file, problem)) => {
                recording.skip("all", file, problem);
                return Ok(());
            }
        };
        let k = self.intrinsics(size)?;
        let depth_size = self.depth_size(frames, codes, size)?;
        let poses = self.array("poses");
        if poses.len() < frames.len() {
            let (listed, found) = (poses.len(), frames.len());
            recording
                .note(format!("expected a pose for each of {found} frames, found {listed} poses"));
        }
        let encoding = recording.encoding(codes, Sensor::Lidar, TRUSTED_DEPTH);
        let least = recording.least_confidence();
        for (&number, frame) in frames {
            let index = usize::try_from(number).unwrap_or(usize::MAX);
            let name = number.to_string();
            let pose = match pose(poses.get(index), index) {
                Ok(pose) => pose,
                Err(problem) => {
                    recording.skip(&name, self.file.clone(), problem);
                    continue;
                }
            };
            let cameras = self.cameras(recording, index, &k, depth_size)?;
            let depth = frame.depth.clone().map(|file| DepthSource {
                file,
                encoding,
                confidence: frame.confidence.clone().map(|map| (map, least)),
            });
            let color = frame.color.clone();
            let (time, lens) = (self.time(index), Distortion::default());
            recording.push(RecordedFrame { name, time, pose, cameras, color, depth, lens });
        }
        Ok(())
    }

    fn array(&self, key: &str) -> &[Value] {
        self.json.get(key).and_then(Value::as_array).map_or(&[][..], Vec::as_slice)
    }

    fn side(&self, key: &str) -> Option<u32> {
        self.json.get(key).and_then(Value::as_u64).and_then(|n| u32::try_from(n).ok())
    }

    /// Intrinsics of the photograph.
    fn intrinsics(&self, size: (u32, u32)) -> Result<Intrinsics, DatasetError> {
        if let Some(stated) = self.side("w").zip(self.side("h")) {
            same_size(stated, size, &self.file)?;
        }
        let k = self.json.get("K").and_then(|k| stated::from_json(k, size));
        k.ok_or_else(|| {
            let expected = "`K`, nine numbers of a camera matrix by columns";
            let found = self.json.get("K").map_or("no `K`".to_owned(), describe_json);
            metadata_error(&self.file, expected, found, "export the recording again")
        })
    }

    /// Cameras of a frame: its own intrinsics if listed, else those for all.
    fn cameras(
        &self,
        recording: &Recording,
        index: usize,
        all: &Intrinsics,
        depth_size: (u32, u32),
    ) -> Result<Cameras, DatasetError> {
        let size = (all.width, all.height);
        let own = self.array("perFrameIntrinsicCoeffs").get(index);
        let own = own.and_then(|value| stated::flat_numbers(value)?.try_into().ok());
        let own = own.map(|[fx, fy, cx, cy]: [f64; 4]| Intrinsics { fx, fy, cx, cy, ..*all });
        // Some versions of the app fill the list with zeros.
        let k = own.filter(|k| k.fx > 0.0 && k.fy > 0.0).unwrap_or(*all);
        recording.cameras_of_lens(&k, size, depth_size, &self.file)
    }

    /// Size of depth: from the files if they state it, else `dw` and `dh`.
    fn depth_size(
        &self,
        frames: &BTreeMap<u64, FrameSources>,
        codes: CodeKind,
        color: (u32, u32),
    ) -> Result<(u32, u32), DatasetError> {
        if codes != CodeKind::BareFloats {
            let depths = frames.values().filter_map(|frame| frame.depth.as_ref());
            return Ok(recording::depth_size(depths).ok().flatten().unwrap_or(color));
        }
        if let Some(stated) = self.side("dw").zip(self.side("dh")) {
            return Ok(stated);
        }
        // Old versions of the app do not state the size; they supported one sensor.
        Ok(if color.0 < color.1 { (192, 256) } else { (256, 192) })
    }

    fn time(&self, index: usize) -> Option<f64> {
        let stamp = self.array("frameTimestamps").get(index).and_then(Value::as_f64);
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
    let timed = TimedPose::new([0.0, x, y, z, qx, qy, qz, qw]).ok_or_else(wrong)?;
    Ok(Pose::from_opengl(timed.matrix())?)
}
