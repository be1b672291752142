//! Trajectories: lists of poses in every known form, units of time, and interpolation between poses.
//!
//! | form | pose | identified by |
//! |---|---|---|
//! | TUM, ORB-SLAM | `t x y z qx qy qz qw`, optionally the image's number | time or number |
//! | KITTI | rows of a 3×4 or 4×4 matrix in one line | place |
//! | Open3D's log | a line of three whole numbers, then a 4×4 matrix | first of the numbers |
//! | blocks | 4×4 matrices, one row per line | place |
//! | CSV with a header | columns of position and quaternion by name | column of time or frame |
//! | JSON | an array or object of matrices, or of objects with a matrix | name, time or place |
//! | numbered files | one matrix each | number |

use super::arkit;
use super::numbered::{Correspondence, NumberedFiles};
use super::stated::{flat_numbers, is_stating, parse_json, unused_keys};
use crate::dataset::error::FrameProblem;
use crate::dataset::folder::{Folder, read_small_text};
use crate::dataset::matrix;
use crate::dataset::range::median;
use crate::math::pose::Pose;
use glam::{DMat3, DMat4, DQuat, DVec3};
use serde_json::Value;
use std::collections::BTreeSet;
use std::path::Path;

/// Maximum time between a frame and its pose or photograph, seconds. At 30 Hz, half a frame interval is
/// 17 ms.
pub(super) const TOLERANCE: f64 = 0.020;

#[derive(Clone, Copy, Debug)]
pub(super) struct TimedPose {
    pub time: f64,
    position: DVec3,
    turn: DQuat,
}

impl TimedPose {
    /// Creates a pose from `t tx ty tz qx qy qz qw`. Returns `None` unless all values are finite and the
    /// quaternion's length is near 1.
    pub fn new([time, x, y, z, qx, qy, qz, qw]: [f64; 8]) -> Option<Self> {
        let (position, turn) = (DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw));
        // Rounded text stays far closer to length 1; other numbers are not a quaternion.
        let is_turn = (0.5..2.0).contains(&turn.length());
        (time.is_finite() && position.is_finite() && is_turn).then(|| Self {
            time,
            position,
            turn: turn.normalize(),
        })
    }

    /// Creates a pose from a rigid matrix.
    pub fn from_matrix(time: f64, matrix: DMat4) -> Self {
        let turn = DQuat::from_mat3(&DMat3::from_mat4(matrix)).normalize();
        Self { time, position: matrix.w_axis.truncate(), turn }
    }

    pub fn matrix(&self) -> DMat4 {
        DMat4::from_rotation_translation(self.turn, self.position)
    }
}

/// Pose of a list, and what the list states about its frame.
pub(super) struct ListedPose {
    /// Line in the file or place in the list, from 1.
    pub line: usize,
    pub time: Option<f64>,
    pub number: Option<u64>,
    pub matrix: Result<DMat4, FrameProblem>,
}

impl ListedPose {
    /// Parses a pose in one line of TUM's, RTAB-Map's or KITTI's form. The count of numbers
    /// distinguishes the forms.
    pub fn from_line(line: usize, text: &str) -> Self {
        let timed = |numbers: [f64; 8], number| {
            let wrong = || FrameProblem::PoseShape("numbers without a unit quaternion".to_owned());
            let matrix = TimedPose::new(numbers).map(|pose| pose.matrix()).ok_or_else(wrong);
            Self { line, time: Some(numbers[0]), number, matrix }
        };
        if let Ok(numbers) = matrix::parse_numbers::<8>(text) {
            return timed(numbers, None);
        }
        if let Ok([t, x, y, z, qx, qy, qz, qw, number]) = matrix::parse_numbers::<9>(text) {
            return timed([t, x, y, z, qx, qy, qz, qw], whole(number));
        }
        let matrix = match matrix::parse_numbers::<16>(text) {
            Ok(_) => matrix::from_text(text),
            Err(_) => matrix::parse_numbers::<12>(text)
                .map(matrix::from_three_rows)
                .map_err(FrameProblem::PoseShape),
        };
        Self { line, time: None, number: None, matrix }
    }

    /// Returns the frame's number, which may also be stated as a whole time.
    fn key(&self) -> Option<u64> {
        self.number.or_else(|| whole(self.time?))
    }

    fn is_rigid(&self) -> bool {
        self.matrix.as_ref().is_ok_and(|matrix| Pose::from_opencv(*matrix).is_ok())
    }
}

