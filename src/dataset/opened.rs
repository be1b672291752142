//! An opened dataset: its splits, what was refused, and what is known of its cameras.

use super::archive::Archive;
use super::calibration::Calibration;
use super::entry::{DatasetSplit, DepthSource, FrameEntry, HELD_OUT, HOLD_OUT_EVERY};
use super::error::{DatasetError, FrameError, FrameProblem, Warning};
use super::folder::{Folder, Recorded};
use super::formats::{self, Layout, ParsedFolder};
use super::frame::Frame;
use super::local_origin::LocalOrigin;
use super::options::LoadOptions;
use super::pose_convention::PoseConvention;
use super::position_range::PositionRange;
use super::surface::sensor::Sensor;
use crate::math::orbit::mean_up;
use crate::math::pose::Pose;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Posed frames in named splits.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// Last part of the path, or the name of the procedural scene.
    pub name: String,
    /// The folder or archive; `None` for the procedural scene.
    pub path: Option<PathBuf>,
    /// Whether it was read from a folder, to which frames may be added.
    pub is_folder: bool,
    /// How it is stored.
    pub layout: Layout,
    /// Which content the layout was recognised by.
    pub recognised_by: String,
    /// At least one, none of them empty.
    pub splits: Vec<DatasetSplit>,
    /// Frames that were listed but cannot be used.
    pub warnings: Vec<Warning>,
    /// What a user should know although nothing is wrong.
    pub notes: Vec<String>,
    /// Range of positions where the layout defines one; see [`super::range::estimate`].
    pub known_range: Option<PositionRange>,
    /// What was overridden when it was opened, and where the cameras' origin lies if not at zero.
    pub options: LoadOptions,
}

/// Opens a dataset folder: recognises the layout and reads metadata and poses.
///
/// # Errors
/// A folder that cannot be read, is of no known layout, or has no usable frame; metadata that no
/// camera has; an option outside its range.
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
    // Before any file is touched: a wrong option is wrong usage, whatever the folder holds.
    options.check()?;
    let dataset = read(&Folder::open(path, Recorded::default())?, path, options)?;
    match dataset.splits.is_empty() {
        true => Err(no_usable_frame(path, dataset.warnings)),
        false => Ok(dataset),
    }
}

/// What a folder holds, which may be no frame.
pub(super) fn read(
    folder: &Folder,
    path: &Path,
    options: &LoadOptions,
) -> Result<Dataset, DatasetError> {
    let (layout, recognised_by, mut parsed) = formats::parse(folder, options)?;
    if options.track {
        forget_poses(&mut parsed);
    } else if let Some(asked) = options.poses {
        reinterpret(&mut parsed.splits, layout.pose_convention(), asked);
    }
    check_used(options, &parsed.splits)?;
    // Of the resolved path: `.` has no last part of its own.
    let name = path.canonicalize().ok().and_then(|p| Some(p.file_name()?.to_str()?.to_owned()));
    let mut dataset = Dataset {
        name: name.unwrap_or_else(|| "dataset".to_owned()),
        path: Some(path.to_owned()),
        is_folder: folder.only_file().is_none(),
        layout,
        recognised_by,
        // What chooses a split or its first frame need not ask whether there is one.
        splits: parsed.splits.into_iter().filter(|s| !s.frames.is_empty()).collect(),
        warnings: parsed.warnings,
        notes: parsed.notes,
        known_range: parsed.known_range,
        options: *options,
    };
    let metre = dataset.metre();
    if metre != 1.0 {
        dataset.notes.push(format!(
            "scale and range of depth say {metre} world units to the metre: what is known of the sensor, its noise among it, is taken so"
        ));
    }
    move_origin(&mut dataset);
    Ok(dataset)
}

/// Tells cameras, and what is known of where things are, relative to the local origin.
fn move_origin(dataset: &mut Dataset) {
    let split = dataset.splits.get(dataset.training_split().unwrap_or(0));
    let Some(split) = split else { return };
    let asked = dataset.options.local_origin;
    let LocalOrigin { place, note } = LocalOrigin::of(split, dataset.metre(), asked);
    dataset.notes.extend(note);
    // Left out where it is zero: near worlds keep their bits, and what is saved of them its bytes.
    dataset.options.local_origin = (place != DVec3::ZERO).then_some(place.to_array());
    if place == DVec3::ZERO {
        return;
    }
    for frame in dataset.splits.iter_mut().flat_map(|split| &mut split.frames) {
        frame.camera.pose = frame.camera.pose.relative_to(place);
    }
    dataset.known_range = dataset.known_range.take().map(|range| range.relative_to(place));
}

/// Refuses options that nothing in the files asks for: whoever gave them believes otherwise.
fn check_used(options: &LoadOptions, splits: &[DatasetSplit]) -> Result<(), DatasetError> {
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
            expected: "a recording whose sensor tells it",
            found: "none of its maps".to_owned(),
        });
    }
    Ok(())
}

