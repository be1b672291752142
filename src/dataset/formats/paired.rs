//! Photographs in `color/` (`image/`, `rgb/`) and depth in `depth/`, paired by number. Depth is in
//! millimetres. Shared by the Open3D layout, whose poses are in a log, and by folders of images whose
//! poses are in a list of any form, in the folder or one below, or missing.

use super::numbered::{Correspondence, DEPTH_FILES, NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, codes_by_content, encoding, frame_entry,
    metadata_error, no_poses, same_size,
};
use super::stated::PRIMESENSE;
use super::trajectory::{PoseList, are_counts, log_blocks, log_head, pose_lists, time_unit};
use super::{stated, tum};
use crate::dataset::decode::DepthEncoding;
use crate::dataset::entry::{DepthSource, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{ByteSource, LoadOptions};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::pose::Pose;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

const COLOR_FOLDERS: [&str; 3] = ["color", "image", "rgb"];
const DEPTH_FOLDER: &str = "depth";

fn recognise(folder: &Folder) -> Option<String> {
    let color = color_folder(folder)?;
    folder.has_folder(DEPTH_FOLDER).then(|| format!("images in {color}/ and {DEPTH_FOLDER}/"))
}

fn color_folder(folder: &Folder) -> Option<&'static str> {
    COLOR_FOLDERS.into_iter().find(|name| folder.has_folder(name))
}

type PairedImages = (BTreeMap<u64, Pair>, Cameras, DepthEncoding);

fn read(recording: &mut Recording) -> Result<Option<PairedImages>, DatasetError> {
    let folder = recording.folder;
    // The default is used only if the folder was removed since recognition; listing it then fails.
    let color_name = color_folder(folder).unwrap_or("color");
    let colors = recording.list(color_name, "", &PHOTOGRAPHS)?;
    let depths = recording.list(DEPTH_FOLDER, "", &DEPTH_FILES)?;
    let pairs = pairs(recording, &colors, &depths, color_name)?;
    let cameras = cameras(recording, &pairs)?;
    let depths: Vec<_> = pairs.values().filter_map(|pair| pair.depth.as_ref().ok()).collect();
    let codes = codes_by_content(&depths);
    let encoding = encoding(recording.options, codes, Sensor::Kinect, STRUCTURED_LIGHT_RANGE);
    Ok(cameras.map(|cameras| (pairs, cameras, encoding)))
}

struct Pair {
    name: String,
    color: Option<ByteSource>,
    // As text: problems hold I/O errors, which cannot be cloned.
    depth: Result<ByteSource, String>,
}

impl Pair {
    fn depth(&self) -> Result<ByteSource, FrameProblem> {
        self.depth.clone().map_err(FrameProblem::MissingDepth)
    }
}

/// Pairs photographs and depth images by number if most numbers agree, else by their order.
fn pairs(
    recording: &mut Recording,
    colors: &NumberedFiles,
    depths: &NumberedFiles,
    color_name: &str,
) -> Result<BTreeMap<u64, Pair>, DatasetError> {
    let folder = recording.folder;
    let [of_color, of_depth]: [Vec<u64>; 2] = [colors, depths].map(|l| l.numbers().collect());
    let correspondence = match folder.is_growing() {
        // Equal counts are a coincidence then.
        true => Some(Correspondence::Numbers(0)),
        false => Correspondence::of(&of_color, &of_depth),
    };
    let Some(correspondence) = correspondence else {
        let found = format!("{} for {} in {color_name}/", of_depth.len(), of_color.len());
        let expected = "depth images with the numbers of the photographs, or as many";
        let hint = "name both by the same numbers, or restore the missing files";
        return Err(metadata_error(&folder.path.join(DEPTH_FOLDER), expected, found, hint));
    };
    match correspondence {
        Correspondence::Numbers(0) => {}
        Correspondence::Numbers(shift) => recording.note(format!(
            "colour and depth are numbered differently: depth {shift:+} belongs to each photograph"
        )),
        Correspondence::Order => {
            recording.note("colour and depth are numbered differently: paired by their order");
        }
    }
    let depth_of: BTreeMap<u64, u64> = correspondence
        .pairs(&of_color, &of_depth)
        .into_iter()
        .map(|(number, depth)| (number.unwrap_or(depth), depth))
        .collect();
    let mut found = BTreeMap::new();
    for number in of_color.into_iter().chain(depth_of.keys().copied()).collect::<BTreeSet<_>>() {
        let name = colors.stem(number).map_or_else(|| number.to_string(), str::to_owned);
        let color = match colors.file(folder, number).transpose() {
            Ok(color) => color.map(Into::into),
            Err(problem) => {
                recording.skip(&name, folder.path.join(color_name), problem);
                continue;
            }
        };
        let depth = depth_of.get(&number).and_then(|number| depths.file(folder, *number));
        let depth = match depth {
            Some(Ok(depth)) => Ok(ByteSource::File(depth)),
            Some(Err(problem)) => Err(problem.to_string()),
            None => Err(format!("{DEPTH_FOLDER}/{name}.png")),
        };
        found.insert(number, Pair { name, color, depth });
    }
    Ok(found)
}