fn whole(number: f64) -> Option<u64> {
    (number >= 0.0 && number.fract() == 0.0 && number < 1e15).then_some(number as u64)
}

/// First characters of JSON.
const JSON: [char; 2] = ['{', '['];

/// List of poses in one of the known forms.
pub(super) struct PoseList {
    /// Form, for messages.
    pub form: &'static str,
    pub poses: Vec<ListedPose>,
    /// Columns or keys that state a camera, a unit or a size, which no list of poses gives to frames.
    pub unused: BTreeSet<String>,
}

impl PoseList {
    pub fn new(form: &'static str, poses: Vec<ListedPose>) -> Self {
        Self { form, poses, unused: BTreeSet::new() }
    }

    /// Parses a text; `None` unless most entries are poses in one known form.
    pub fn parse(text: &str) -> Option<Self> {
        let mut unused = BTreeSet::new();
        let (form, poses) = if text.trim_start().starts_with(JSON) {
            ("JSON", poses_in_json(&parse_json(text).ok()?, &mut unused)?)
        } else if let Some(poses) = poses_in_table(text, &mut unused) {
            ("CSV with a header", poses)
        } else {
            let first = lines(text).next()?.1;
            match first.split([' ', '\t', ',']).filter(|token| !token.is_empty()).count() {
                3 => ("Open3D's log", log_blocks(text)),
                4 => ("4x4 blocks", matrix_blocks(text)),
                n @ (8 | 9 | 12 | 16) => {
                    let form = if n < 12 { "TUM" } else { "KITTI" };
                    let pose = |(line, text)| ListedPose::from_line(line, text);
                    (form, lines(text).map(pose).collect())
                }
                _ => return None,
            }
        };
        let n_rigid = poses.iter().filter(|pose| pose.is_rigid()).count();
        (n_rigid >= 2 && 2 * n_rigid >= poses.len()).then_some(Self { form, poses, unused })
    }

    /// Returns the number that identifies each pose's frame: the stated one or, in a list without
    /// numbers, its place. `None` for a pose without number in a list with numbers.
    pub fn keys(&self) -> Vec<Option<u64>> {
        let is_numbered = self.is_numbered();
        let key = |(place, pose): (u64, &ListedPose)| match is_numbered {
            true => pose.key(),
            false => Some(place),
        };
        (0..).zip(&self.poses).map(key).collect()
    }

    /// Finds how images with ascending numbers correspond to the poses; `None` if neither numbers nor
    /// counts agree.
    pub fn correspondence(&self, images: &[u64]) -> Option<Correspondence> {
        let keys: BTreeSet<u64> = self.keys().into_iter().flatten().collect();
        let keys: Vec<u64> = keys.into_iter().collect();
        match self.is_numbered() {
            true => Correspondence::of(images, &keys),
            false => (keys.len() == images.len()).then_some(Correspondence::Order),
        }
    }

    fn is_numbered(&self) -> bool {
        self.poses.iter().filter(|pose| pose.is_rigid()).all(|pose| pose.key().is_some())
    }
}

/// Splits Open3D's log into its blocks.
pub(super) fn log_blocks(text: &str) -> Vec<ListedPose> {
    let mut found = Vec::new();
    let mut rest = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    while let Some((i, content)) = rest.next() {
        let (number, matrix) = match log_head(content) {
            Some([index, ..]) => {
                let rows: Vec<&str> = rest.by_ref().take(4).map(|(_, row)| row).collect();
                (Some(index), matrix::from_text(&rows.join("\n")))
            }
            // The next line may begin a block.
            None => {
                let expected = "three whole numbers before each matrix of four rows";
                let found = content.chars().take(60).collect();
                (None, Err(FrameProblem::Line { expected, found, line: i + 1 }))
            }
        };
        found.push(ListedPose { line: i + 1, time: None, number, matrix });
    }
    found
}

pub(super) fn log_head(line: &str) -> Option<[u64; 3]> {
    let mut numbers = line.split_whitespace().map(|t| t.parse().ok());
    let head = [numbers.next()??, numbers.next()??, numbers.next()??];
    numbers.next().is_none().then_some(head)
}

