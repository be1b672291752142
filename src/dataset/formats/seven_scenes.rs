//! 7-Scenes: `STEM.color.{png,jpg}`, `STEM.depth.png` (16-bit, millimetres along the optical axis, 0 and
//! 65535 are holes) and `STEM.pose.txt` (camera-to-world, OpenCV axes).
//!
//! Frames are in sequence folders listed by `TrainSplit.txt` and `TestSplit.txt`, or in one folder per
//! split, or in the root. Intrinsics come from `camera-intrinsics.txt` (3×3) or are the dataset's published
//! default.
//!
//! The published recordings are not registered: a separate camera took the colour images. The files do not
//! state this, hence the notice at opening. The known calibration applies only if the depth intrinsics are
//! the published ones.

use super::numbered::{ListedFrame, ListedSplit};
use super::recording::{
    STRUCTURED_LIGHT_RANGE, check_intrinsics, encoding, metadata_error, photograph_size,
};
use super::stated::{KnownCamera, from_matrix};
use crate::dataset::calibrated_size::from_user;
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
use std::path::{Path, PathBuf};

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "7-Scenes: `*.color.*`, `*.depth.png` and `*.pose.txt` files in the folder or one below",
    poses: PoseConvention::Opencv,
    recognise,
    parse,
};

const POSE_SUFFIX: &str = ".pose.txt";
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
    let mut parsed = ParsedFolder::default();
    let mut splits = Vec::new();
    for (split, folders) in split_folders(folder, &mut parsed)? {
        let mut listed = ListedSplit { name: split, frames: Vec::new() };
        for frames_in in &folders {
            collect((folder, options), frames_in, &mut listed, &mut parsed);
        }
        splits.push(listed);
    }
    // One camera took all splits, so its size is that of most images of all splits.
    let Ok(Some(size)) = photograph_size(splits.iter().flat_map(ListedSplit::colors)) else {
        splits.into_iter().for_each(|listed| listed.skip_unreadable(&mut parsed));
        return Ok(parsed);
    };
    let intrinsics = match options.intrinsics {
        Some(numbers) => from_user(numbers, size)?,
        None => intrinsics(folder, size, &mut parsed.notes)?,
    };
    let unit = CodeKind::Linear16(MILLIMETRE);
    let encoding = encoding(options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE);
    for listed in splits {
        let split = listed.into_split(intrinsics, encoding, &mut parsed);
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

/// Returns the intrinsics of the depth camera, and adds their source to `notes`.
fn intrinsics(
    folder: &Folder,
    size: (u32, u32),
    notes: &mut Vec<String>,
) -> Result<Intrinsics, DatasetError> {
    let file = folder.path.join(INTRINSICS_FILE);
    let expected = "9 numbers: fx 0 cx, 0 fy cy, 0 0 1";
    // Added for every recording: the files do not show whether colours are registered.
    notes.push("colour images are not registered to depth (7-Scenes)".into());
    if !folder.listing.has_file(INTRINSICS_FILE) {
        notes.push(PUBLISHED.note(size, (&file, expected))?);
        return Ok(PUBLISHED.intrinsics);
    }
    let (_, text) = folder.text(INTRINSICS_FILE)?;
    let m = matrix::parse_numbers::<9>(&text)
        .map_err(|found| metadata_error(&file, expected, found, "export the intrinsics again"))?;
    let k = from_matrix(m, size).ok_or_else(|| {
        let hint = "undistort to a pinhole without skew";
        metadata_error(&file, expected, format!("{m:?}"), hint)
    })?;
    check_intrinsics(&k, &file)?;
    Ok(k)
}
