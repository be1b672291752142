//! Common steps of all layouts of image sequences.
//!
//! A sequence has the split `all`. The split `held-out` repeats the frames that training on `all` holds out.
//! Depth has its own camera; its intrinsics follow from the photograph's if both share one lens.

use super::numbered::NumberedFiles;
use super::stated::majority;
use crate::dataset::calibration::{
    ColorCamera, IntrinsicsDefect, check, check_centre, from_user, have_same_aspect_ratio,
};
use crate::dataset::decode;
use crate::dataset::decode::{CodeKind, Decoding, DepthEncoding};
use crate::dataset::depth::DepthKind;
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::{
    DatasetSplit, DepthSource, FrameEntry, FrameFiles, FrameSource, HELD_OUT, HOLD_OUT_EVERY,
};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{MAX_FRAMES, ParsedFolder};
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use std::borrow::Borrow;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// Name of the split of a recording without splits.
pub(super) const SPLIT: &str = "all";

/// Interval of trusted depth of structured-light sensors (Kinect, Structure), metres.
pub(super) const STRUCTURED_LIGHT_RANGE: [f64; 2] = [0.3, 4.0];
/// Interval of trusted depth of a phone's lidar, metres. Beyond it, phones infer depth from the
/// photograph.
pub(super) const LIDAR_RANGE: [f64; 2] = [0.1, 5.0];
/// Interval of trusted depth of renderings, which are exact at any length.
pub(super) const ANY_RANGE: [f64; 2] = [0.0, f64::INFINITY];

/// Largest number of frames that are compared with an earlier one of the same pose.
const MOST_COMPARED: usize = 16;

pub(super) struct Recording<'a> {
    pub folder: &'a Folder,
    pub options: &'a LoadOptions,
    pub split: String,
    pub parsed: ParsedFolder,
    pub frames: Vec<FrameEntry>,
}

/// Intrinsics of the depth camera, and the photograph's camera if it differs.
#[derive(Clone, Copy)]
pub(super) struct Cameras {
    pub depth: Intrinsics,
    pub color: Option<ColorCamera>,
    pub lens: Distortion,
    /// The photograph's lens, if it is another.
    pub photo_lens: Option<Distortion>,
}

impl Cameras {
    /// Cameras of images that are registered pixel by pixel.
    pub fn registered(depth: Intrinsics) -> Self {
        Self { depth, color: None, lens: Distortion::default(), photo_lens: None }
    }

    /// Adds the distortion that `file` states.
    ///
    /// # Errors
    /// Fails for terms that no lens has over these images.
    pub fn with_lens(self, lens: Distortion, file: &Path) -> Result<Self, DatasetError> {
        check_lens(&lens, &self.depth, file)?;
        Ok(Self { lens, ..self })
    }

    /// Adds the distortions that `file` states for depth and for photographs, as [`Self::with_lens`] does.
    pub fn with_lenses(
        self,
        [depth, photo]: [Distortion; 2],
        file: &Path,
    ) -> Result<Self, DatasetError> {
        let of_photo = self.color.map_or(self.depth, |color| color.intrinsics(self.depth));
        check_lens(&photo, &of_photo, file)?;
        let photo_lens = (photo != depth).then_some(photo);
        Self { photo_lens, ..self }.with_lens(depth, file)
    }
}

fn check_lens(lens: &Distortion, k: &Intrinsics, file: &Path) -> Result<(), DatasetError> {
    if lens.is_plausible(k) {
        return Ok(());
    }
    let expected = "lens terms that map the image to about itself";
    let found = format!("k {:?}, p {:?}, which fold or tear it", lens.radial, lens.tangential);
    Err(metadata_error(file, expected, found, "correct them, or undistort the images first"))
}

