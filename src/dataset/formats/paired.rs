//! Photographs in `color/` (`image/`, `rgb/`) and depth in `depth/`, paired by number. Shared by the Open3D
//! layout and by recordings without poses. Depth is in millimetres.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{
    Cameras, Recording, STRUCTURED_LIGHT_RANGE, encoding, frame_entry, metadata_error, same_size,
};
use super::stated;
use super::stated::PRIMESENSE;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix;
use crate::dataset::options::{ByteSource, LoadOptions, MILLIMETRE};
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::surface::sensor::Sensor;
use crate::math::pose::Pose;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

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
    let depths = recording.list(DEPTH_FOLDER, "", &["png"])?;
    let pairs = pairs(recording, &colors, &depths, color_name);
    let cameras = cameras(recording, &pairs)?;
    let unit = CodeKind::Linear16(MILLIMETRE);
    let encoding = encoding(recording.options, unit, Sensor::Kinect, STRUCTURED_LIGHT_RANGE);
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

/// Pairs photographs and depth images by number, or by order if their counts are equal and their numbers
/// differ.
fn pairs(
    recording: &mut Recording,
    colors: &NumberedFiles,
    depths: &NumberedFiles,
    color_name: &str,
) -> BTreeMap<u64, Pair> {
    let folder = recording.folder;
    let same = colors.numbers().eq(depths.numbers());
    // While the recording grows, equal counts are a coincidence.
    let by_order = !same && colors.len() == depths.len() && !folder.is_growing();
    if by_order {
        recording.note("colour and depth are numbered differently: paired by their order");
    }
    let mut depth_numbers = depths.numbers();
    let numbers = match by_order {
        true => colors.numbers().collect(),
        false => NumberedFiles::union(&[colors, depths]),
    };
    let mut found = BTreeMap::new();
    for number in numbers {
        let depth_number = if by_order { depth_numbers.next().unwrap_or(number) } else { number };
        let name = colors.stem(number).map_or_else(|| number.to_string(), str::to_owned);
        let color = match colors.file(folder, number).transpose() {
            Ok(color) => color.map(Into::into),
            Err(problem) => {
                recording.skip(&name, folder.path.join(color_name), problem);
                continue;
            }
        };
        let depth = match depths.file(folder, depth_number) {
            Some(Ok(depth)) => Ok(ByteSource::File(depth)),
            Some(Err(problem)) => Err(problem.to_string()),
            None => Err(format!("{DEPTH_FOLDER}/{name}.png")),
        };
        found.insert(number, Pair { name, color, depth });
    }
    found
}

fn cameras(
    recording: &mut Recording,
    pairs: &BTreeMap<u64, Pair>,
) -> Result<Option<Cameras>, DatasetError> {
    let colors = pairs.values().filter_map(|pair| pair.color.as_ref());
    let depths = pairs.values().filter_map(|pair| pair.depth.as_ref().ok());
    let Some((size, depth_size)) = recording.sizes(colors, depths) else { return Ok(None) };
    let folder = recording.folder;
    let (file, k) =
        match (stated::in_json_file(recording)?, stated::in_text_file(folder, "", size)?) {
            (Some(stated), _) | (None, Some(stated)) => stated,
            (None, None) => {
                let expected = "`width`, `height` and the camera's `intrinsic_matrix`";
                let file = folder.path.join("camera.json");
                PRIMESENSE.assume(recording, size, (file, expected))?
            }
        };
    // The file may state the camera of depth or that of the photographs.
    if (k.width, k.height) != depth_size {
        same_size((k.width, k.height), size, &file)?;
    }
    recording.cameras_of_lens(&k, size, depth_size, &file).map(Some)
}

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "photographs and depth without poses: `color/` and `depth/`",
    poses: PoseConvention::Opencv,
    recognise: |folder| recognise(folder).map(|images| format!("{images}, without poses")),
    parse,
};

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    if !options.track {
        let found = "images only".to_owned();
        let hint = "estimate the poses with --poses track, or add the poses";
        return Err(metadata_error(&folder.path, "poses of the frames", found, hint));
    }
    let mut recording = Recording::new(folder, options);
    let Some((pairs, cameras, encoding)) = read(&mut recording)? else {
        return Ok(recording.finish());
    };
    for (number, pair) in &pairs {
        if folder.was_taken(&pair.name) {
            continue;
        }
        let missing = || FrameProblem::MissingColor(format!("number {number}"));
        let frame = pair.color.clone().ok_or_else(missing).and_then(|color| {
            let depth = Some(DepthSource::new(pair.depth()?, encoding));
            Ok(frame_entry(pair.name.clone(), Pose::IDENTITY, cameras, color, depth))
        });
        // While the recording grows, the other file of the pair may still be written.
        if frame.is_ok() || !folder.is_growing() {
            recording.add(&pair.name, &folder.path, frame);
        }
    }
    Ok(recording.finish())
}

