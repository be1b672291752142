//! Posed RGB-D frames from folders, and from a procedural scene that needs none.
//!
//! A format reads the metadata and poses of one layout (recognised by content, never by name) and
//! names each frame's files; everything after that, from decoding to points, is common to all.
//! Opening never decodes images. A bad frame becomes a [`Warning`] at opening or a [`FrameError`]
//! at loading, never a panic, and the other frames remain usable.
//!
//! No threads are started here: the prefetcher of `pipeline` calls [`Dataset::load`].
#![doc = include_str!("dataset.md")]

pub mod calibration;
pub mod error;
pub mod frame;
pub mod range;
pub mod splits;
pub mod surface;
pub mod synthetic;
pub mod unproject;

mod decode;
mod edges;
mod folder;
pub mod formats;
mod matrix;

use crate::math::camera::Camera;
use decode::DepthEncoding;
use error::{DatasetError, FrameError, FrameProblem};
use frame::Frame;
use range::PositionRange;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use synthetic::SyntheticScene;

/// Layout of a dataset's files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// `transforms*.json` with one field of view, images beside it (NeRF-synthetic).
    Blender,
    /// `frame-NNNNNN.{color,depth,pose}.*` (7-Scenes).
    SevenScenes,
    /// Frames made on demand; no files.
    Synthetic,
}

/// Posed frames in named splits.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Last part of the path, or the name of the procedural scene.
    pub name: String,
    /// The folder; `None` for the procedural scene.
    pub path: Option<PathBuf>,
    /// How it is stored.
    pub layout: Layout,
    /// Which content the layout was recognised by.
    pub recognised_by: String,
    /// At least one, none of them empty.
    pub splits: Vec<Split>,
    /// Frames that were listed but cannot be used.
    pub warnings: Vec<Warning>,
    /// What a user should know although nothing is wrong.
    pub notes: Vec<String>,
    /// Range of positions where the layout defines one; see [`range::estimate`].
    pub known_range: Option<PositionRange>,
    /// What was overridden when it was opened.
    pub options: LoadOptions,
}

/// Frames that belong together: a training set, a validation set.
#[derive(Clone, Debug)]
pub struct Split {
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
    source: FrameSource,
}

#[derive(Clone, Debug)]
enum FrameSource {
    Files { color: PathBuf, depth: Option<(PathBuf, DepthEncoding)> },
    Synthetic { scene: Arc<SyntheticScene>, noise_stream: Option<u64> },
}

/// A frame that was skipped at opening.
#[derive(Clone, Debug)]
pub struct Warning {
    /// Split that lists the frame.
    pub split: String,
    /// The frame, the file and what is wrong with it.
    pub error: Arc<FrameError>,
}

impl std::fmt::Display for Warning {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} (split {})", self.error, self.split)
    }
}

/// What a user may override when a dataset is opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct LoadOptions {
    /// World units per step of 16-bit depth, instead of what the dataset says.
    pub depth_scale: Option<f64>,
    /// Nearest and farthest depth that training trusts, world units, instead of the layout's.
    pub depth_range: Option<[f64; 2]>,
}

/// Opens a dataset folder: recognises the layout and reads metadata and poses.
pub fn open(path: &Path, options: &LoadOptions) -> Result<Dataset, DatasetError> {
    options.check()?;
    let folder = folder::Folder::open(path)?;
    let (layout, recognised_by, parsed) = formats::parse(&folder, options)?;
    let name = path.canonicalize().ok().and_then(|p| Some(p.file_name()?.to_str()?.to_owned()));
    let dataset = Dataset {
        name: name.unwrap_or_else(|| "dataset".to_owned()),
        path: Some(path.to_owned()),
        layout,
        recognised_by,
        splits: parsed.splits.into_iter().filter(|s| !s.frames.is_empty()).collect(),
        warnings: parsed.warnings,
        notes: parsed.notes,
        known_range: parsed.known_range,
        options: *options,
    };
    if dataset.splits.is_empty() {
        return Err(no_usable_frame(path, dataset.warnings));
    }
    Ok(dataset)
}

fn no_usable_frame(path: &Path, warnings: Vec<Warning>) -> DatasetError {
    let skipped = warnings.len();
    match warnings.into_iter().next().and_then(|w| Arc::into_inner(w.error)) {
        Some(first) => {
            DatasetError::NoUsableFrame { path: path.to_owned(), skipped, first: Box::new(first) }
        }
        None => DatasetError::Metadata {
            file: path.to_owned(),
            expected: "at least one frame".to_owned(),
            found: "none".to_owned(),
            hint: "export the dataset again".to_owned(),
        },
    }
}

impl LoadOptions {
    fn check(&self) -> Result<(), DatasetError> {
        if let Some(scale) = self.depth_scale.filter(|s| !(s.is_finite() && *s > 0.0)) {
            return Err(DatasetError::Option {
                setting: "depth scale",
                expected: "a positive number of world units per code",
                found: scale.to_string(),
            });
        }
        if let Some([near, far]) = self.depth_range.filter(|[a, b]| !(*a >= 0.0 && a < b)) {
            return Err(DatasetError::Option {
                setting: "depth range",
                expected: "0 ≤ near < far in world units",
                found: format!("{near} to {far}"),
            });
        }
        Ok(())
    }
}

impl Dataset {
    /// Loads one frame: decodes its images and checks that they agree with each other and with
    /// the camera. `split` and `index` are positions in [`Dataset::splits`] and [`Split::frames`].
    pub fn load(&self, split: usize, index: usize) -> Result<Frame, FrameError> {
        let frames = self.splits.get(split).map_or(&[][..], |s| s.frames.as_slice());
        match frames.get(index) {
            Some(entry) => entry.load(),
            None => Err(FrameError {
                file: self.path.clone().unwrap_or_default(),
                frame: index.to_string(),
                problem: FrameProblem::NoSuchFrame { available: frames.len(), asked: index },
            }),
        }
    }
}

impl FrameEntry {
    /// Loads the frame, as [`Dataset::load`] does.
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
            let size = (decoded.size().0 as u32, decoded.size().1 as u32);
            if size != color_size {
                let problem = FrameProblem::SizeMismatch { color: color_size, depth: size };
                return Err(fail(path, problem));
            }
            if decoded.is_empty() {
                return Err(fail(path, FrameProblem::NoDepthValues));
            }
            depth = Some(decoded);
        }
        let k = &self.camera.intrinsics;
        let expected = (k.width, k.height);
        if color_size != expected {
            let problem = FrameProblem::CameraSize { expected, found: color_size };
            return Err(fail(color_path, problem));
        }
        Ok(Frame { name: self.name.clone(), camera: self.camera, color, depth })
    }
}