fn cameras(
    recording: &mut Recording,
    pairs: &BTreeMap<u64, Pair>,
) -> Result<Option<Cameras>, DatasetError> {
    let colors = pairs.values().filter_map(|pair| pair.color.as_ref());
    let depths = pairs.values().filter_map(|pair| pair.depth.as_ref().ok());
    let Some((size, depth_size)) = recording.sizes(colors, depths) else { return Ok(None) };
    let (file, k) = match stated::in_any_file(recording, size)? {
        Some(stated) => stated,
        None => {
            let expected = "`width`, `height` and the camera's `intrinsic_matrix`";
            let file = recording.folder.path.join("camera.json");
            PRIMESENSE.assume(recording, size, (file, expected))?
        }
    };
    // The file may state the camera of depth or that of the photographs.
    if (k.width, k.height) != depth_size {
        same_size((k.width, k.height), size, &file)?;
    }
    recording.cameras_of_lens(&k, size, depth_size, &file).map(Some)
}

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opencv, recognise, parse };

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    if let Some(lists) = color_folder(folder).and_then(|color| tum::timed_names(folder, color)) {
        return tum::parse_lists(folder, options, &lists);
    }
    let mut recording = Recording::new(folder, options);
    let Some(images) = read(&mut recording)? else { return Ok(recording.finish()) };
    match options.track {
        true => unposed(&mut recording, &images),
        false => {
            let (name, list) = pose_list(&mut recording, &images.0)?;
            posed(&mut recording, &images, &folder.path.join(name), list)?;
        }
    }
    Ok(recording.finish())
}

fn unposed(recording: &mut Recording, (pairs, cameras, encoding): &PairedImages) {
    let folder = recording.folder;
    for (number, pair) in pairs.iter().filter(|(_, pair)| !folder.was_taken(&pair.name)) {
        let missing = || FrameProblem::MissingColor(format!("number {number}"));
        let frame = pair.color.clone().ok_or_else(missing).and_then(|color| {
            let depth = Some(DepthSource::new(pair.depth()?, *encoding));
            Ok(frame_entry(pair.name.clone(), Pose::IDENTITY, *cameras, color, depth))
        });
        // While the recording grows, the other file of the pair may still be written.
        if frame.is_ok() || !folder.is_growing() {
            recording.add(&pair.name, &folder.path, frame);
        }
    }
}

/// Finds the list of poses that fits the images, and its path.
fn pose_list(
    recording: &mut Recording,
    pairs: &BTreeMap<u64, Pair>,
) -> Result<(String, PoseList), DatasetError> {
    let folder = recording.folder;
    let numbers: Vec<u64> = pairs.keys().copied().collect();
    let lists = pose_lists(folder);
    let fits = |list: &PoseList| list.correspondence(&numbers).is_some();
    let (mut fitting, others): (Vec<_>, Vec<_>) = lists.into_iter().partition(|(_, l)| fits(l));
    if fitting.is_empty() {
        let expected =
            format!("a pose for each of {} images, or numbers that name them", numbers.len());
        return Err(match others.first() {
            None => no_poses(&folder.path, "poses of the frames", "images only"),
            Some((name, list)) => {
                let found = format!("{} poses ({})", list.poses.len(), list.form);
                no_poses(&folder.path.join(name), &expected, &found)
            }
        });
    }
    let (name, list) = fitting.swap_remove(0);
    let paired = match list.correspondence(&numbers) {
        Some(Correspondence::Order) => "paired with the images by their order",
        _ => "paired with the images by number",
    };
    recording.note(format!("poses are those of {name} ({}), {paired}", list.form));
    stated::name_keys(&mut recording.parsed, &folder.path.join(&name), &list.unused);
    let unused = fitting.into_iter().chain(others).map(|(name, _)| name);
    recording.name_unused_files("lists of poses", unused);
    Ok((name, list))
}

pub(super) const OPEN3D: DatasetFormat = DatasetFormat {
    poses: PoseConvention::Opencv,
    recognise: recognise_open3d,
    parse: parse_open3d,
};

fn recognise_open3d(folder: &Folder) -> Option<String> {
    let images = recognise(folder)?;
    trajectory_logs(folder).first().map(|log| format!("{log}, with {images}"))
}

/// Finds the log files whose first block is a pose, in the folder or in the first one below that has any. The
/// first log is the one to use.
fn trajectory_logs(folder: &Folder) -> Vec<String> {
    let is_trajectory = |name: &String| {
        let text = folder.peek(name);
        let mut lines = text.lines();
        let head = lines.next().and_then(log_head);
        let row = lines.next().map(matrix::parse_numbers::<4>);
        // Heads of Open3D's trajectories repeat the index.
        matches!(head, Some([a, b, _]) if a == b) && matches!(row, Some(Ok(_)))
    };
    let below = folder.subfolders().into_iter().filter_map(|sub| {
        let listing = folder.list(Path::new(&sub)).ok()?;
        Some(listing.files().map(|name| format!("{sub}/{name}")).collect::<Vec<_>>())
    });
    let here: Vec<String> = folder.listing.files().map(str::to_owned).collect();
    // Odometry may be logged as a trajectory too, with another origin: a log named after one is preferred.
    let logs = std::iter::once(here).chain(below).map(|mut logs| {
        logs.retain(|name| name.ends_with(".log") && is_trajectory(name));
        logs.sort_by_key(|name| !name.contains("traj"));
        logs
    });
    logs.into_iter().find(|logs| !logs.is_empty()).unwrap_or_default()
}