pub(super) const OPEN3D: DatasetFormat = DatasetFormat {
    identified_by: "Open3D: `color/`, `depth/` and a trajectory `*.log`",
    poses: PoseConvention::Opencv,
    recognise: recognise_open3d,
    parse: parse_open3d,
};

fn recognise_open3d(folder: &Folder) -> Option<String> {
    let images = recognise(folder)?;
    trajectory_log(folder).map(|log| format!("{log}, with {images}"))
}

/// Finds a log file whose first block is a pose.
fn trajectory_log(folder: &Folder) -> Option<&str> {
    let is_trajectory = |name: &&str| {
        let text = folder.peek(name);
        let mut lines = text.lines();
        let head = lines.next().and_then(head);
        let row = lines.next().map(matrix::parse_numbers::<4>);
        // Heads of Open3D's trajectories repeat the index.
        matches!(head, Some([a, b, _]) if a == b) && matches!(row, Some(Ok(_)))
    };
    let logs = || folder.listing.files().filter(|name| name.ends_with(".log"));
    // Odometry may be logged as a trajectory too, with another origin: a log named after one is preferred.
    let named = logs().filter(|name| name.contains("traj")).find(is_trajectory);
    named.or_else(|| logs().find(is_trajectory))
}

fn head(line: &str) -> Option<[u64; 3]> {
    let mut numbers = line.split_whitespace().map(|t| t.parse().ok());
    let head = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(head)
}

fn parse_open3d(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let Some((pairs, cameras, encoding)) = read(&mut recording)? else {
        return Ok(recording.finish());
    };
    let (log, blocks) = blocks(&mut recording)?;
    let numbers: Vec<u64> = pairs.keys().copied().collect();
    let is_complete = numbers.len() == blocks.len();
    for (index, pose) in blocks {
        // Blocks count images. If images are missing, the numbers in their names decide.
        let in_place = usize::try_from(index).ok().and_then(|i| numbers.get(i).copied());
        let counted = numbers.first().and_then(|first| first.checked_add(index));
        let number = match folder.is_growing() {
            // Images may not be written yet: both counts must agree.
            true => counted.filter(|_| counted == in_place),
            false if is_complete => in_place,
            false => counted,
        };
        let pair = number.and_then(|number| pairs.get(&number));
        if pair.is_some_and(|pair| folder.was_taken(&pair.name)) {
            continue;
        }
        let Some((pair, color)) = pair.and_then(|pair| Some((pair, pair.color.clone()?))) else {
            let problem = FrameProblem::MissingColor(format!("number {index}"));
            recording.skip(&index.to_string(), log.clone(), problem);
            continue;
        };
        let frame = pose.and_then(|pose| {
            let depth = Some(DepthSource::new(pair.depth()?, encoding));
            Ok(frame_entry(pair.name.clone(), pose, cameras, color, depth))
        });
        recording.add(&pair.name, &log, frame);
    }
    Ok(recording.finish())
}

type Block = (u64, Result<Pose, FrameProblem>);

fn blocks(recording: &mut Recording) -> Result<(PathBuf, Vec<Block>), DatasetError> {
    let name = trajectory_log(recording.folder).unwrap_or("trajectory.log").to_owned();
    let (file, text) = recording.folder.lines(&name)?;
    let mut found: Vec<Block> = Vec::new();
    let mut seen = BTreeSet::new();
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    while let Some((i, line)) = lines.next() {
        let Some([index, ..]) = head(line) else {
            let expected = "three whole numbers before each matrix of four rows";
            recording.skip_line(&file, i + 1, expected, line);
            // Skip to the next line that can begin a block.
            continue;
        };
        let rows: Vec<&str> = lines.by_ref().take(4).map(|(_, row)| row).collect();
        let pose = matrix::from_text(&rows.join("\n")).and_then(|m| Ok(Pose::from_opencv(m)?));
        match seen.insert(index) {
            true => found.push((index, pose)),
            false => {
                let problem = FrameProblem::Duplicate(format!("another block {index}"));
                recording.skip(&index.to_string(), file.clone(), problem);
            }
        }
    }
    if !found.is_sorted_by_key(|(index, _)| *index) {
        recording.note(format!("{name}: blocks out of order; sorted"));
        found.sort_by_key(|(index, _)| *index);
    }
    Ok((file, found))
}
