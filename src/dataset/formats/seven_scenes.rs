//! 7-Scenes: `STEM.color.{png,jpg}`, `STEM.depth.png` (16-bit, millimetres along the optical axis, 0 and
//! 65535 are holes) and `STEM.pose.txt` (camera-to-world, OpenCV axes).
//!
//! Frames are in sequence folders listed by `TrainSplit.txt` and `TestSplit.txt`, or in one folder per
//! split, or in the root. Cameras come from a text in the frames' folder or the root: a camera matrix such
//! as `camera-intrinsics.txt`, or `info.txt` with both cameras and the unit of depth, as of BundleFusion.
//! Without one, the dataset's published camera is used.
//!
//! The published recordings are not registered: a separate camera took the colour images. The files do not
//! state this, hence the notice at opening. The known calibration applies only if the depth intrinsics are
//! the published ones and no file states the colour camera.

use super::numbered::{ListedFrame, ListedSplit};
use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, depth_size, encoding, photograph_size,
};
use super::stated;
use super::stated::{KnownCamera, POSE_SUFFIX, SensorInfo};
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::decode::CodeKind;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, FolderListing, read_small_text};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

const COLOR_SUFFIXES: [&str; 3] = [".color.png", ".color.jpg", ".color.jpeg"];
const DEPTH_SUFFIX: &str = ".depth.png";
const SPLIT_SUFFIX: &str = "Split.txt";
const INTRINSICS_FILE: &str = "camera-intrinsics.txt";
/// Depth camera of the published dataset.
const PUBLISHED: KnownCamera = KnownCamera {
    source: "published",
    intrinsics: Intrinsics { width: 640, height: 480, fx: 585.0, fy: 585.0, cx: 320.0, cy: 240.0 },
};

/// Returns the known colour camera if `depth_camera` is the published Kinect, whose colour images are
/// not registered to depth.
pub(super) fn known_calibration(depth_camera: &Intrinsics) -> Option<Calibration> {
    // Exactly equal: a folder with its own intrinsics is another camera.
    let is_kinect = *depth_camera == PUBLISHED.intrinsics;
    is_kinect
        .then_some(Calibration { color_camera: Some(ColorCamera::KINECT), ..Calibration::NONE })
}

fn recognise(folder: &Folder) -> Option<String> {
    // Frames in the root count first: one sequence may be opened alone.
    let n_root = folder.listing.files().filter(|n| color_stem(n).is_some()).count();
    if n_root > 0 {
        return Some(format!("{n_root} `*.color.*` files in the folder"));
    }
    let with_frames = folders_with_frames(folder);
    if !with_frames.is_empty() {
        return Some(format!("`*.color.*` files in {}", with_frames.join(", ")));
    }
    // Lists without their sequences are recognised too, so that messages name what to unpack.
    let lists = split_files(folder);
    (!lists.is_empty()).then(|| format!("split files {}", lists.join(", ")))
}

fn folders_with_frames(folder: &Folder) -> Vec<String> {
    let mut names = folder.subfolders();
    names.retain(|name| {
        let listing = folder.list(Path::new(name));
        listing.is_ok_and(|listing| listing.files().any(|file| color_stem(file).is_some()))
    });
    names
}

fn color_stem(name: &str) -> Option<&str> {
    COLOR_SUFFIXES.iter().find_map(|suffix| name.strip_suffix(suffix))
}

fn split_files(folder: &Folder) -> Vec<&str> {
    let is_split = |n: &&str| n.len() > SPLIT_SUFFIX.len() && n.ends_with(SPLIT_SUFFIX);
    folder.listing.files().filter(is_split).collect()
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let parsed = &mut recording.parsed;
    let (mut splits, mut all_folders) = (Vec::new(), BTreeSet::new());
    for (split, folders) in split_folders(folder, parsed)? {
        let mut listed = ListedSplit { name: split, frames: Vec::new() };
        for frames_in in &folders {
            collect((folder, options), frames_in, &mut listed, parsed);
        }
        splits.push(listed);
        all_folders.extend(folders);
    }
    // One camera took all splits, so its size is that of most images of all splits.
    let Ok(Some(size)) = photograph_size(splits.iter().flat_map(ListedSplit::colors)) else {
        splits.into_iter().for_each(|listed| listed.skip_unreadable(parsed));
        return Ok(recording.parsed);
    };
    let depths = depth_size(splits.iter().flat_map(ListedSplit::depths));
    // Unreadable depth is reported with its frames.
    let sizes = (size, depths.ok().flatten().unwrap_or(size));
    let by_folder = cameras_by_folder(&mut recording, all_folders, sizes)?;
    if by_folder.values().any(|(cameras, _)| cameras.color.is_none()) {
        // A matrix does not show whether colours are registered.
        recording.note("colour images are not registered to depth (7-Scenes)");
    }
    let mut parsed = recording.parsed;
    // Every frame lies in one of the folders.
    let Some(first) = by_folder.values().next() else { return Ok(parsed) };
    let read_as = |name: &str| {
        let folder = Path::new(name).parent().unwrap_or(Path::new(""));
        let (cameras, unit) = *by_folder.get(folder).unwrap_or(first);
        let unit = CodeKind::Linear16(unit);
        (cameras, encoding(options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE))
    };
    for listed in splits {
        let split = listed.into_split(read_as, &mut parsed);
        parsed.splits.push(split);
    }
    Ok(parsed)
}