/// Creates a frame from its files, without a timestamp.
pub(super) fn frame_entry(
    name: String,
    pose: Pose,
    cameras: Cameras,
    color: ByteSource,
    depth: Option<DepthSource>,
) -> FrameEntry {
    let Cameras { depth: intrinsics, color: color_camera, lens, photo_lens } = cameras;
    let decoding = Decoding::whole([0, 0]);
    let files = FrameFiles { color, depth, lens, photo_lens, mask: None, decoding };
    let source = FrameSource::Files(Box::new(files));
    let camera = Camera { intrinsics, pose };
    let mut frame = FrameEntry { name, camera, color_camera, time: None, source };
    frame.divide_photograph();
    frame
}

/// Returns the codes of depth without a stated unit: floats in metres, or whole numbers in millimetres.
pub(super) fn codes_by_content(depths: &[impl Borrow<ByteSource>]) -> CodeKind {
    // A file that cannot be read is reported with its frame.
    let is_floats =
        majority(depths, |source| decode::stores_floats(source.borrow())).ok().flatten();
    CodeKind::ByContent(if is_floats == Some(true) { 1.0 } else { MILLIMETRE })
}

/// Returns an encoding of depth along the optical axis. The user's depth scale overrides the unit in
/// `codes`, and the user's depth range overrides `trusted`.
pub(super) fn encoding(
    options: &LoadOptions,
    codes: CodeKind,
    sensor: Sensor,
    trusted: [f64; 2],
) -> DepthEncoding {
    let scaled = |unit: f64| options.depth_scale.unwrap_or(unit);
    let (unit, codes) = match codes {
        CodeKind::Linear16(unit) => (unit, CodeKind::Linear16(scaled(unit))),
        CodeKind::ByContent(unit) => (unit, CodeKind::ByContent(scaled(unit))),
        // These have no unit that a user could correct.
        CodeKind::Inverse8 | CodeKind::BareFloats => (1.0, codes),
    };
    let units_per_metre = options.units_per_metre(unit);
    let trusted = options.depth_range.unwrap_or(trusted);
    DepthEncoding { codes, kind: DepthKind::Z, trusted, units_per_metre, sensor }
}

impl<'a> Recording<'a> {
    pub fn new(folder: &'a Folder, options: &'a LoadOptions) -> Self {
        let (split, parsed) = (SPLIT.to_owned(), ParsedFolder::default());
        Self { folder, options, split, parsed, frames: Vec::new() }
    }

    pub fn skip(&mut self, frame: &str, file: PathBuf, problem: FrameProblem) {
        self.parsed.skip(&self.split, frame, file, problem);
    }

    /// Notes files that describe the recording too and are not used.
    pub fn name_unused_files(&mut self, kind: &str, files: impl Iterator<Item = String>) {
        let files: Vec<String> = files.collect();
        if !files.is_empty() {
            self.note(format!("other {kind} are not used: {}", files.join(", ")));
        }
    }

    pub fn skip_line(&mut self, file: &Path, line: usize, expected: &'static str, found: &str) {
        // A damaged line may be of any length.
        let found = found.chars().take(60).collect();
        let problem = FrameProblem::Line { expected, found, line };
        self.skip(&format!("line {line}"), file.to_owned(), problem);
    }

    /// Adds a frame. If `frame` is an error, adds a warning about `file` instead.
    pub fn add(&mut self, name: &str, file: &Path, frame: Result<FrameEntry, FrameProblem>) {
        match frame {
            Ok(frame) if self.frames.len() < MAX_FRAMES => self.frames.push(frame),
            Ok(_) => self.parsed.overflow += 1,
            Err(problem) => self.skip(name, file.to_owned(), problem),
        }
    }

    /// Returns the image size in `size`. If `size` holds an error instead, adds a warning and returns
    /// `None`.
    pub fn warn_unreadable(&mut self, size: ImageSize) -> Option<(u32, u32)> {
        size.unwrap_or_else(|(file, problem)| {
            self.skip(SPLIT, file, problem);
            None
        })
    }