/// Whether a file is an archive that [`open`] takes in place of a folder, told by its content.
pub fn is_archive(path: &Path) -> bool {
    // What a disk does not tell, whoever reads the file next is told.
    Archive::is_one(path).unwrap_or(false)
}

/// Reads poses anew, as if their matrices meant something else than the layout says.
fn reinterpret(splits: &mut [DatasetSplit], stated: PoseConvention, asked: PoseConvention) {
    for frame in splits.iter_mut().flat_map(|split| &mut split.frames) {
        // A sound pose has a sound matrix in every convention.
        if let Ok(pose) = asked.pose(stated.matrix(&frame.camera.pose)) {
            frame.camera.pose = pose;
        }
    }
}

/// Leaves all cameras at the origin: where they stood is for tracking to find.
fn forget_poses(parsed: &mut ParsedFolder) {
    for frame in parsed.splits.iter_mut().flat_map(|split| &mut split.frames) {
        frame.camera.pose = Pose::IDENTITY;
    }
    // What is known of where things are is known of the recorded poses' world.
    parsed.known_range = None;
}

/// Every frame was refused, or none is listed.
pub(super) fn no_usable_frame(path: &Path, warnings: Vec<Warning>) -> DatasetError {
    let skipped = warnings.len();
    // Nobody else holds the warnings yet, so that the first error can be taken out of its `Arc`.
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

impl Dataset {
    /// Loads one frame: decodes its images and checks that they agree with each other and with
    /// the camera. `split` and `index` are positions in [`Dataset::splits`] and [`DatasetSplit::frames`].
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

    /// Loads a frame that settings are chosen by. Twice: what a disk refuses once is learnt from later, and
    /// settings would differ for no reason that anybody is told. What it goes on to refuse is told.
    pub(crate) fn load_sampled(&self, split: usize, index: usize) -> Result<Frame, FrameError> {
        let loaded = self.load(split, index).or_else(|_| self.load(split, index));
        if let Err(error) = &loaded
            && matches!(error.problem, FrameProblem::Read(_))
        {
            tracing::warn!("{error}; settings are chosen by other frames");
        }
        loaded
    }

    /// Takes up what a look at the growing recording found: the frames of `split` are appended, other
    /// splits replaced.
    pub fn grow(&mut self, split: usize, found: Self) {
        for mut new in found.splits.into_iter().filter(|new| !new.frames.is_empty()) {
            // Counted below: a look sees new frames alone.
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
        self.hold_out(split);
    }

    /// Brings the split of the views that training on `split` leaves out, if there is one, up to its
    /// frames.
    pub(super) fn hold_out(&mut self, split: usize) {
        let held_out = self.splits.iter().position(|split| split.name == HELD_OUT);
        let Some(at) = held_out.filter(|at| *at != split) else { return };
        if let Ok([held_out, trained]) = self.splits.get_disjoint_mut([at, split]) {
            let frames = trained.frames.iter().step_by(HOLD_OUT_EVERY);
            let more = frames.skip(held_out.frames.len()).cloned();
            held_out.frames.extend(more);
        }
    }

    /// What its layout knows of the cameras without a calibration: the colour camera of a Kinect
    /// where depth has the published Kinect's intrinsics. `None` where nothing is known.
    pub fn known_calibration(&self) -> Option<Calibration> {
        let depth_camera = self.splits.first()?.frames.first()?.camera.intrinsics;
        let mut known = self.layout.known_calibration(&depth_camera)?;
        if let Some(color) = &mut known.color_camera {
            color.offset = color.offset.map(|metres| metres * self.metre());
        }
        Some(known)
    }

    /// Where the origin of its cameras lies in the world of the files, world units: zero unless that is
    /// too far away for 32-bit positions.
    pub fn local_origin(&self) -> DVec3 {
        self.options.local_origin.map_or(DVec3::ZERO, DVec3::from_array)
    }

    /// Direction that points up in the world, as far as the cameras of a split tell.
    pub fn up(&self, split: usize) -> DVec3 {
        let frames = self.splits.get(split).into_iter().flat_map(|split| &split.frames);
        mean_up(frames.map(|frame| &frame.camera.pose))
    }

    /// Whether its world is known to be in metres.
    pub fn is_metric(&self) -> bool {
        self.layout.is_metric() && self.metre() == 1.0
    }

    /// World units per metre, as far as the user says: 1 unless scale and range of depth are in another
    /// unit.
    pub fn metre(&self) -> f64 {
        let mut frames = self.splits.iter().flat_map(|s| &s.frames);
        frames.find_map(FrameEntry::metre).unwrap_or(1.0)
    }

    /// The sensor that its depth is from, as the first frame with depth tells; exact depth where
    /// no frame has any.
    pub fn sensor(&self) -> Sensor {
        let mut frames = self.splits.iter().flat_map(|s| &s.frames);
        frames.find_map(|frame| frame.sensor()).unwrap_or(Sensor::Exact { noise: 0.0 })
    }
}