fn split_folders(
    folder: &Folder,
    parsed: &mut ParsedFolder,
) -> Result<Vec<(String, Vec<String>)>, DatasetError> {
    if folder.listing.files().any(|n| color_stem(n).is_some()) {
        return Ok(vec![("all".to_owned(), vec![String::new()])]);
    }
    let with_frames = folders_with_frames(folder);
    let lists = split_files(folder);
    if lists.is_empty() {
        // Sequences are parts of one recording; only a list divides them into splits.
        if with_frames.iter().all(|name| sequence_number(name).is_some()) {
            return Ok(vec![("all".to_owned(), with_frames)]);
        }
        return Ok(with_frames.into_iter().map(|name| (name.clone(), vec![name])).collect());
    }
    let mut splits = Vec::new();
    for list in lists {
        // `TrainSplit.txt` is the split `train`: split names are in lower case elsewhere.
        let split = list.trim_end_matches(SPLIT_SUFFIX).to_lowercase();
        let file = folder.path.join(list);
        let text = read_small_text(&file)
            .map_err(|source| DatasetError::Read { path: file.clone(), source })?;
        let mut folders = Vec::new();
        for line in text.lines().map(str::trim).filter(|line| !line.is_empty()) {
            match with_frames.iter().find(|name| is_sequence(name, line)) {
                Some(name) => folders.push(name.clone()),
                None => {
                    let problem = FrameProblem::MissingSequence(sequence_folder(line));
                    parsed.skip(&split, line, file.clone(), problem);
                }
            }
        }
        // Without folders the split is empty, and the caller drops it.
        splits.push((split, folders));
    }
    note_shared(&splits, parsed);
    Ok(splits)
}

/// Adds a note about sequences that belong to more than one split. Evaluation on them would use training
/// frames.
fn note_shared(splits: &[(String, Vec<String>)], parsed: &mut ParsedFolder) {
    for (i, (split, folders)) in splits.iter().enumerate() {
        for (other, of_other) in splits.iter().skip(i + 1) {
            let shared: Vec<_> = folders.iter().filter(|f| of_other.contains(f)).cloned().collect();
            if !shared.is_empty() {
                let shared = shared.join(", ");
                parsed.notes.push(format!(
                    "the splits `{split}` and `{other}` share {shared}: remove it from one of their lists"
                ));
            }
        }
    }
}

/// True if an entry of a split file, such as `sequence1`, refers to the folder, such as `seq-01`.
fn is_sequence(folder: &str, listed: &str) -> bool {
    folder == listed
        || (sequence_number(folder).is_some() && sequence_number(folder) == sequence_number(listed))
}

fn sequence_number(name: &str) -> Option<u32> {
    name.strip_prefix("seq")?.trim_start_matches(|c: char| !c.is_ascii_digit()).parse().ok()
}

fn sequence_folder(listed: &str) -> String {
    sequence_number(listed).map_or_else(|| listed.to_owned(), |n| format!("seq-{n:02}"))
}

fn collect(
    (folder, options): (&Folder, &LoadOptions),
    frames_in: &str,
    listed: &mut ListedSplit,
    parsed: &mut ParsedFolder,
) {
    let relative = Path::new(frames_in);
    let ListedSplit { name: split, frames } = listed;
    let listing = match folder.list(relative) {
        Ok(listing) => listing,
        Err(problem) => return parsed.skip(split, frames_in, folder.path.join(relative), problem),
    };
    for color in listing.files() {
        let Some(stem) = color_stem(color) else { continue };
        if folder.was_taken(&frame_name(relative, stem)) {
            continue;
        }
        match listed_frame((folder, options), relative, &listing, color, stem) {
            Ok(frame) => frames.push(frame),
            Err((file, problem)) => parsed.skip(split, stem, file, problem),
        }
    }
}

