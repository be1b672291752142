//! An opened dataset: splits, skipped frames, options, and properties of its cameras.

use super::archive::{Archive, Unpacked, holds_splats, may_hold_folder, unpack};
use super::bag::is_bag;
use super::calibration::Calibration;
use super::entry::{DatasetSplit, DepthSource, FrameEntry, HELD_OUT, HOLD_OUT_EVERY, MaskSource};
use super::error::{DatasetError, FrameError, FrameProblem, Warning};
use super::folder::{Folder, RecordingState};
use super::formats;
use super::formats::{Layout, ParsedFolder};
use super::frame::Frame;
use super::options::{FARTHEST_SENSED, LoadOptions};
use super::pose_check::PoseConvention;
use super::range::{PositionRange, median};
use super::splits::is_for_evaluation;
use super::surface::sensor::Sensor;
use super::wild_poses::outlier_poses;
use crate::math::orbit::mean_up;
use crate::math::pose::Pose;
use glam::DVec3;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Posed frames in named splits.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Last component of the path, or the name of the procedural scene.
    pub name: String,
    /// Path of the folder or archive; `None` for the procedural scene.
    pub path: Option<PathBuf>,
    /// True if the dataset was read from a folder, to which frames may be added.
    pub is_folder: bool,
    /// Files of the archive that the dataset was read from, if they had to be unpacked.
    pub(super) unpacked: Option<Arc<Unpacked>>,
    /// Layout of the files.
    pub layout: Layout,
    /// Description of the content that identified the layout.
    pub recognised_by: String,
    /// Splits of the dataset, at least one; each has at least one frame.
    pub splits: Vec<DatasetSplit>,
    /// Frames that are listed but cannot be used.
    pub warnings: Vec<Warning>,
    /// Notices for the user that are not defects.
    pub notes: Vec<String>,
    /// Statements of the files about cameras, units or times that are not used, each with its file, and other
    /// defects that cost no frame.
    pub unused: Vec<String>,
    /// Range of positions if the layout defines one; see [`super::range::estimate`].
    pub known_range: Option<PositionRange>,
    /// Options with which the dataset was opened. The local origin is added if the cameras are too far
    /// from zero for 32-bit positions.
    pub options: LoadOptions,
}

/// Opens a dataset folder: recognises the layout and reads metadata and poses. A zip archive that holds a
/// recording's folder is unpacked, and opens like it.
///
/// # Errors
/// A folder that cannot be read, has no known layout, or has no usable frame. Implausible camera
/// metadata. An option out of range.
///
/// ```
/// use vbgs_studio::dataset::synthetic::SyntheticParams;
/// use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write};
/// use vbgs_studio::dataset::{Layout, LoadOptions, open};
///
/// let folder = tempfile::tempdir()?;
/// let params =
///     SyntheticParams { width: 16, height: 12, n_train: 2, n_eval: 1, ..SyntheticParams::demo() };
/// write(&params, folder.path(), SyntheticLayout::SevenScenes, &mut |_, _| ())?;
///
/// let dataset = open(folder.path(), &LoadOptions::default())?;
/// assert_eq!((dataset.layout, dataset.layout.name()), (Layout::SevenScenes, "seven-scenes"));
/// let frame = dataset.load(dataset.training_split()?, 0)?;
/// assert_eq!((frame.color.width, frame.color.height), (16, 12));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn open(path: &Path, options: &LoadOptions) -> Result<Dataset, DatasetError> {
    // Checked before any file is read: an invalid option is wrong usage, whatever the folder holds.
    options.check()?;
    let mut folder = Folder::open(path, RecordingState::default())?;
    let mut unpacked = None;
    if is_packed_folder(&folder, path, options) {
        let files = unpack(path)?;
        folder = recording_below(&files.folder, options)?;
        unpacked = Some(Arc::new(files));
    }
    let mut dataset = read(&folder, path, options).map_err(|error| match error {
        // The temporary folder is gone when the message is read.
        DatasetError::NotRecognised { expected, found, .. } if unpacked.is_some() => {
            DatasetError::NotRecognised { path: path.to_owned(), expected, found }
        }
        error => advised(error, options),
    })?;
    dataset.is_folder &= unpacked.is_none();
    dataset.unpacked = unpacked;
    match dataset.splits.is_empty() {
        true => Err(no_usable_frame(path, dataset.warnings)),
        false => Ok(dataset),
    }
}