    /// Lists the files of a folder whose names consist of `prefix` and a number. A second file with the
    /// same number becomes a warning.
    pub fn list(
        &mut self,
        name: &str,
        prefix: &str,
        extensions: &[&str],
    ) -> Result<NumberedFiles, DatasetError> {
        let path = self.folder.path.join(name);
        // A missing folder costs the whole recording, a doubled file only a warning.
        let files =
            NumberedFiles::list(self.folder, name, prefix, extensions).map_err(|problem| {
                metadata_error(&path, "a folder of frames", problem.to_string(), "restore it")
            })?;
        for (number, name) in &files.duplicates {
            let problem = FrameProblem::Duplicate(format!("`{name}`"));
            self.skip(&number.to_string(), path.join(name), problem);
        }
        Ok(files)
    }

    /// Lists the files of a folder as [`Self::list`] does, without prefix. Returns `None` if the folder
    /// does not exist.
    pub fn list_optional(
        &mut self,
        name: &str,
        extensions: &[&str],
    ) -> Result<Option<NumberedFiles>, DatasetError> {
        self.folder.has_folder(name).then(|| self.list(name, "", extensions)).transpose()
    }

    pub fn note_unordered(&mut self, list: &str, n: usize) {
        if n > 0 {
            self.note(format!("{list}: {n} times are out of order; sorted"));
        }
    }

    /// Returns the most frequent sizes of readable photographs and depth images. Returns `None` if there
    /// are none. An unreadable file becomes a warning.
    pub fn sizes(
        &mut self,
        colors: impl IntoIterator<Item = impl Borrow<ByteSource>>,
        depths: impl IntoIterator<Item = impl Borrow<ByteSource>>,
    ) -> Option<((u32, u32), (u32, u32))> {
        // A majority, because one odd file must cost only its own frame.
        let color = self.warn_unreadable(photograph_size(colors))?;
        Some((color, self.warn_unreadable(depth_size(depths))?))
    }

    pub fn note(&mut self, note: impl Into<String>) {
        self.parsed.notes.push(note.into());
    }

    /// Adds a defect line about a statement of `file` that is not used.
    pub fn unused(&mut self, file: &Path, statement: impl std::fmt::Display) {
        self.parsed.unused.push(format!("{}: {statement}", file.display()));
    }

    /// Creates one split of all frames. If any frame has depth, frames without depth are skipped.
    pub fn finish(mut self) -> ParsedFolder {
        // A recording without any depth is photographs alone, and nothing is missing.
        let has_depth = self.frames.iter().any(|frame| frame.depth_path().is_some());
        if has_depth {
            let (with, without): (Vec<_>, Vec<_>) =
                self.frames.into_iter().partition(|frame| frame.depth_path().is_some());
            self.frames = with;
            for frame in without {
                let file = frame.color_path().unwrap_or(&self.folder.path).to_owned();
                let problem = FrameProblem::MissingDepth(format!("of frame {}", frame.name));
                self.parsed.skip(&self.split, &frame.name, file, problem);
            }
        }
        self.name_copies();
        // The frames that training holds out, under a name that users can choose.
        let held_out: Vec<_> = self.frames.iter().step_by(HOLD_OUT_EVERY).cloned().collect();
        // A recording of one frame has none to hold out; a poll may find one frame of many.
        let is_enough = self.frames.len() > 1 || self.folder.was_any_taken();
        let split = |name: &str, frames| DatasetSplit { name: name.to_owned(), frames, has_depth };
        self.parsed.splits.push(split(&self.split, self.frames));
        if is_enough && self.split == SPLIT {
            self.parsed.splits.push(split(HELD_OUT, held_out));
        }
        self.parsed
    }

