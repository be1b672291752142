//! Frames that are listed but not decoded, grouped in splits.
//!
//! Opening a dataset creates entries only; images are decoded when a frame is loaded. So opening thousands
//! of frames is fast, and memory holds only the frames in use.

use super::calibration::ColorCamera;
use super::decode;
use super::decode::{Decoding, DepthEncoding};
use super::depth::Depth;
use super::distortion::Distortion;
use super::error::{FrameError, FrameProblem};
use super::frame::{Frame, photographed_by};
use super::options::ByteSource;
use super::surface::sensor::Sensor;
use super::synthetic::scene::SyntheticScene;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::measured_pixel::MASKED;
use crate::math::pose::Pose;
use rayon::prelude::*;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Interval, in frames, between the frames held out of training if the dataset has no evaluation split.
pub const HOLD_OUT_EVERY: usize = 8;

/// Name of the split of frames held out of training, in datasets without splits.
pub const HELD_OUT: &str = "held-out";

/// Frames that belong together, such as a training or a validation set.
#[derive(Clone, Debug)]
pub struct DatasetSplit {
    /// Name in the files: `train`, `test`, `val`, `eval`. Datasets without splits have `all`, and
    /// `held-out` for the frames of `all` that training leaves out.
    pub name: String,
    /// Frames in the dataset's order.
    pub frames: Vec<FrameEntry>,
    /// True if the frames have depth.
    pub has_depth: bool,
}

/// One frame that can be loaded.
#[derive(Clone, Debug)]
pub struct FrameEntry {
    /// Name within the split.
    pub name: String,
    /// Intrinsics and pose of the camera that measures depth.
    pub camera: Camera,
    /// Camera of the photograph if the files describe one that differs from the depth camera. `None` if
    /// photographs are assumed to be registered to depth pixel by pixel.
    pub color_camera: Option<ColorCamera>,
    /// Time of capture, seconds on the recorder's clock, if the files state it.
    pub time: Option<f64>,
    pub(super) source: FrameSource,
}

#[derive(Clone, Debug)]
pub(super) enum FrameSource {
    Files(Box<FrameFiles>),
    /// Frame rendered from a procedural room. `noise_stream` selects the random numbers of its depth
    /// noise; `None` gives exact depth.
    Synthetic {
        scene: Arc<SyntheticScene>,
        noise_stream: Option<u64>,
    },
}

#[derive(Clone, Debug)]
pub(super) struct FrameFiles {
    pub color: ByteSource,
    pub depth: Option<DepthSource>,
    pub lens: Distortion,
    /// The photograph's lens, if it is another.
    pub photo_lens: Option<Distortion>,
    pub mask: Option<MaskSource>,
    pub decoding: Decoding,
}

impl FrameFiles {
    fn photo_lens(&self) -> &Distortion {
        self.photo_lens.as_ref().unwrap_or(&self.lens)
    }
}

/// Image of the photograph's size whose black (or other) pixels are left out of training and evaluation.
#[derive(Clone, Debug)]
pub(super) struct MaskSource {
    pub file: ByteSource,
    /// True if black pixels are left out, false if all others are.
    pub hides_black: bool,
}

#[derive(Clone, Debug)]
pub(super) struct DepthSource {
    pub file: ByteSource,
    pub encoding: DepthEncoding,
    /// Confidence map of the depth, and the lowest confidence of pixels that are used.
    pub confidence: Option<(ByteSource, u8)>,
}

impl DepthSource {
    pub fn new(file: ByteSource, encoding: DepthEncoding) -> Self {
        Self { file, encoding, confidence: None }
    }
}

/// Size of the photographs that are decoded at the same time, bytes; a single one may be larger.
pub(crate) const PHOTOGRAPHS_AT_ONCE: u64 = 256 << 20;

