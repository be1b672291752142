//! A frame that is listed but not yet decoded, and the splits it is listed in.
//!
//! Opening a dataset makes entries only: images are decoded when a frame is loaded, so that opening
//! thousands of frames is quick and memory holds the frames in use alone.

use super::decode::{self, DepthEncoding};
use super::error::{FrameError, FrameProblem};
use super::frame::Frame;
use super::surface::sensor::Sensor;
use super::synthetic::scene::SyntheticScene;
use crate::math::camera::Camera;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Frames that belong together: a training set, a validation set.
#[derive(Clone, Debug)]
pub struct DatasetSplit {
    /// As in the files: `train`, `test`, `val`, `eval`; `all` where a dataset has no splits.
    pub name: String,
    /// In the order of the dataset.
    pub frames: Vec<FrameEntry>,
    /// Whether its frames have depth.
    pub has_depth: bool,
}

/// One frame that can be loaded.
#[derive(Clone, Debug)]
pub struct FrameEntry {
    /// Name within the split.
    pub name: String,
    /// Intrinsics and pose.
    pub camera: Camera,
    pub(super) source: FrameSource,
}

/// Where the pixels of an entry come from.
#[derive(Clone, Debug)]
pub(super) enum FrameSource {
    /// Image files of one size; depth where the split has it.
    Files { color: PathBuf, depth: Option<(PathBuf, DepthEncoding)> },
    /// The procedural room; `noise_stream` names the frame's depth noise, `None` is exact depth.
    Synthetic { scene: Arc<SyntheticScene>, noise_stream: Option<u64> },
}

impl FrameEntry {
    /// Decodes the frame's images and checks that they agree with each other and with the camera.
    ///
    /// # Errors
    /// A file that is missing, damaged or of another size or pixel format than its split.
    pub fn load(&self) -> Result<Frame, FrameError> {
        match &self.source {
            FrameSource::Synthetic { scene, noise_stream } => {
                Ok(scene.frame(&self.name, self.camera, *noise_stream))
            }
            FrameSource::Files { color, depth } => self.load_files(color, depth.as_ref()),
        }
    }

    /// File of the colour image, if the frame has files.
    pub fn color_path(&self) -> Option<&Path> {
        match &self.source {
            FrameSource::Files { color, .. } => Some(color),
            FrameSource::Synthetic { .. } => None,
        }
    }

    /// File of the depth image, if there is one.
    pub fn depth_path(&self) -> Option<&Path> {
        match &self.source {
            FrameSource::Files { depth, .. } => depth.as_ref().map(|(path, _)| path.as_path()),
            FrameSource::Synthetic { .. } => None,
        }
    }

    /// What measured the frame's depth; `None` in frames without depth.
    pub(super) fn sensor(&self) -> Option<Sensor> {
        match &self.source {
            FrameSource::Synthetic { scene, .. } => {
                Some(Sensor::Exact { noise: scene.depth_noise() })
            }
            FrameSource::Files { depth, .. } => depth.as_ref().map(|(_, encoding)| encoding.sensor),
        }
    }

    fn load_files(
        &self,
        color_path: &Path,
        depth_source: Option<&(PathBuf, DepthEncoding)>,
    ) -> Result<Frame, FrameError> {
        let fail = |file: &Path, problem| FrameError {
            file: file.to_owned(),
            frame: self.name.clone(),
            problem,
        };
        let color = decode::color(color_path).map_err(|p| fail(color_path, p))?;
        let color_size = (color.width as u32, color.height as u32);
        let mut depth = None;
        if let Some((path, encoding)) = depth_source {
            let decoded = decode::depth(path, encoding).map_err(|p| fail(path, p))?;
            decoded.check(color_size).map_err(|p| fail(path, p))?;
            depth = Some(decoded);
        }
        // Intrinsics were taken from the first image of the split; every other must fit them.
        let k = &self.camera.intrinsics;
        let expected = (k.width, k.height);
        if color_size != expected {
            let problem = FrameProblem::CameraSize { expected, found: color_size };
            return Err(fail(color_path, problem));
        }
        Ok(Frame { name: self.name.clone(), camera: self.camera, color, depth })
    }
}