/// Checks that [`open`] would recognise the layout of a folder or archive, without reading its frames. Of an
/// archive that has to be unpacked, only the names of its files are checked.
///
/// # Errors
/// As for [`open`], of the folder and its layout.
pub fn check_layout(path: &Path, options: &LoadOptions) -> Result<(), DatasetError> {
    let folder = Folder::open(path, RecordingState::default())?;
    if is_packed_folder(&folder, path, options) {
        return Ok(());
    }
    formats::recognise(&folder, options).map(drop).map_err(|error| advised(error, options))
}

/// Opens the first folder with a known layout, from `path` on inwards while a folder holds only one other. The
/// last one if none has a known layout.
fn recording_below(path: &Path, options: &LoadOptions) -> Result<Folder, DatasetError> {
    let mut folder = Folder::open(path, RecordingState::default())?;
    while formats::recognise(&folder, options).is_err() {
        let [inner] = &folder.subfolders()[..] else { break };
        folder = Folder::open(&folder.path.join(inner), RecordingState::default())?;
    }
    Ok(folder)
}

/// True for a zip archive that is no recording itself but may hold the folder of one.
fn is_packed_folder(folder: &Folder, path: &Path, options: &LoadOptions) -> bool {
    let is_plain =
        || matches!(formats::recognise(folder, options), Err(DatasetError::OtherFormat { .. }));
    folder.opened_archive().is_some() && is_plain() && may_hold_folder(path)
}

/// Number of folders above a part of a recording that are searched for all of it: `iphone/rgb` is two below.
const MOST_ABOVE: usize = 3;

/// Replaces the error of an unknown layout if a folder above has a known one.
fn advised(error: DatasetError, options: &LoadOptions) -> DatasetError {
    let DatasetError::NotRecognised { path, .. } = &error else { return error };
    let is_recording = |above: &&Path| {
        Folder::open(above, RecordingState::default())
            .and_then(|folder| formats::recognise(&folder, options))
            .is_ok()
    };
    let Ok(part) = path.canonicalize() else { return error };
    match part.ancestors().skip(1).take(MOST_ABOVE).find(is_recording) {
        Some(above) => {
            DatasetError::InsideRecording { path: path.clone(), above: above.to_owned() }
        }
        None => error,
    }
}

pub(super) fn read(
    folder: &Folder,
    path: &Path,
    options: &LoadOptions,
) -> Result<Dataset, DatasetError> {
    let (layout, recognised_by, mut parsed) = formats::parse(folder, options)?;
    // A convention has no effect on poses that are ignored.
    if options.track {
        clear_poses(&mut parsed);
    } else if let Some(asked) = options.poses {
        reinterpret(&mut parsed.splits, layout.pose_convention(), asked);
    }
    find_masks(folder, &mut parsed);
    check_options_used(options, &parsed.splits)?;
    // Of the resolved path: `.` has no last component.
    let name = path.canonicalize().ok().and_then(|p| Some(p.file_name()?.to_str()?.to_owned()));
    let mut dataset = Dataset {
        name: name.unwrap_or_else(|| "dataset".to_owned()),
        path: Some(path.to_owned()),
        is_folder: folder.opened_archive().is_none(),
        unpacked: None,
        layout,
        recognised_by,
        // Splits are not empty, so that code may take the first frame of one.
        splits: parsed.splits.into_iter().filter(|s| !s.frames.is_empty()).collect(),
        warnings: parsed.warnings,
        notes: parsed.notes,
        unused: parsed.unused,
        known_range: parsed.known_range,
        options: *options,
    };
    let metre = dataset.units_per_metre();
    if metre != 1.0 {
        dataset.notes.push(format!(
            "depth scale and depth range, or the files, imply {metre} world units to the metre; sensor properties such as noise are scaled accordingly"
        ));
    }
    let trained = dataset.training_split().ok().and_then(|split| dataset.splits.get(split));
    if let Some(name) = trained.map(|split| &split.name).filter(|name| is_for_evaluation(name)) {
        dataset.notes.push(format!(
            "the split `{name}` is the default for training, since no split `train` has depth: name another for evaluation"
        ));
    }
    // Last: the limit of a far world is in sensor ranges, which the unit scales.
    apply_local_origin(&mut dataset);
    Ok(dataset)
}