/// Calls `each` for the frames of a range on all threads, and returns the results in order. At any time, the
/// photographs in memory are at most [`PHOTOGRAPHS_AT_ONCE`] if each call loads one at a time.
pub(super) fn map_photographs<T: Send>(
    frames: &[FrameEntry],
    range: Range<usize>,
    each: impl Fn(usize) -> Option<T> + Sync,
) -> Vec<T> {
    let largest = frames.iter().map(FrameEntry::photograph_bytes).max().unwrap_or(0).max(1);
    let at_once = (PHOTOGRAPHS_AT_ONCE / largest).max(1) as usize;
    let mut found = Vec::new();
    for start in range.clone().step_by(at_once) {
        let part = start..range.end.min(start + at_once);
        found.par_extend(part.into_par_iter().filter_map(&each));
    }
    found
}

impl FrameEntry {
    /// Decodes the frame's images and checks that they agree with each other and with the camera.
    ///
    /// # Errors
    /// A file that is missing, damaged, or of another size or pixel format than its split.
    pub fn load(&self) -> Result<Frame, FrameError> {
        match &self.source {
            FrameSource::Synthetic { scene, noise_stream } => {
                Ok(scene.frame(&self.name, self.camera, *noise_stream))
            }
            FrameSource::Files(files) => {
                let (color, depth) = match &files.color {
                    // The grey placeholder has the depth's size, checked when the depth is decoded.
                    ByteSource::Grey(_) => {
                        let depth = self.depth(files)?;
                        (self.grey_image(), depth)
                    }
                    _ => (self.color(files)?, self.depth(files)?),
                };
                Ok(Frame {
                    name: self.name.clone(),
                    camera: self.camera,
                    color_camera: self.color_camera,
                    color: color.into(),
                    depth,
                })
            }
        }
    }

    /// Decodes the frame's photograph alone.
    ///
    /// # Errors
    /// As [`Self::load`], for the photograph's file.
    pub fn load_color(&self) -> Result<Arc<Image<[u8; 4]>>, FrameError> {
        match &self.source {
            FrameSource::Synthetic { .. } => Ok(self.load()?.color),
            FrameSource::Files(files) => self.color(files).map(Arc::new),
        }
    }

    /// Decodes the frame's depth alone; `None` in splits without depth.
    ///
    /// # Errors
    /// As [`Self::load`], for the depth file.
    pub fn load_depth(&self) -> Result<Option<Depth>, FrameError> {
        match &self.source {
            FrameSource::Synthetic { .. } => Ok(self.load()?.depth),
            FrameSource::Files(files) => self.depth(files),
        }
    }

    /// Returns world pose and intrinsics of the photograph's camera. `calibrated` takes precedence over
    /// the camera from the files.
    pub fn photo_camera(&self, calibrated: Option<&ColorCamera>) -> Camera {
        self.photo_camera_at(self.camera.pose, calibrated)
    }

    /// Returns world pose and intrinsics of the photograph's camera if the depth camera is at `pose`.
    /// `calibrated` takes precedence over the camera from the files.
    pub fn photo_camera_at(&self, pose: Pose, calibrated: Option<&ColorCamera>) -> Camera {
        let camera = Camera { pose, ..self.camera };
        // Decoding refuses any other size.
        let color = photographed_by(self.color_camera, calibrated, self.photograph_size());
        color.map_or(camera, |color| color.camera_at(&camera))
    }

    /// Returns the memory that decoding the photograph takes, in bytes.
    pub(crate) fn photograph_bytes(&self) -> u64 {
        let whole = || Decoding::whole(self.photograph_size());
        self.frame_files().map_or_else(whole, |files| files.decoding).bytes
    }

    /// Divides the size of a photograph that would take too much memory, unless depth is registered to it.
    pub(super) fn divide_photograph(&mut self) {
        let size = self.photograph_size();
        let FrameSource::Files(files) = &mut self.source else { return };
        let is_registered = self.color_camera.is_none() && files.depth.is_some();
        files.decoding =
            if is_registered { Decoding::whole(size) } else { Decoding::of(&files.color, size) };
        let divisor = files.decoding.divisor;
        if divisor == 1 {
            return;
        }
        let [width, height] = size.map(|side| side.div_ceil(divisor));
        match &mut self.color_camera {
            Some(camera) => {
                let own = ColorCamera { size: Some(size), ..*camera };
                *camera = own.scaled_to([width, height]);
            }
            None => self.camera.intrinsics = self.camera.intrinsics.resized(width, height),
        }
    }

