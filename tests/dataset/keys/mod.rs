//! The page of keys against the readers: each row is fed, as a small recording of its layout in which that key alone
//! is changed or added. A row without a feeding fails, as does a feeding without a row.

mod apps;
mod lists;
mod programs;

use crate::common::layouts::TestLayout;
use crate::common::scratch::{edit_json, open_plain, tiny};
use serde_json::{Value, json};
use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use tempfile::TempDir;
use vbgs_studio::dataset::{Dataset, FrameEntry};
use vbgs_studio::math::camera::Intrinsics;

const PAGE: &str = include_str!("../../../docs/reference/dataset-keys.md");

/// A number that is that of the unchanged recording.
const SAME: f64 = f64::NAN;

/// What a key does to the first frame, unless the variant says otherwise.
enum Effect {
    /// Focal lengths of the photograph, pixels.
    Focal([f64; 2]),
    /// Principal point of the photograph, pixels.
    Principal([f64; 2]),
    /// Focal lengths of depth, pixels.
    DepthFocal([f64; 2]),
    /// OpenCV's terms `k1 k2 p1 p2 k3 k4 k5 k6` of the photograph's lens; those at the end may be missing.
    Lens(&'static [f64]),
    /// Lengths, as a multiple of those of the unchanged recording.
    Depth(f64),
    /// Seconds to the second frame.
    Step(f64),
    /// Place in the unchanged recording's camera, metres.
    Shift([f64; 3]),
    /// The second frame has the pose of the first.
    LatePose,
    /// The photograph was taken at this fraction of the way to the second frame.
    PhotographBetween(f64),
    /// A value that the images contradict: the recording is refused with these words.
    Checked(&'static str),
    /// As [`Self::Checked`], at the cost of the frame.
    Skipped(&'static str),
    /// A defect line names the key, or has these words.
    Unused,
    UnusedAs(&'static str),
    /// The recording is refused with these words.
    Refused(&'static str),
}

use Effect::*;

impl Effect {
    /// First word of the page's last column.
    fn word(&self) -> &'static str {
        match self {
            Unused | UnusedAs(_) => "unused",
            Refused(_) => "refused",
            _ => "used",
        }
    }
}

type Edit = Box<dyn Fn(&Path)>;
/// Key, change of the recording, and effect.
type Feed = (&'static str, Edit, Effect);

/// Feedings of a table of the page.
struct Table {
    /// Heading: names of layouts.
    heading: &'static str,
    base: fn() -> TempDir,
    feeds: Vec<Feed>,
}

fn edit(change: impl Fn(&Path) + 'static) -> Edit {
    Box::new(change)
}

/// Sets values of a JSON file by their pointers; a null removes the key.
fn set(file: &'static str, values: &[(&'static str, Value)]) -> Edit {
    let values = values.to_vec();
    edit(move |root| edit_json(&root.join(file), |json| set_in(json, &values)))
}

fn set_in(json: &mut Value, values: &[(&'static str, Value)]) {
    for (pointer, value) in values {
        let (parent, key) = pointer.rsplit_once('/').unwrap();
        let object = json.pointer_mut(parent).unwrap().as_object_mut().unwrap();
        match value {
            Value::Null => drop(object.remove(key).unwrap()),
            value => drop(object.insert(key.to_owned(), value.clone())),
        }
    }
}

/// Replaces a text file.
fn put_text(file: &'static str, text: impl Into<String>) -> Edit {
    let text = text.into();
    edit(move |root| fs::write(root.join(file), &text).unwrap())
}

/// Replaces the first occurrence of a text.
fn replace(file: &'static str, from: &'static str, to: impl Into<String>) -> Edit {
    let to = to.into();
    edit(move |root| {
        let text = fs::read_to_string(root.join(file)).unwrap();
        assert!(text.contains(from), "{file} lacks {from}: {text}");
        fs::write(root.join(file), text.replacen(from, &to, 1)).unwrap();
    })
}

/// Changes the numbers of each line of a list, with the line's index; comments stay.
fn columns(file: &'static str, change: impl Fn(usize, &mut Vec<String>) + 'static) -> Edit {
    edit(move |root| {
        let text = fs::read_to_string(root.join(file)).unwrap();
        let (comments, lines): (Vec<&str>, Vec<&str>) =
            text.lines().partition(|line| line.starts_with('#'));
        let lines = lines.into_iter().enumerate().map(|(i, line)| {
            let mut cells = line.split(' ').map(str::to_owned).collect();
            change(i, &mut cells);
            cells.join(" ")
        });
        let all: Vec<String> = comments.iter().map(ToString::to_string).chain(lines).collect();
        fs::write(root.join(file), all.join("\n") + "\n").unwrap();
    })
}

/// Adds seconds to the number in a cell.
fn delay(cell: &mut String, seconds: f64) {
    *cell = format!("{:.6}", cell.parse::<f64>().unwrap() + seconds);
}

/// Time between frames of the recordings that tests write, seconds.
const FRAME: f64 = 1.0 / 30.0;
const MATRIX: &str = "40 0 15\n0 41 11\n0 0 1\n";
const SKEWED: &str = "40 0.5 15\n0 41 11\n0 0 1\n";
const OFFSET: &str = "1 0 0 0.05\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";

/// The camera matrix of [`MATRIX`].
fn matrix() -> Value {
    json!([[40.0, 0.0, 15.0], [0.0, 41.0, 11.0], [0.0, 0.0, 1.0]])
}

fn frames(dataset: &Dataset) -> &[FrameEntry] {
    let split = ["train", "all"].iter().find_map(|name| dataset.split_named(name).ok());
    &dataset.splits[split.unwrap()].frames
}

fn photograph(dataset: &Dataset) -> Intrinsics {
    frames(dataset)[0].photo_camera(None).intrinsics
}

fn lengths(dataset: &Dataset) -> Vec<f64> {
    let depth = frames(dataset)[0].load_depth().unwrap().unwrap();
    let (width, height) = depth.size();
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    pixels.map(|(x, y)| depth.value_at(x, y).unwrap_or(0.0)).collect()
}

fn near(found: [f64; 2], expected: [f64; 2], unchanged: [f64; 2]) -> bool {
    let one = |i: usize| if expected[i].is_nan() { unchanged[i] } else { expected[i] };
    (0..2).all(|i| (found[i] - one(i)).abs() < 1e-4)
}

/// Checks that the photograph is straightened as other layouts do with the same terms.
fn check_lens(found: &Dataset, unchanged: &Dataset, terms: &[f64]) -> Result<(), String> {
    let pixels = |dataset: &Dataset| frames(dataset)[0].load_color().unwrap();
    let [found, straight] = [found, unchanged].map(pixels);
    let expected = pixels(&open_plain(programs::bent(reference(unchanged), terms).path()).unwrap());
    let n_other = |other: &[[u8; 4]]| {
        let pairs = found.data.iter().zip(other);
        let differ = |(a, b): &(&[u8; 4], &[u8; 4])| (0..3).any(|i| a[i].abs_diff(b[i]) > 2);
        pairs.filter(differ).count()
    };
    let [off, moved] = [n_other(&expected.data), n_other(&straight.data)];
    let is_so = found.data.len() == expected.data.len() && off < 10 && moved > 40;
    if is_so {
        Ok(())
    } else {
        Err(format!("{off} pixels differ from another layout, {moved} moved"))
    }
}

/// Layout that serves as reference for the lens of a dataset of another one.
fn reference(dataset: &Dataset) -> TestLayout {
    match dataset.layout {
        vbgs_studio::dataset::Layout::RtabMap => TestLayout::Ros2Bag,
        _ => TestLayout::RtabMap,
    }
}

/// Checks the effect of a key on the recording at `path`.
fn check(path: &Path, key: &str, effect: &Effect, unchanged: &Dataset) -> Result<(), String> {
    let opened = open_plain(path);
    if let Checked(words) | Refused(words) = effect {
        let said = opened.map_or_else(|e| e.to_string(), |d| format!("opened: {:?}", d.notes));
        return if said.contains(words) { Ok(()) } else { Err(said) };
    }
    let found = opened.map_err(|error| error.to_string())?;
    let numbers = |k: Intrinsics| ([k.fx, k.fy], [k.cx, k.cy]);
    let (focal, principal) = numbers(photograph(&found));
    let (same_focal, same_principal) = numbers(photograph(unchanged));
    let [depth, same_depth] =
        [&found, unchanged].map(|dataset| numbers(frames(dataset)[0].camera.intrinsics).0);
    let pose = |dataset: &Dataset, i: usize| frames(dataset)[i].camera.pose.to_opencv();
    let (is_so, shown) = match effect {
        Focal(expected) => (near(focal, *expected, same_focal), format!("{focal:?}")),
        Principal(expected) => {
            (near(principal, *expected, same_principal), format!("{principal:?}"))
        }
        DepthFocal(expected) => (near(depth, *expected, same_depth), format!("{depth:?}")),
        Lens(terms) => return check_lens(&found, unchanged, terms),
        Depth(factor) => {
            let pairs: Vec<_> = lengths(&found).into_iter().zip(lengths(unchanged)).collect();
            let known: Vec<_> = pairs.iter().filter(|(a, b)| *a > 0.0 && *b > 0.0).collect();
            let is_so = known.iter().all(|(a, b)| (a / b / factor - 1.0).abs() < 2e-3);
            (is_so && 2 * known.len() > pairs.len(), format!("{:?}", known.first()))
        }
        Step(seconds) => {
            let time = |i: usize| frames(&found)[i].time.unwrap_or(f64::NAN);
            ((time(1) - time(0) - seconds).abs() < 2e-5, format!("{}", time(1) - time(0)))
        }
        Shift(metres) => {
            let moved = (pose(unchanged, 0).inverse() * pose(&found, 0)).w_axis.truncate();
            ((moved - glam::DVec3::from(*metres)).length() < 1e-6, format!("{moved}"))
        }
        LatePose => {
            let name = &frames(unchanged)[1].name;
            let late = frames(&found).iter().find(|frame| frame.name == *name);
            let late = late.map(|frame| frame.camera.pose.to_opencv());
            let expected = pose(unchanged, 0);
            (late.is_some_and(|late| late.abs_diff_eq(expected, 1e-5)), format!("{late:?}"))
        }
        PhotographBetween(fraction) => {
            let of_photo = frames(&found)[0].photo_camera(None).pose.centre();
            let [a, b] = [0, 1].map(|i| frames(unchanged)[i].camera.pose.centre());
            ((of_photo - a.lerp(b, *fraction)).length() < 1e-4, format!("{of_photo}"))
        }
        Skipped(words) => {
            let said: Vec<String> = found.warnings.iter().map(ToString::to_string).collect();
            let is_so = said.len() == 1 && said[0].contains(words);
            (is_so && frames(&found).len() + 1 == frames(unchanged).len(), format!("{said:?}"))
        }
        Unused => (found.unused.iter().any(|line| names(line, key)), format!("{:?}", found.unused)),
        UnusedAs(words) => {
            (found.unused.iter().any(|line| line.contains(words)), format!("{:?}", found.unused))
        }
        Checked(_) | Refused(_) => unreachable!("returned above"),
    };
    let is_silent = found.unused.is_empty() || effect.word() == "unused";
    match (is_so, is_silent) {
        (true, true) => Ok(()),
        (true, false) => Err(format!("used, but {:?}", found.unused)),
        (false, _) => Err(shown),
    }
}

/// True if a line names the key as a word.
fn names(line: &str, key: &str) -> bool {
    line.split(|c: char| !c.is_alphanumeric() && c != '_').any(|word| word == key)
}

/// Heading, key and first word of the effect of a row.
type Row = (String, String, String);

/// Rows of the page's tables, one for each key.
fn rows() -> Vec<Row> {
    let (mut rows, mut heading) = (Vec::new(), "");
    for line in PAGE.lines() {
        if let Some(text) = line.strip_prefix("## ") {
            heading = text;
        }
        let cells: Vec<&str> = line.trim_matches('|').split(" | ").map(str::trim).collect();
        let (Some(keys), Some(effect)) = (cells.first(), cells.get(3)) else { continue };
        let word = effect.split(|c: char| !c.is_alphabetic()).next().unwrap_or_default();
        let keys = keys.split('`').skip(1).step_by(2);
        rows.extend(keys.map(|key| (heading.to_owned(), key.to_owned(), word.to_owned())));
    }
    rows
}

fn tables() -> Vec<Table> {
    [lists::tables(), apps::tables(), programs::tables()].into_iter().flatten().collect()
}

#[test]
fn every_key_of_the_page_does_what_the_page_states() {
    let mut wrong = Vec::new();
    for Table { heading, base, feeds } in tables() {
        let folder = base();
        let unchanged = open_plain(folder.path()).unwrap();
        assert!(unchanged.unused.is_empty(), "{heading}: {:?}", unchanged.unused);
        let layout = unchanged.layout.name();
        assert!(heading.split(", ").any(|name| name == layout), "{heading}: {layout}");
        for (key, change, effect) in feeds {
            let folder = base();
            change(folder.path());
            if let Err(found) = check(folder.path(), key, &effect, &unchanged) {
                wrong.push(format!("{layout}, `{key}`, {}: found {found}", effect.word()));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn rows_and_feedings_are_the_same() {
    let fed = tables().into_iter().flat_map(|Table { heading, feeds, .. }| {
        let row = move |(key, _, effect): Feed| {
            (heading.to_owned(), key.to_owned(), effect.word().to_owned())
        };
        feeds.into_iter().map(row).collect::<Vec<Row>>()
    });
    let [fed, rows] = [fed.collect(), rows()].map(BTreeSet::from_iter);
    let [unfed, unlisted]: [Vec<&Row>; 2] =
        [rows.difference(&fed).collect(), fed.difference(&rows).collect()];
    assert!(unfed.is_empty(), "rows without a feeding: {unfed:#?}");
    assert!(unlisted.is_empty(), "feedings without a row: {unlisted:#?}");
}

#[test]
fn every_layout_has_a_table() {
    let headings = tables().into_iter().flat_map(|table| table.heading.split(", "));
    let found: BTreeSet<&str> = headings.collect();
    // Images alone have no writer of their own.
    let written =
        TestLayout::ALL.map(|layout| open_plain(tiny(layout).path()).unwrap().layout.name());
    let expected = BTreeSet::from_iter(written.into_iter().chain(["color-depth"]));
    assert_eq!((found.len(), found), (19, expected));
}