fn parse_open3d(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let Some(images) = read(&mut recording)? else { return Ok(recording.finish()) };
    if options.track {
        unposed(&mut recording, &images);
        return Ok(recording.finish());
    }
    let mut logs = trajectory_logs(folder).into_iter();
    let (file, text) = folder.lines(&logs.next().unwrap_or("trajectory.log".to_owned()))?;
    recording.name_unused_files("lists of poses", logs);
    let list = PoseList::new("Open3D's log", log_blocks(&text));
    posed(&mut recording, &images, &file, list)?;
    Ok(recording.finish())
}

/// Adds the frames of the images that have a pose in the list.
fn posed(
    recording: &mut Recording,
    (pairs, cameras, encoding): &PairedImages,
    file: &Path,
    list: PoseList,
) -> Result<(), DatasetError> {
    let folder = recording.folder;
    let numbers: Vec<u64> = pairs.keys().copied().collect();
    let shown = file.strip_prefix(&folder.path).unwrap_or(file).display().to_string();
    let correspondence = list.correspondence(&numbers);
    let times: Vec<f64> = list.poses.iter().filter_map(|pose| pose.time).collect();
    // Numbers in place of times are no times.
    let unit = (!are_counts(&times)).then(|| time_unit(&times));
    let (mut poses, mut is_sorted) = (BTreeMap::new(), true);
    for (key, listed) in list.keys().into_iter().zip(list.poses) {
        match key {
            None => {
                let expected = "a frame's number with each pose";
                let missing = || FrameProblem::Entry { expected, found: "none".to_owned() };
                let problem = listed.matrix.err().unwrap_or_else(missing);
                recording.skip(&format!("line {}", listed.line), file.to_owned(), problem);
            }
            Some(key) if poses.contains_key(&key) => {
                let problem = FrameProblem::Duplicate(format!("another block {key}"));
                recording.skip(&key.to_string(), file.to_owned(), problem);
            }
            Some(key) => {
                is_sorted &= poses.last_key_value().is_none_or(|(last, _)| *last < key);
                poses.insert(key, listed);
            }
        }
    }
    if !is_sorted {
        recording.note(format!("{shown}: blocks out of order; sorted"));
    }
    let keys: Vec<u64> = poses.keys().copied().collect();
    // Images of a growing recording may not be written yet: number and place must agree.
    let counted = |(place, key): (usize, &u64)| {
        let number = numbers.first().and_then(|first| first.checked_add(*key));
        (number.filter(|_| number == numbers.get(place).copied()), *key)
    };
    let placed = match (folder.is_growing(), correspondence) {
        (true, _) => keys.iter().enumerate().map(counted).collect(),
        (false, Some(correspondence)) => correspondence.pairs(&numbers, &keys),
        (false, None) => {
            let (n_images, n_poses) = (numbers.len(), keys.len());
            let expected =
                format!("a pose for each of {n_images} images, or numbers that name them");
            return Err(no_poses(file, &expected, &format!("{n_poses} poses with other numbers")));
        }
    };
    let mut n_posed = 0;
    for (number, key) in placed {
        let pair = number.and_then(|number| pairs.get(&number));
        if pair.is_some_and(|pair| folder.was_taken(&pair.name)) {
            continue;
        }
        let Some((pair, color)) = pair.and_then(|pair| Some((pair, pair.color.clone()?))) else {
            let problem = FrameProblem::MissingColor(format!("number {key}"));
            recording.skip(&key.to_string(), file.to_owned(), problem);
            continue;
        };
        n_posed += 1;
        let Some(listed) = poses.remove(&key) else { continue };
        let frame = listed.matrix.and_then(|matrix| {
            let depth = Some(DepthSource::new(pair.depth()?, *encoding));
            let pose = Pose::from_opencv(matrix)?;
            let frame = frame_entry(pair.name.clone(), pose, *cameras, color, depth);
            let time = listed.time.zip(unit).map(|(time, unit)| time * unit);
            Ok(FrameEntry { time, ..frame })
        });
        recording.add(&pair.name, file, frame);
    }
    let n_photographs = pairs.values().filter(|pair| pair.color.is_some()).count();
    if n_posed < n_photographs && !folder.is_growing() {
        let n = n_photographs - n_posed;
        recording.note(format!(
            "{n} of {n_photographs} photographs have no pose in {shown} and are left out"
        ));
    }
    Ok(())
}