fn apply_local_origin(dataset: &mut Dataset) {
    let split = dataset.splits.get(dataset.training_split().unwrap_or(0));
    let Some(split) = split else { return };
    let metre = dataset.units_per_metre();
    let (place, note) = match dataset.options.local_origin.map(DVec3::from_array) {
        Some(asked) => {
            let beside = far_origin(split, metre, asked);
            (asked, beside.map(|far| mismatch_notice(asked, far)))
        }
        None => {
            let far = far_origin(split, metre, DVec3::ZERO);
            (far.unwrap_or(DVec3::ZERO), far.map(moved_notice))
        }
    };
    dataset.notes.extend(note);
    // `None` for a zero origin: nearby worlds and files saved from them stay unchanged to the byte.
    dataset.options.local_origin = (place != DVec3::ZERO).then_some(place.to_array());
    if place == DVec3::ZERO {
        return;
    }
    for frame in dataset.splits.iter_mut().flat_map(|split| &mut split.frames) {
        frame.camera.pose = frame.camera.pose.with_origin(place);
    }
    dataset.known_range = dataset.known_range.take().map(|range| range.relative_to(place));
}

/// Finds masks that no file names. They are images of the photograph's name in a folder `masks` or `mask`
/// beside its folder, whose black pixels are left out, or `dynamic_mask_NAME.png` beside the photograph,
/// whose other pixels are left out.
fn find_masks(folder: &Folder, parsed: &mut ParsedFolder) {
    // Folders that do not exist are asked for once, not once per frame.
    let mut listings = HashMap::new();
    let mut n_found = 0;
    for (is_part, frame) in parsed.splits.iter_mut().flat_map(|split| {
        let is_part = split.name == HELD_OUT;
        split.frames.iter_mut().map(move |frame| (is_part, frame))
    }) {
        let color = frame.color_path().and_then(|path| path.strip_prefix(&folder.path).ok());
        let Some((name, parent)) =
            color.and_then(|path| path.file_name()?.to_str().zip(path.parent()))
        else {
            continue;
        };
        let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
        let beside = parent.parent().unwrap_or(parent);
        let same = [format!("{stem}.png"), format!("{name}.png"), name.to_owned()];
        let dynamic = [format!("dynamic_mask_{stem}.png")];
        let places: [(PathBuf, &[String], bool); 3] = [
            (beside.join("masks"), &same, true),
            (beside.join("mask"), &same, true),
            (parent.to_owned(), &dynamic, false),
        ];
        let mask = places.into_iter().find_map(|(at, names, hides_black)| {
            let listing = listings.entry(at.clone()).or_insert_with(|| folder.list(&at).ok());
            let listing = listing.as_ref()?;
            let name = names.iter().find(|name| listing.has_file(name))?;
            let file = folder.file(&at, listing, name).ok()?.into();
            Some(MaskSource { file, hides_black })
        });
        n_found += usize::from(frame.add_mask(mask) && !is_part);
    }
    if n_found > 0 {
        let said = format!("masks beside the photographs: pixels of {n_found} frames are left out");
        parsed.notes.push(said);
    }
}

/// Checks that depth scale and confidence affect the dataset's files, if the user set them.
fn check_options_used(options: &LoadOptions, splits: &[DatasetSplit]) -> Result<(), DatasetError> {
    let depths = || splits.iter().flat_map(|split| &split.frames).filter_map(|f| f.depth_source());
    if depths().next().is_none() {
        return Ok(());
    }
    let is_used = |is_asked: bool, by: &dyn Fn(&DepthSource) -> bool| !is_asked || depths().any(by);
    if !is_used(options.depth_scale.is_some(), &|depth| depth.encoding.has_unit()) {
        return Err(DatasetError::Option {
            setting: "depth scale",
            expected: "none, since the depth of this layout is stored in world units",
            found: options.depth_scale.unwrap_or_default().to_string(),
        });
    }
    if !is_used(options.confidence.is_some(), &|depth| depth.confidence.is_some()) {
        return Err(DatasetError::Option {
            setting: "confidence",
            expected: "a recording with confidence maps",
            found: "none".to_owned(),
        });
    }
    Ok(())
}