    /// Names frames with the pose and the images of an earlier one: a copy of a trained frame that is held out
    /// is no new view.
    fn name_copies(&mut self) {
        // Tracked frames have no pose yet; of a growing recording, most frames are not in the list.
        if self.options.track || self.folder.is_growing() {
            return;
        }
        let mut first_at: HashMap<[u64; 16], usize> = HashMap::new();
        let mut pairs = Vec::new();
        for (i, frame) in self.frames.iter().enumerate() {
            let pose = frame.camera.pose.to_opencv().to_cols_array().map(f64::to_bits);
            let first = *first_at.entry(pose).or_insert(i);
            pairs.extend((first != i).then_some((first, i)));
        }
        // A camera at rest has the same pose in all frames.
        let step = pairs.len().div_ceil(MOST_COMPARED).max(1);
        let frames = |&(first, i): &(usize, usize)| self.frames.get(first).zip(self.frames.get(i));
        let compared: Vec<_> = pairs.iter().step_by(step).filter_map(frames).collect();
        let copies = || compared.iter().filter(|(first, frame)| frame.is_copy_of(first));
        if let Some((first, copy)) = copies().next() {
            let (n, total) = (copies().count(), compared.len());
            self.parsed.unused.push(format!(
                "frame {} is a copy of frame {}, as are {n} of {total} compared frames of equal pose: held-out \
                 copies of trained frames are no new views; remove the copies",
                copy.name, first.name
            ));
        }
    }

    pub fn depth_with_confidence(
        &self,
        file: ByteSource,
        encoding: DepthEncoding,
        confidence: Option<ByteSource>,
    ) -> DepthSource {
        // Of 0 to 2; at 0 the sensor itself does not trust its value.
        let least = self.options.confidence.unwrap_or(1);
        DepthSource { file, encoding, confidence: confidence.map(|map| (map, least)) }
    }

    /// Returns the cameras of a photograph and a depth image that share one lens. `stated` holds the
    /// intrinsics from `file`, for any image size. `color` and `depth` are image sizes.
    pub fn cameras_of_lens(
        &self,
        stated: &Intrinsics,
        color: (u32, u32),
        depth: (u32, u32),
        file: &Path,
    ) -> Result<Cameras, DatasetError> {
        let of_depth = match self.options.intrinsics {
            Some(numbers) => from_user(numbers, depth)?,
            // One lens: intrinsics of another resolution scale with the image.
            None => fitted(stated, depth, file)?,
        };
        if !self.options.calibrated_photographs {
            same_shape(color, depth, file)?;
        }
        let resampled = || ColorCamera::from_depth_intrinsics(&of_depth, [color.0, color.1]);
        // Without a colour camera, photographs have the camera of depth.
        let color = (color != depth).then(resampled);
        Ok(Cameras { color, ..Cameras::registered(of_depth) })
    }

    /// Returns the cameras of photographs and depth images that have lenses of their own in one place.
    /// Each has the file of its intrinsics, for any image size. `color` and `depth` are image sizes.
    pub fn cameras_of_lenses(
        &self,
        (color_file, of_color): (&Path, &Intrinsics),
        (depth_file, of_depth): (&Path, &Intrinsics),
        color: (u32, u32),
        depth: (u32, u32),
    ) -> Result<Cameras, DatasetError> {
        // The user's numbers describe one lens.
        if self.options.intrinsics.is_some() {
            return self.cameras_of_lens(of_depth, color, depth, depth_file);
        }
        let of_depth = fitted(of_depth, depth, depth_file)?;
        let of_color = fitted(of_color, color, color_file)?;
        let camera = ColorCamera::from_depth_intrinsics(&of_color, [color.0, color.1]);
        let color = (of_color != of_depth).then_some(camera);
        Ok(Cameras { color, ..Cameras::registered(of_depth) })
    }
}

/// Scales intrinsics from the size for which `file` states them to images of `size`.
fn fitted(stated: &Intrinsics, size: (u32, u32), file: &Path) -> Result<Intrinsics, DatasetError> {
    same_shape((stated.width, stated.height), size, file)?;
    let k = stated.resized(size.0, size.1);
    check_intrinsics(&k, file)?;
    Ok(k)
}

