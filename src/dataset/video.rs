//! Photographs inside a video, extracted by the installed `ffmpeg`.
//!
//! Phones store colour as HEVC, whose decoders are large and encumbered by patents. Users of such videos
//! usually have `ffmpeg`. It runs once, when the first photograph is requested, into a temporary folder
//! that is deleted with the dataset.

use super::error::FrameProblem;
use super::folder::is_file;
use crate::math::camera::Intrinsics;
use glam::{DVec2, DVec3};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

#[derive(Debug)]
pub(super) struct Video {
    pub path: PathBuf,
    frames: OnceLock<Result<TempDir, String>>,
}

impl Video {
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: OnceLock::new() }
    }

    pub fn is_ffmpeg_available() -> bool {
        let version = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output();
        version.is_ok_and(|output| output.status.success())
    }

    pub fn frame(&self, index: usize) -> Result<PathBuf, FrameProblem> {
        // The first caller extracts the frames; concurrent ones wait for its result.
        let unpacked = self.frames.get_or_init(|| extract_frames(&self.path));
        let folder = unpacked.as_ref().map_err(|found| FrameProblem::Video(found.clone()))?;
        let file = folder.path().join(format!("{index:06}.jpg"));
        match is_file(&file)? {
            true => Ok(file),
            false => Err(FrameProblem::Video(format!("no frame {index} in it"))),
        }
    }
}

/// Names of the ffmpeg option that extracts every frame once: since ffmpeg 5.1, and in older versions.
const EVERY_FRAME: [&str; 2] = ["-fps_mode", "-vsync"];

fn extract_frames(path: &Path) -> Result<TempDir, String> {
    let folder = TempDir::new().map_err(|e| e.to_string())?;
    // An absolute path: a relative name may start with a dash or a protocol prefix.
    let video = std::path::absolute(path).map_err(|e| e.to_string())?;
    let [option, older] = EVERY_FRAME;
    let mut output = run(&video, folder.path(), option)?;
    // Only for this error: any other would just occur twice.
    if !output.status.success() && first_line(&output).contains(option.trim_start_matches('-')) {
        output = run(&video, folder.path(), older)?;
    }
    match output.status.success() {
        true => Ok(folder),
        false => Err(first_line(&output)),
    }
}

fn run(video: &Path, folder: &Path, every_frame: &str) -> Result<Output, String> {
    let mut ffmpeg = Command::new("ffmpeg");
    // Without rotation metadata: the camera matrix refers to the sensor's orientation.
    ffmpeg.args(["-nostdin", "-v", "error", "-noautorotate", "-i"]).arg(video);
    // `-q:v 2` is the best JPEG quality within ffmpeg's default limits; numbers start at 0, as frames do.
    ffmpeg.args([every_frame, "passthrough", "-q:v", "2", "-start_number", "0"]);
    let output = ffmpeg.arg(folder.join("%06d.jpg")).output();
    output.map_err(|e| format!("ffmpeg cannot be run ({e})"))
}

fn first_line(output: &Output) -> String {
    let message = String::from_utf8_lossy(&output.stderr);
    message.lines().next().unwrap_or("a failure of ffmpeg without a message").to_owned()
}

/// Readout time of a Kinect v1 photograph, seconds.
pub(super) const KINECT_COLOR: f64 = 0.0261;
/// Readout time of a Kinect v1 depth image, seconds.
pub(super) const KINECT_DEPTH: f64 = 0.0305;

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RollingShutter {
    /// Rotation of the camera from the readout of the first row to that of the last row. The rotation
    /// vector is in radians, in camera axes (x right, y down).
    pub rotation: DVec3,
}

impl RollingShutter {
    /// True if the rotation displaces every row by less than half a pixel.
    pub fn is_negligible(&self, k: &Intrinsics) -> bool {
        self.rotation.length() * k.fx.max(k.fy) < 1.0
    }

    /// Finds the recorded position of the point that the camera sees along `slope` (x/z, y/z) at the
    /// middle row's time. Returns the slope of the point in the recorded image, and a factor. The factor
    /// converts recorded depth along the optical axis to depth along the middle row's axis.
    pub fn source_direction(&self, k: &Intrinsics, slope: DVec2) -> (DVec2, f64) {
        let ray = slope.extend(1.0);
        // Rotation to first order: within a readout of about 30 ms it is small.
        let across = self.rotation.cross(ray);
        // The row depends on the unknown direction; the estimate is exact to second order in the rotation.
        let rows = 1.0 / f64::from(k.height);
        let middle = (slope.y * k.fy + k.cy) * rows - 0.5;
        let row = middle / (1.0 + k.fy * rows * (across.y - slope.y * across.z));
        let seen = ray - row * across;
        let factor = 1.0 / seen.z;
        (factor * seen.truncate(), factor)
    }
}

#[cfg(test)]
mod rolling_shutter_tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_row_saw_what_a_camera_turned_by_its_time_sees() {
        let k = Intrinsics::from_horizontal_fov(640, 480, 1.0);
        let shutter = RollingShutter { rotation: DVec3::new(0.01, -0.03, 0.02) };
        assert!(!shutter.is_negligible(&k) && RollingShutter::default().is_negligible(&k));
        for slope in [DVec2::new(0.3, -0.35), DVec2::new(-0.2, 0.3), DVec2::new(0.4, 0.0)] {
            let (at, factor) = shutter.source_direction(&k, slope);
            let row = (at.y * k.fy + k.cy) / f64::from(k.height) - 0.5;
            // A point that the row recorded 2 units ahead, in the axes of the middle row's camera.
            let turned = DQuat::from_scaled_axis(row * shutter.rotation) * (2.0 * at.extend(1.0));
            assert!((turned.truncate() / turned.z - slope).length() < 3e-4, "{turned}");
            assert!((2.0 * factor - turned.z).abs() < 1e-3, "{factor} {turned}");
        }
    }
}