/// True for a file that holds a recording: a zip archive or a bag (MCAP), which [`open`] accepts in place of a folder, or
/// another program's recording, which it refuses with advice. False for a zip archive of splats (SOG), whatever its name.
pub fn is_archive(path: &Path) -> bool {
    // The next reader of the file reports a disk error.
    if Archive::is_zip_archive(path).unwrap_or(false) {
        return !holds_splats(path);
    }
    is_bag(path).unwrap_or(false)
        || matches!(DatasetError::not_a_folder(path), DatasetError::OtherFormat { .. })
}

fn reinterpret(splits: &mut [DatasetSplit], stated: PoseConvention, asked: PoseConvention) {
    for frame in splits.iter_mut().flat_map(|split| &mut split.frames) {
        // A rigid pose is rigid in every convention.
        if let Ok(pose) = asked.pose(stated.matrix(&frame.camera.pose)) {
            frame.camera.pose = pose;
        }
    }
}

fn clear_poses(parsed: &mut ParsedFolder) {
    for frame in parsed.splits.iter_mut().flat_map(|split| &mut split.frames) {
        frame.camera.pose = Pose::IDENTITY;
    }
    // The known range refers to the recorded poses' world.
    parsed.known_range = None;
}

pub(super) fn no_usable_frame(path: &Path, warnings: Vec<Warning>) -> DatasetError {
    let skipped = warnings.len();
    // The warnings are not shared yet, so the first error can be taken out of its `Arc`.
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

/// Loads images from which settings are estimated. Retries once, because a temporary disk error would
/// silently change the settings. A read error that persists is logged.
pub(super) fn with_retry<T>(load: impl Fn() -> Result<T, FrameError>) -> Result<T, FrameError> {
    let loaded = load().or_else(|_| load());
    if let Err(error) = &loaded
        && matches!(error.problem, FrameProblem::Read(_))
    {
        tracing::warn!("{error}; settings are chosen by other frames");
    }
    loaded
}

impl Dataset {
    /// Loads one frame: decodes its images and checks that they agree with each other and with the
    /// camera. `split` and `index` are indices into [`Dataset::splits`] and [`DatasetSplit::frames`].
    ///
    /// # Errors
    /// As [`FrameEntry::load`], and an index out of range.
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

    /// Adds the frames that a poll of the growing recording returned. Frames of `split` are appended;
    /// other splits are replaced.
    pub fn append_polled(&mut self, split: usize, found: Self) {
        for mut new in found.splits.into_iter().filter(|new| !new.frames.is_empty()) {
            // Extended below: a poll finds new frames only.
            if new.name == HELD_OUT {
                new.frames.clear();
            }
            let mut splits = self.splits.iter_mut().enumerate();
            match splits.find(|(_, old)| old.name == new.name) {
                Some((at, old)) if at == split => old.frames.extend(new.frames),
                Some(_) if new.name == HELD_OUT => {}
                Some((_, old)) => *old = new,
                None => self.splits.push(new),
            }
        }
        self.warnings.extend(found.warnings);
        self.extend_held_out(split);
    }

    pub(super) fn extend_held_out(&mut self, split: usize) {
        let held_out = self.splits.iter().position(|split| split.name == HELD_OUT);
        let Some(at) = held_out.filter(|at| *at != split) else { return };
        if let Ok([held_out, trained]) = self.splits.get_disjoint_mut([at, split]) {
            let frames = trained.frames.iter().step_by(HOLD_OUT_EVERY);
            // `split` may have grown: frames held out before stay, and only later ones are added.
            let more = frames.skip(held_out.frames.len()).cloned();
            held_out.frames.extend(more);
        }
    }

    /// Returns the calibration known for the layout: the colour camera of a Kinect if depth has the
    /// published Kinect intrinsics and the files state no colour camera. `None` for other cameras and layouts.
    pub fn known_calibration(&self) -> Option<Calibration> {
        let first = self.splits.first()?.frames.first()?;
        // A colour camera that the files state takes precedence.
        let depth_camera = first.color_camera.is_none().then_some(first.camera.intrinsics)?;
        let mut known = self.layout.known_calibration(&depth_camera)?;
        if let Some(color) = &mut known.color_camera {
            color.offset = color.offset.map(|metres| metres * self.units_per_metre());
        }
        Some(known)
    }

    /// Returns the origin of the camera poses in the coordinates of the files, world units. It is zero
    /// unless the options set it, or the cameras are too far from zero for 32-bit positions.
    pub fn local_origin(&self) -> DVec3 {
        self.options.local_origin.map_or(DVec3::ZERO, DVec3::from_array)
    }

    /// Estimates the up direction of the world from the cameras of a split.
    pub fn up(&self, split: usize) -> DVec3 {
        let frames = self.splits.get(split).into_iter().flat_map(|split| &split.frames);
        mean_up(frames.map(|frame| &frame.camera.pose))
    }

    /// True if world units are known to be metres.
    pub fn is_metric(&self) -> bool {
        self.layout.is_metric() && self.units_per_metre() == 1.0
    }

    /// Returns the number of world units per metre, derived from the user's options. It is 1 unless
    /// depth scale and depth range are in another unit.
    pub fn units_per_metre(&self) -> f64 {
        let mut frames = self.splits.iter().flat_map(|s| &s.frames);
        frames.find_map(FrameEntry::metre).unwrap_or(1.0)
    }

    /// Returns the depth sensor of the first frame with depth. Without depth, returns [`Sensor::Exact`]
    /// without noise.
    pub fn sensor(&self) -> Sensor {
        let mut frames = self.splits.iter().flat_map(|s| &s.frames);
        frames.find_map(|frame| frame.sensor()).unwrap_or(Sensor::Exact { noise: 0.0 })
    }
}

/// Smallest distance of cameras from zero at which positions need a local origin, in multiples of the
/// largest sensed depth. At smaller distances, `f32` positions are rounded by less than 2⁻¹⁸ of that
/// depth. This error is a hundredth of the structural scale (the largest distance of a point from its
/// component's seed).
const FAR: f64 = 64.0;
/// Minimum distance from zero of cameras that need a local origin, in multiples of their spread. A local
/// origin gains nothing if the cameras are spread as widely as they are distant.
const FAR_BESIDE_SPREAD: f64 = 8.0;

fn moved_notice(place: DVec3) -> String {
    let ([x, y, z], distance) = (place.to_array(), place.length());
    format!(
        "the cameras lie {distance:.0} world units from zero, where 32-bit positions are coarse: positions are stored relative to the local origin ({x}, {y}, {z})"
    )
}

fn mismatch_notice(asked: DVec3, far: DVec3) -> String {
    let ([x, y, z], distance) = (asked.to_array(), far.length());
    format!(
        "the cameras lie {distance:.0} world units from the local origin ({x}, {y}, {z}) of the model beside them: expected cameras near it; pictures and metrics are imprecise or show another place; use a checkpoint, PLY or GLB trained on this dataset"
    )
}

/// Returns the local origin that cameras far from `origin` need; `None` for cameras near `origin`. It is
/// the position of the first camera that is not an outlier, relative to `origin` and rounded to whole
/// metres.
fn far_origin(split: &DatasetSplit, metre: f64, origin: DVec3) -> Option<DVec3> {
    let centre = first_inlier_position(split)?;
    let from_origin = centre - origin;
    let distance = from_origin.length();
    let is_far = distance > FAR * FARTHEST_SENSED * metre
        && distance > FAR_BESIDE_SPREAD * spread(split, centre);
    // Whole metres: short numbers for files and users.
    is_far.then(|| (from_origin / metre).round() * metre)
}

fn first_inlier_position(split: &DatasetSplit) -> Option<DVec3> {
    let wild = outlier_poses(split);
    let is_sound = |i: &usize| wild.iter().all(|wild| wild.index != *i);
    let first = (0..split.frames.len()).find(is_sound).unwrap_or(0);
    Some(split.frames.get(first)?.camera.pose.centre())
}

fn spread(split: &DatasetSplit, centre: DVec3) -> f64 {
    let distance = |frame: &FrameEntry| frame.camera.pose.centre().distance(centre);
    // The median ignores wild poses.
    median(split.frames.iter().map(distance).collect()).unwrap_or(0.0)
}