fn matrix_blocks(text: &str) -> Vec<ListedPose> {
    let rows: Vec<(usize, &str)> = lines(text).collect();
    let block = |rows: &[(usize, &str)]| {
        let text: Vec<&str> = rows.iter().map(|(_, row)| *row).collect();
        let line = rows.first().map_or(0, |(line, _)| *line);
        ListedPose { line, time: None, number: None, matrix: matrix::from_text(&text.join("\n")) }
    };
    rows.chunks(4).map(block).collect()
}

/// Parses a table whose first line names its columns.
fn poses_in_table(text: &str, unused: &mut BTreeSet<String>) -> Option<Vec<ListedPose>> {
    let mut rows = text.lines().enumerate().filter(|(_, row)| !row.trim().is_empty());
    let (_, head) = rows.next()?;
    let rows = rows.filter(|(_, row)| !row.starts_with('#'));
    let separator = [',', ';', '\t'].into_iter().find(|c| head.contains(*c)).unwrap_or(' ');
    let cells = |row: &str| -> Vec<String> {
        let cells = row.split(separator).map(|cell| cell.trim().to_lowercase());
        cells.filter(|cell| separator != ' ' || !cell.is_empty()).collect()
    };
    // Units follow in brackets; a comment sign may come first.
    let plain = |name: &String| {
        let name = name.split(['[', '(']).next().unwrap_or_default();
        name.trim_matches(|c: char| !c.is_alphanumeric()).to_owned()
    };
    let names: Vec<String> = cells(head.trim_start_matches(['#', ' '])).iter().map(plain).collect();
    let is_turn =
        |name: &str| name.starts_with('q') || name.contains("rot") || name.contains("quat");
    let is_time = |name: &str| name == "t" || name.contains("time") || name.contains("stamp");
    let is_place = |name: &str| name.len() == 1 || name.starts_with(['t', 'p']);
    let column = |is_it: &dyn Fn(&str) -> bool| names.iter().position(|name| is_it(name));
    let place = |axis| column(&|name| name.ends_with(axis) && !is_turn(name) && is_place(name));
    let turn = |axis| column(&|name| name.ends_with(axis) && is_turn(name));
    let columns =
        [place('x')?, place('y')?, place('z')?, turn('x')?, turn('y')?, turn('z')?, turn('w')?];
    let (at_time, at_frame) = (column(&is_time), column(&is_name));
    let others = names.iter().enumerate().filter(|(at, name)| {
        is_stating(name) && !columns.contains(at) && ![at_time, at_frame].contains(&Some(*at))
    });
    unused.extend(others.map(|(_, name)| matrix::shorten(name)));
    let pose = |(i, row): (usize, &str)| {
        let cells = cells(row);
        let cell = |at: Option<usize>| cells.get(at?);
        let number =
            |at: usize| cell(Some(at)).and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN);
        let [x, y, z, qx, qy, qz, qw] = columns.map(number);
        let expected = "finite numbers for position and unit quaternion";
        let found = row.chars().take(60).collect();
        let wrong = || FrameProblem::Line { expected, found, line: i + 1 };
        let pose = TimedPose::new([0.0, x, y, z, qx, qy, qz, qw]);
        let time = cell(at_time).and_then(|cell| cell.parse().ok()).filter(|t: &f64| t.is_finite());
        let number = cell(at_frame).and_then(|cell| number_in_name(cell));
        let matrix = pose.map(|pose| pose.matrix()).ok_or_else(wrong);
        ListedPose { line: i + 1, time, number, matrix }
    };
    Some(rows.map(pose).collect())
}

/// True for names of columns and keys that state an image's number or file.
fn is_name(name: &str) -> bool {
    name == "id"
        || ["frame", "image", "index", "file", "name"].iter().any(|part| name.contains(part))
}

/// Returns the last number in a file name, such as 12 in `rgb/frame_000012.png`.
pub(super) fn number_in_name(name: &str) -> Option<u64> {
    let file = name.rsplit(['/', '\\']).next()?;
    let stem = file.rsplit_once('.').map_or(file, |(stem, _)| stem);
    stem.split(|c: char| !c.is_ascii_digit()).rfind(|digits| !digits.is_empty())?.parse().ok()
}