fn listed_frame(
    (folder, options): (&Folder, &LoadOptions),
    relative: &Path,
    listing: &FolderListing,
    color: &str,
    stem: &str,
) -> Result<ListedFrame, (PathBuf, FrameProblem)> {
    let pose_name = format!("{stem}{POSE_SUFFIX}");
    let pose_file = folder.path.join(relative).join(&pose_name);
    let pose = options.pose(|| read_pose(folder, relative, listing, &pose_name));
    let pose = pose.map_err(|problem| (pose_file, problem))?;
    let checked = |name: &str| folder.file(relative, listing, name);
    let color = checked(color).map_err(|p| (folder.path.join(relative).join(color), p))?;
    let depth_name = format!("{stem}{DEPTH_SUFFIX}");
    let depth = match listing.has_file(&depth_name) {
        true => checked(&depth_name),
        false => Err(FrameProblem::MissingDepth(depth_name)),
    };
    let (color, depth) = (color.into(), depth.map(Into::into));
    Ok(ListedFrame { name: frame_name(relative, stem), pose, color, depth })
}

/// Returns the frame's name with its folder, because every sequence numbers its frames from 0.
fn frame_name(relative: &Path, stem: &str) -> String {
    relative.join(stem).display().to_string()
}

fn read_pose(
    folder: &Folder,
    relative: &Path,
    listing: &FolderListing,
    name: &str,
) -> Result<Pose, FrameProblem> {
    // A missing pose and an unreadable one have different remedies.
    if !listing.has_file(name) {
        return Err(FrameProblem::MissingPose(name.to_owned()));
    }
    let text = read_small_text(&folder.file(relative, listing, name)?)?;
    Ok(Pose::from_opencv(matrix::from_text(&text)?)?)
}

/// How files of a folder are read: cameras, and length of a step of depth, metres.
type ReadAs = (Cameras, f64);

/// Returns the cameras of the frames in each of `folders`: those stated there or in the root, else the
/// published ones.
fn cameras_by_folder(
    recording: &mut Recording,
    folders: BTreeSet<String>,
    sizes: ((u32, u32), (u32, u32)),
) -> Result<BTreeMap<PathBuf, ReadAs>, DatasetError> {
    let mut found = BTreeMap::new();
    let mut of_root = None;
    for folder in folders {
        let own = match folder.is_empty() {
            true => None,
            false => stated_cameras(recording, &folder, sizes)?,
        };
        let cameras = match (own, of_root) {
            (Some(cameras), _) | (None, Some(cameras)) => cameras,
            (None, None) => {
                let root = stated_cameras(recording, "", sizes)?;
                let root = root.map_or_else(|| published_cameras(recording, sizes), Ok)?;
                *of_root.insert(root)
            }
        };
        found.insert(folder.into(), cameras);
    }
    Ok(found)
}

/// Returns the cameras that a text in the folder `relative` states.
fn stated_cameras(
    recording: &mut Recording,
    relative: &str,
    (color, depth): ((u32, u32), (u32, u32)),
) -> Result<Option<ReadAs>, DatasetError> {
    let folder = recording.folder;
    let info = SensorInfo::find(folder, relative)?;
    let stated_unit = info.as_ref().map(SensorInfo::depth_unit).transpose()?.flatten();
    let unit = stated_unit.unwrap_or(MILLIMETRE);
    if let Some(info) = &info {
        stated::name_keys(&mut recording.parsed, &info.file, &info.unused_keys());
    }
    if let Some((file, k)) = stated::in_text_file(folder, relative, color)? {
        if let Some(info) = info {
            let statement = format!("its cameras are not used, as {} states one", file.display());
            recording.unused(&info.file, statement);
        }
        let cameras = recording.cameras_of_lens(&k, color, depth, &file)?;
        return Ok(Some((cameras, unit)));
    }
    let Some(info) = info else { return Ok(None) };
    let file = &info.file;
    let stated = (info.intrinsics("color", color)?, info.intrinsics("depth", depth)?);
    let mut cameras = match stated {
        (Some(of_color), Some(of_depth)) => {
            recording.cameras_of_lenses((file, &of_color), (file, &of_depth), color, depth)?
        }
        (Some(one), None) | (None, Some(one)) => {
            recording.cameras_of_lens(&one, color, depth, file)?
        }
        (None, None) => return Ok(None),
    };
    // Stated as one camera: the known second one must not replace it.
    let one = ColorCamera::from_depth_intrinsics(&cameras.depth, [color.0, color.1]);
    cameras.color = cameras.color.or(Some(one));
    if info.has_offset() {
        let statement = "the transform between colour and depth camera is not used: photographs are \
                         taken as from the depth camera's place; give a --calibration";
        recording.unused(file, statement);
    }
    Ok(Some((cameras, unit)))
}

/// Returns the cameras for a recording whose files state none.
fn published_cameras(
    recording: &mut Recording,
    (color, depth): ((u32, u32), (u32, u32)),
) -> Result<ReadAs, DatasetError> {
    let file = recording.folder.path.join(INTRINSICS_FILE);
    let expected = "9 numbers: fx 0 cx, 0 fy cy, 0 0 1";
    let (file, k) = PUBLISHED.assume(recording, color, (file, expected))?;
    Ok((recording.cameras_of_lens(&k, color, depth, &file)?, MILLIMETRE))
}