    fn photograph_size(&self) -> [u32; 2] {
        let Intrinsics { width, height, .. } = self.camera.intrinsics;
        self.color_camera.and_then(|color| color.size).unwrap_or([width, height])
    }

    /// Adds a mask to a frame of files without one. Returns true if the frame got it.
    pub(super) fn add_mask(&mut self, mask: Option<MaskSource>) -> bool {
        match &mut self.source {
            FrameSource::Files(files) if files.mask.is_none() => {
                files.mask = mask;
                files.mask.is_some()
            }
            _ => false,
        }
    }

    pub(super) fn has_photograph(&self) -> bool {
        self.frame_files().is_none_or(|files| !matches!(files.color, ByteSource::Grey(_)))
    }

    pub(super) fn frame_files(&self) -> Option<&FrameFiles> {
        match &self.source {
            FrameSource::Files(files) => Some(files),
            FrameSource::Synthetic { .. } => None,
        }
    }

    /// Returns the path of the colour image, if the frame has files.
    pub fn color_path(&self) -> Option<&Path> {
        self.frame_files().map(|files| files.color.path())
    }

    /// Returns the path of the depth image, if there is one.
    pub fn depth_path(&self) -> Option<&Path> {
        self.depth_source().map(|depth| depth.file.path())
    }

    /// Returns the paths of the frame's files on disk: images and confidence map, or their archive or
    /// video.
    pub(super) fn files(&self) -> impl Iterator<Item = &Path> {
        self.frame_files().into_iter().flat_map(|files| {
            let depth = files.depth.iter().flat_map(|depth| {
                let map = depth.confidence.as_ref().map(|(map, _)| map);
                std::iter::once(&depth.file).chain(map)
            });
            let mask = files.mask.as_ref().map(|mask| &mask.file);
            std::iter::once(&files.color).chain(depth).chain(mask).map(ByteSource::disk_path)
        })
    }

    /// True if the photographs and depth images of both frames are files of the same bytes.
    pub(super) fn is_copy_of(&self, other: &Self) -> bool {
        let Some((one, other)) = self.frame_files().zip(other.frame_files()) else { return false };
        let Some((depth, other_depth)) = one.depth.as_ref().zip(other.depth.as_ref()) else {
            return false;
        };
        let files = [(&one.color, &other.color), (&depth.file, &other_depth.file)];
        files.into_iter().all(|files| match files {
            (one @ ByteSource::File(path), other @ ByteSource::File(other_path)) => {
                let bytes = |path: &Path| path.metadata().ok().map(|file| file.len());
                // Lengths first: noise gives every image of a camera at rest another one.
                bytes(path) == bytes(other_path)
                    && one.read().is_ok_and(|one| other.read().is_ok_and(|other| one == other))
            }
            _ => false,
        })
    }

    pub(super) fn sensor(&self) -> Option<Sensor> {
        match &self.source {
            FrameSource::Synthetic { scene, .. } => {
                Some(Sensor::Exact { noise: scene.depth_noise() })
            }
            FrameSource::Files(_) => self.depth_source().map(|depth| depth.encoding.sensor),
        }
    }

    /// Returns the number of world units per metre; `None` if the frame has no depth.
    pub(super) fn metre(&self) -> Option<f64> {
        match self.source {
            FrameSource::Synthetic { .. } => Some(1.0),
            FrameSource::Files(_) => {
                self.depth_source().map(|depth| depth.encoding.units_per_metre)
            }
        }
    }

    pub(super) fn depth_source(&self) -> Option<&DepthSource> {
        self.frame_files()?.depth.as_ref()
    }

    fn grey_image(&self) -> Image<[u8; 4]> {
        let k = &self.camera.intrinsics;
        Image::filled(k.width as usize, k.height as usize, [128, 128, 128, 255])
    }