/// Finds the poses in JSON: at its root or below one of its keys.
fn poses_in_json(json: &Value, unused: &mut BTreeSet<String>) -> Option<Vec<ListedPose>> {
    let below = json.as_object().into_iter().flat_map(|object| object.values());
    std::iter::once(json).chain(below).find_map(|list| {
        let items: Vec<(Option<&str>, &Value)> = match list {
            Value::Array(items) => items.iter().map(|item| (None, item)).collect(),
            Value::Object(items) => items.iter().map(|(k, v)| (Some(k.as_str()), v)).collect(),
            _ => return None,
        };
        let poses: Vec<ListedPose> = items
            .iter()
            .enumerate()
            .map(|(i, (key, item))| pose_in_json(i + 1, *key, item))
            .collect();
        let n_rigid = poses.iter().filter(|pose| pose.is_rigid()).count();
        let is_list = n_rigid >= 2 && 2 * n_rigid >= poses.len();
        if is_list {
            std::iter::once(json).chain(items.iter().map(|(_, item)| *item)).for_each(|object| {
                unused_keys(object, &[], unused);
            });
            // Times are used, and matrices of any name.
            let is_used =
                |key: &String| key.to_lowercase().contains("time") || key.contains("extrinsic");
            unused.retain(|key| !is_used(key));
        }
        is_list.then_some(poses)
    })
}

fn pose_in_json(line: usize, key: Option<&str>, item: &Value) -> ListedPose {
    let fields = item.as_object().into_iter().flatten();
    let bare = std::iter::once((String::new(), item));
    let matrix = bare
        .chain(fields.clone().map(|(key, value)| (key.to_lowercase(), value)))
        .find_map(|(key, value)| {
            let matrix = match flat_numbers(value)?.len() {
                12 => matrix::from_three_rows(flat_numbers(value)?.try_into().ok()?),
                16 => arkit::matrix(Some(value)).ok()?,
                _ => return None,
            };
            // Extrinsics are from world to camera.
            let is_inverse = ["extrinsic", "w2c", "world_to"].iter().any(|part| key.contains(part));
            let rigid = Pose::from_opencv(matrix).is_ok();
            rigid.then(|| if is_inverse { matrix.inverse() } else { matrix })
        });
    let named = fields.clone().filter(|(key, _)| is_name(&key.to_lowercase()));
    let number = named.into_iter().find_map(|(_, value)| match value {
        Value::String(name) => number_in_name(name),
        other => other.as_u64(),
    });
    let time = fields.clone().find(|(key, _)| key.to_lowercase().contains("time"));
    ListedPose {
        line,
        time: time.and_then(|(_, value)| value.as_f64()),
        number: number.or_else(|| number_in_name(key?)),
        matrix: matrix.ok_or_else(|| FrameProblem::PoseShape(matrix::describe_json(item))),
    }
}

/// Extensions of files that hold no poses.
const NO_TEXT: [&str; 21] = [
    "png", "jpg", "jpeg", "exr", "tif", "tiff", "npy", "npz", "pgm", "ppm", "bin", "depth", "conf",
    "mp4", "ply", "pcd", "obj", "md", "r3d", "zip", "mcap",
];
/// Largest number of texts of one folder that are searched for poses.
const MAX_TEXTS: usize = 64;

/// True unless the extension is that of an image or of another file without text.
pub(super) fn is_text(name: &str) -> bool {
    let extension = name.rsplit_once('.').map(|(_, end)| end.to_lowercase());
    extension.is_none_or(|end| !NO_TEXT.contains(&end.as_str()))
}

/// Reads all lists of poses in the folder and one level below, with their paths. Numbered texts of one
/// folder with a matrix each are one list.
pub(super) fn pose_lists(folder: &Folder) -> Vec<(String, PoseList)> {
    let mut found = Vec::new();
    for sub in std::iter::once(String::new()).chain(folder.subfolders()) {
        let Ok(listing) = folder.list(Path::new(&sub)) else { continue };
        if let Some(list) = numbered_matrices(folder, &sub) {
            found.push((sub, list));
            continue;
        }
        for name in listing.files().filter(|name| is_text(name)).take(MAX_TEXTS) {
            let path = if sub.is_empty() { name.to_owned() } else { format!("{sub}/{name}") };
            // A link to a folder is listed as a file.
            if folder.has_folder(&path) {
                continue;
            }
            // The start shows whether a text, which may be long, lists poses.
            let start = folder.peek(&path);
            let text = match start.trim_start().starts_with(JSON) {
                true => folder.peek_whole(&path),
                false if PoseList::parse(&start).is_some() => folder.peek_lines(&path),
                false => continue,
            };
            let list = PoseList::parse(&text);
            found.extend(list.map(|list| (path, list)));
        }
    }
    // The sort is stable: of lists with equally telling names, that of the outer folder comes first.
    let rank = |path: &str| {
        let path = path.to_lowercase();
        ["groundtruth", "gt", "traj", "pose"].iter().position(|part| path.contains(part))
    };
    found.sort_by_key(|(path, _)| rank(path).unwrap_or(usize::MAX));
    found
}