/// Checks the intrinsics that `file` states: the camera must be possible, and the principal point must
/// not be the centre of images of another size.
pub(super) fn check_intrinsics(k: &Intrinsics, file: &Path) -> Result<(), DatasetError> {
    check(k).and_then(|()| check_centre(k)).map_err(|defect| {
        let IntrinsicsDefect { expected, found, hint } = defect;
        metadata_error(file, &expected, found, hint)
    })
}

/// Converts the error of a camera that one frame states, so that only the frame is skipped.
pub(super) fn own_camera(error: DatasetError) -> FrameProblem {
    let hint = "correct the camera of this frame, or remove the frame";
    match error {
        DatasetError::Metadata { file, expected, found, .. } => {
            let found = format!("{found} in {}", file.display());
            FrameProblem::Intrinsics { expected, found, hint: hint.to_owned() }
        }
        other => FrameProblem::Intrinsics {
            expected: "a camera".to_owned(),
            found: other.to_string(),
            hint: hint.to_owned(),
        },
    }
}

/// Largest difference between the aspect ratios of images through one lens, as a fraction. Scaling
/// rounds the sides, and small images were cropped to whole blocks.
const SHAPE_TOLERANCE: f64 = 0.02;

/// Checks that one lens can take images of both sizes.
fn same_shape(one: (u32, u32), other: (u32, u32), file: &Path) -> Result<(), DatasetError> {
    let [a, b] = [one, other].map(|(width, height)| f64::from(width) / f64::from(height));
    let is_rounded = have_same_aspect_ratio(one.into(), other.into());
    match is_rounded || (a / b - 1.0).abs() <= SHAPE_TOLERANCE {
        true => Ok(()),
        false => Err(metadata_error(
            file,
            "images and intrinsics of one shape, as one lens gives",
            format!("{}x{} ({a:.2}) and {}x{} ({b:.2})", one.0, one.1, other.0, other.1),
            "register depth to the photographs, or give the depth camera with --intrinsics and the \
             photographs' camera with --calibration",
        )),
    }
}

pub(super) fn metadata_error(
    file: &Path,
    expected: &str,
    found: String,
    hint: &str,
) -> DatasetError {
    DatasetError::Metadata {
        file: file.to_owned(),
        expected: expected.to_owned(),
        found,
        hint: hint.to_owned(),
    }
}

/// Returns the error for a recording without the poses that `file` should hold.
pub(super) fn no_poses(file: &Path, expected: &str, found: &str) -> DatasetError {
    let hint = "estimate the poses with --poses track, or add the poses";
    metadata_error(file, expected, found.to_owned(), hint)
}

pub(super) fn same_size(
    stated: (u32, u32),
    found: (u32, u32),
    file: &Path,
) -> Result<(), DatasetError> {
    match stated == found {
        true => Ok(()),
        false => Err(metadata_error(
            file,
            &format!("images of the stated size {}x{}", stated.0, stated.1),
            format!("{}x{}", found.0, found.1),
            "correct the size in the file, or export images and metadata together",
        )),
    }
}

/// Most frequent image size, pixels; `None` if there are no files. If no file can be read, the first
/// file and its error.
type ImageSize = Result<Option<(u32, u32)>, (PathBuf, FrameProblem)>;

pub(super) fn photograph_size(
    sources: impl IntoIterator<Item = impl Borrow<ByteSource>>,
) -> ImageSize {
    most(sources, |source| decode::header(source).map(|h| (h.width, h.height)))
}

pub(super) fn depth_size(sources: impl IntoIterator<Item = impl Borrow<ByteSource>>) -> ImageSize {
    most(sources, decode::depth_size)
}

fn most(
    sources: impl IntoIterator<Item = impl Borrow<ByteSource>>,
    size: impl Fn(&ByteSource) -> Result<(u32, u32), FrameProblem>,
) -> ImageSize {
    let sources: Vec<_> = sources.into_iter().collect();
    majority(&sources, |source| {
        let source = source.borrow();
        size(source).map_err(|problem| (source.path().to_owned(), problem))
    })
}