    fn color(&self, files: &FrameFiles) -> Result<Image<[u8; 4]>, FrameError> {
        if let ByteSource::Grey(_) = files.color {
            // Decoded only for its checks: a forged size must not reach the allocation below.
            self.depth(files)?;
            return Ok(self.grey_image());
        }
        // The intrinsics come from a few images of the split or from metadata; every image must fit them.
        let k = self.photo_camera(None).intrinsics;
        let size = (k.width, k.height);
        let color = decode::color(&files.color, size, files.decoding.divisor)
            .map_err(|p| self.frame_error(&files.color, p))?;
        let lens = files.photo_lens();
        let mut color = lens.undistort_color(&k, &color).unwrap_or(color);
        if let Some(used) = self.mask(files)? {
            let used = lens.undistort_depth(&k, &used, false, |used, _| used).unwrap_or(used);
            let pixels = color.data.iter_mut().zip(used.data).filter(|(_, used)| !used);
            pixels.for_each(|(pixel, _)| *pixel = MASKED);
        }
        Ok(color)
    }

    /// Returns the recorded mask of the photograph, true at used pixels.
    fn mask(&self, files: &FrameFiles) -> Result<Option<Image<bool>>, FrameError> {
        let Some(mask) = &files.mask else { return Ok(None) };
        let k = self.photo_camera(None).intrinsics;
        let Decoding { size, divisor, .. } = files.decoding;
        let size = if divisor == 1 { (k.width, k.height) } else { size.into() };
        let used = decode::mask(mask, size).map_err(|p| self.frame_error(&mask.file, p))?;
        if divisor == 1 {
            return Ok(Some(used));
        }
        let mut divided = Image::filled(k.width as usize, k.height as usize, true);
        for (i, pixel) in divided.data.iter_mut().enumerate() {
            let at = [i % divided.width, i / divided.width].map(|at| at * divisor as usize);
            *pixel = *used.at(at[0], at[1]);
        }
        Ok(Some(divided))
    }

    fn depth(&self, files: &FrameFiles) -> Result<Option<Depth>, FrameError> {
        let Some(DepthSource { file, encoding, confidence }) = &files.depth else {
            return Ok(None);
        };
        let k = &self.camera.intrinsics;
        let size = (k.width, k.height);
        let mut depth =
            decode::depth(file, encoding, size).map_err(|p| self.frame_error(file, p))?;
        // Checked before the confidence is applied, so that empty depth is reported with its own file.
        depth.check(size).map_err(|p| self.frame_error(file, p))?;
        if let Some((map, least)) = confidence {
            let sure = decode::confidence(map, size).map_err(|p| self.frame_error(map, p))?;
            depth.make_holes(|i| sure.data.get(i).is_none_or(|sure| sure < least));
            // The confidence may have removed every pixel; that is reported as empty depth.
            depth.check(size).map_err(|p| self.frame_error(map, p))?;
        }
        // Pixels of another camera with another place are left out when points get their colours.
        let has_lens = |color: ColorCamera| (color.offset, color.rotation) == ([0.0; 3], [0.0; 3]);
        if self.color_camera.is_none_or(has_lens)
            && let Some(used) = self.mask(files)?
        {
            let (width, height) = depth.size();
            let at = |i: usize| [i % width * used.width / width, i / width * used.height / height];
            depth.make_holes(|i| {
                let [column, row] = at(i);
                !used.at(column, row)
            });
            let file = files.mask.as_ref().map_or(file, |mask| &mask.file);
            depth.check(size).map_err(|p| self.frame_error(file, p))?;
        }
        // Last, because the confidence belongs to the pixels of the recorded image.
        depth.undistort(&files.lens, k);
        Ok(Some(depth))
    }

    fn frame_error(&self, source: &ByteSource, problem: FrameProblem) -> FrameError {
        FrameError { file: source.path().to_owned(), frame: self.name.clone(), problem }
    }
}