fn numbered_matrices(folder: &Folder, sub: &str) -> Option<PoseList> {
    let files = NumberedFiles::list(folder, sub, "", &["txt"]).ok()?;
    let pose = |(i, number): (usize, u64)| {
        let read = || {
            let missing = || FrameProblem::MissingPose(number.to_string());
            let file = files.file(folder, number).transpose()?.ok_or_else(missing)?;
            let text = read_small_text(&file)?;
            ListedPose::from_line(1, &text).matrix
        };
        ListedPose { line: i + 1, time: None, number: Some(number), matrix: read() }
    };
    let sound = files.numbers().take(MAX_TEXTS).enumerate().map(pose).filter(ListedPose::is_rigid);
    if sound.count() < 2 {
        return None;
    }
    Some(PoseList::new("numbered files", files.numbers().enumerate().map(pose).collect()))
}

/// Longest usual time between frames, seconds; frames of cameras are 8 ms to 8 s apart.
const LONGEST_STEP: f64 = 8.0;
/// Units of time that recorders use, seconds.
const UNITS: [f64; 4] = [1.0, 1e-3, 1e-6, 1e-9];

/// Returns the unit of the times of frames, seconds, from their spacing.
pub(super) fn time_unit(times: &[f64]) -> f64 {
    let step = usual_step(times).unwrap_or(0.0);
    // Frames far apart, in seconds since 1970.
    let is_epoch = times.iter().any(|time| *time > 1e9 && time.fract() != 0.0) && step < 1e3;
    let unit = UNITS.into_iter().find(|unit| is_epoch || step * unit < LONGEST_STEP);
    unit.unwrap_or(UNITS[3])
}

/// True if times are whole numbers that are no clock's ticks, but count frames.
pub(super) fn are_counts(times: &[f64]) -> bool {
    let is_second = time_unit(times) == 1.0 && usual_step(times).is_some();
    is_second && times.iter().all(|time| time.fract() == 0.0)
}

/// Returns the median time between frames; `None` for fewer than two different times.
pub(super) fn usual_step(times: &[f64]) -> Option<f64> {
    let mut sorted = times.to_vec();
    sorted.sort_by(f64::total_cmp);
    median(sorted.array_windows().map(|[a, b]| b - a).filter(|step| *step > 0.0).collect())
}

/// Returns the unit in which times overlap with `others`, whose unit is known.
pub(super) fn matching_unit(times: &[f64], (others, unit): (&[f64], f64)) -> Option<f64> {
    let range = |times: &[f64], unit: f64| {
        let all = times.iter().map(|time| time * unit);
        all.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], t| [a.min(t), b.max(t)])
    };
    let [start, end] = range(others, unit);
    let overlaps = |unit: &f64| {
        let [first, last] = range(times, *unit);
        first <= end && last >= start
    };
    // The same unit first: frames and poses usually share a clock.
    std::iter::once(unit).chain(UNITS).find(overlaps)
}

/// Returns the lines that are neither empty nor a comment (`#`), with line numbers from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Sorts items by time (stable sort). Returns the number of items that were earlier than the previous
/// item.
pub(super) fn sort_by_time<T>(items: &mut [T], time: impl Fn(&T) -> f64) -> usize {
    let n = items.array_windows().filter(|[before, here]| time(here) < time(before)).count();
    items.sort_by(|a, b| time(a).total_cmp(&time(b)));
    n
}

/// Returns the error for a time that has no pose or photograph (`what`) within `tolerance`, seconds.
/// `nearest` is the time difference to the nearest one, seconds.
pub(super) fn not_in_time(
    what: &'static str,
    time: f64,
    tolerance: f64,
    nearest: Option<f64>,
) -> FrameProblem {
    let found = nearest.map(|nearest| format!("the nearest {:.0} ms away", 1e3 * nearest));
    let found = found.unwrap_or_else(|| "none".to_owned());
    FrameProblem::NotInTime { what, time, tolerance_ms: (1e4 * tolerance).round() / 10.0, found }
}

