//! Open3D and Redwood: images in `color/` (`image/`, `rgb/`) and `depth/`, poses in a log; depth in
//! millimetres. Each block of the log has a line of three numbers and four rows of a camera-to-world matrix
//! (OpenCV axes).
//!
//! A block's first number counts images, not names: Redwood names images by number and time, and the times
//! of colour and depth differ. Odometry logs have the same form but contain the motion between two images
//! (`0 1`), not a pose (`0 0`).

use super::format::{DatasetFormat, ParsedFolder};
use super::paired;
use super::recording::{RecordedFrame, Recording};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::matrix;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_convention::PoseConvention;
use crate::math::pose::Pose;
use std::collections::BTreeSet;
use std::path::PathBuf;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "Open3D: `color/`, `depth/` and a trajectory `*.log`",
    poses: PoseConvention::Opencv,
    recognise,
    parse,
    known_calibration: |_| None,
};

fn recognise(folder: &Folder) -> Option<String> {
    let images = paired::recognise(folder)?;
    trajectory_log(folder).map(|log| format!("{log}, with {images}"))
}

/// Finds a log whose first block is a pose.
fn trajectory_log(folder: &Folder) -> Option<&str> {
    let is_trajectory = |name: &&str| {
        let text = folder.peek(name);
        let mut lines = text.lines();
        let head = lines.next().and_then(head);
        let row = lines.next().map(matrix::parse_numbers::<4>);
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

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let Some((pairs, cameras)) = paired::read(&mut recording)? else {
        return Ok(recording.finish());
    };
    let encoding = paired::encoding(&recording);
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
        if number.and_then(|n| pairs.get(&n)).is_some_and(|pair| folder.was_taken(&pair.name)) {
            continue;
        }
        let pair = number.and_then(|number| pairs.get(&number));
        let Some((pair, color)) = pair.and_then(|pair| Some((pair, pair.color.clone()?))) else {
            let problem = FrameProblem::MissingColor(format!("number {index}"));
            recording.skip(&index.to_string(), log.clone(), problem);
            continue;
        };
        let frame = pose.and_then(|pose| Ok((pose, pair.depth()?)));
        match frame {
            Ok((pose, depth)) => recording.push(RecordedFrame {
                name: pair.name.clone(),
                time: None,
                pose,
                cameras,
                color,
                depth: Some(DepthSource { file: depth, encoding, confidence: None }),
                lens: Distortion::default(),
            }),
            Err(problem) => recording.skip(&pair.name, log.clone(), problem),
        }
    }
    Ok(recording.finish())
}

type Block = (u64, Result<Pose, FrameProblem>);

/// Image number and pose of every block.
fn blocks(recording: &mut Recording) -> Result<(PathBuf, Vec<Block>), DatasetError> {
    let name = trajectory_log(recording.folder).unwrap_or("trajectory.log").to_owned();
    let (file, text) = recording.folder.lines(&name)?;
    let mut found: Vec<Block> = Vec::new();
    let mut seen = BTreeSet::new();
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    while let Some((i, line)) = lines.next() {
        let Some([index, ..]) = head(line) else {
            let expected = "three whole numbers before each matrix of four rows";
            let problem = FrameProblem::Line {
                expected,
                found: line.chars().take(40).collect(),
                line: i + 1,
            };
            recording.skip(&format!("line {}", i + 1), file.clone(), problem);
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