/// Largest time to the nearer of two sparse poses, in halves of their usual step.
const MOST_OFF_HALF_STEP: f64 = 1.5;

pub(super) struct Trajectory {
    // Ascending by time, without duplicates.
    poses: Vec<TimedPose>,
    /// Maximum time from a frame between two poses to the nearer of them, seconds.
    reach: f64,
}

impl Trajectory {
    /// Sorts poses by time and removes poses with the same time as an earlier pose. Also returns the
    /// number of poses out of order and the number of removed poses.
    pub fn new(mut poses: Vec<TimedPose>) -> (Self, usize, usize) {
        let unordered = sort_by_time(&mut poses, |pose| pose.time);
        let n = poses.len();
        // Interpolation divides by the time between two poses.
        poses.dedup_by(|later, first| later.time == first.time);
        let doubled = n - poses.len();
        (Self { poses, reach: TOLERANCE }, unordered, doubled)
    }

    /// Allows for poses that are usually sparser than frames. Between poses farther apart, some are lost.
    pub fn between_sparse_poses(self) -> Self {
        let times: Vec<f64> = self.poses.iter().map(|pose| pose.time).collect();
        let half_step = 0.5 * usual_step(&times).unwrap_or(0.0);
        Self { reach: TOLERANCE.max(MOST_OFF_HALF_STEP * half_step), ..self }
    }

    pub fn end(&self) -> Option<f64> {
        self.poses.last().map(|pose| pose.time)
    }

    /// Returns the pose at a time, interpolated between the poses before and after. At either end of the
    /// trajectory, returns the nearest pose.
    ///
    /// # Errors
    /// Fails if no pose is within [`TOLERANCE`], or within the reach of sparse poses on both sides.
    pub fn at(&self, time: f64) -> Result<DMat4, FrameProblem> {
        self.within(TOLERANCE, time)
    }

    /// Returns the pose as [`Self::at`] does, with another tolerance in seconds.
    pub fn within(&self, tolerance: f64, time: f64) -> Result<DMat4, FrameProblem> {
        let after = self.poses.partition_point(|pose| pose.time < time);
        let (before, after) =
            (after.checked_sub(1).and_then(|i| self.poses.get(i)), self.poses.get(after));
        let distance =
            |pose: Option<&TimedPose>| pose.map_or(f64::INFINITY, |p| (p.time - time).abs());
        let nearest = distance(before).min(distance(after));
        let is_between = before.is_some() && after.is_some();
        let tolerance = if is_between { tolerance.max(self.reach) } else { tolerance };
        if nearest > tolerance {
            let nearest = nearest.is_finite().then_some(nearest);
            return Err(not_in_time("a pose", time, tolerance, nearest));
        }
        Ok(match (before, after) {
            (Some(a), Some(b)) => {
                let t = (time - a.time) / (b.time - a.time);
                let turn = a.turn.slerp(b.turn, t);
                DMat4::from_rotation_translation(turn, a.position.lerp(b.position, t))
            }
            (Some(only), None) | (None, Some(only)) => only.matrix(),
            // Not reached: without any pose the distance above is infinite.
            (None, None) => Pose::IDENTITY.to_opencv(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: f64, x: f64, angle: f64) -> TimedPose {
        let q = DQuat::from_rotation_z(angle);
        TimedPose::new([time, x, 0.0, 0.0, q.x, q.y, q.z, q.w]).unwrap()
    }

    #[test]
    fn poses_between_two_are_interpolated_on_the_sphere() {
        let (path, unordered, doubled) =
            Trajectory::new(vec![at(2.0, 1.0, 0.8), at(1.99, 0.0, 0.0), at(2.0, 9.0, 0.0)]);
        assert_eq!((unordered, doubled), (1, 1));
        let half = path.at(1.995).unwrap();
        let expected = DMat4::from_rotation_translation(
            DQuat::from_rotation_z(0.4),
            DVec3::new(0.5, 0.0, 0.0),
        );
        assert!(half.abs_diff_eq(expected, 1e-9), "{half}");
        assert!(path.at(2.019).unwrap().abs_diff_eq(at(0.0, 1.0, 0.8).matrix(), 1e-12));
        let error = path.at(2.5).unwrap_err().to_string();
        assert!(error.contains("within 20 ms") && error.contains("500 ms away"), "{error}");
        assert!(TimedPose::new([0.0; 8]).is_none() && TimedPose::new([f64::NAN; 8]).is_none());
    }
}
