//! NeRF-synthetic: `transforms_SPLIT.json` with one field of view, RGBA images, and depth next to them as
//! `STEM_depth_NNNN.png`.
//!
//! 8-bit depth is `8·(1 − d/255)` units along the ray (`dataset.md`, Depth encodings). 16-bit depth is
//! along the ray too and needs `integer_depth_scale` (or `depth_scale`), world units per step. The range of
//! positions is `position_range` (`[[x,y,z],[x,y,z]]`, low and high corner) if the file has it, else the
//! `[−1, 1]³` of NeRF-synthetic scenes.
//!
//! The layout has no version, and files in use differ: `file_path` with or without extension, matrices
//! of three or four rows, focal lengths instead of the angle. Unambiguous forms are accepted. Ambiguous
//! ones (an angle in degrees, 16-bit depth without its scale) are rejected; the error suggests a
//! correction.

use super::nerfstudio;
use super::numbered::{ListedFrame, ListedSplit, PHOTOGRAPHS};
use super::recording::{
    ANY_RANGE, Cameras, check_intrinsics, metadata_error, photograph_size, same_size,
};
use super::stated::{
    FrameCamera, array, camera_keys, check_model, entry_name, frame_lists, name_keys, read_list,
    split_name, unused_keys,
};
use crate::dataset::calibration::from_user;
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::depth::DepthKind;
use crate::dataset::entry::{DatasetSplit, FrameEntry};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, FolderListing, relative_path};
use crate::dataset::formats::{DatasetFormat, ParsedFolder};
use crate::dataset::matrix::{describe_json, from_json};
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_check::PoseConvention;
use crate::dataset::range::PositionRange;
use crate::dataset::surface::sensor::Sensor;
use crate::math::pose::Pose;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::path::PathBuf;
use std::rc::Rc;

pub(super) const FORMAT: DatasetFormat =
    DatasetFormat { poses: PoseConvention::Opengl, recognise, parse };

/// Keys of the length of a step of 16-bit depth.
const SCALES: [&str; 2] = ["integer_depth_scale", "depth_scale"];

fn recognise(folder: &Folder) -> Option<String> {
    let lists = lists(folder);
    // `None` without lists, so that other layouts are tried without a message.
    (!lists.is_empty()).then(|| format!("{} with `frames` and their poses", lists.join(", ")))
}

fn lists(folder: &Folder) -> Vec<&str> {
    // Both layouts name their lists alike, so the content decides, of all lists at once.
    let own = frame_lists(folder).map(|(name, json)| (!nerfstudio::is_list(&json)).then_some(name));
    own.collect::<Option<_>>().unwrap_or_default()
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut parsed = ParsedFolder::default();
    for name in lists(folder) {
        let list = FrameList::read(folder, name)?;
        let split = list.split(folder, options, &mut parsed)?;
        list.name_unused_keys(split.as_ref(), &mut parsed);
        parsed.splits.extend(split);
        if let Some(range) = list.range()? {
            parsed.known_range = Some(range);
        }
    }
    // Its scenes fill this cube without stating it.
    parsed.known_range.get_or_insert_with(PositionRange::nerf_synthetic);
    Ok(parsed)
}

struct FrameList {
    file: PathBuf,
    split: String,
    json: Value,
}

impl FrameList {
    fn read(folder: &Folder, name: &str) -> Result<Self, DatasetError> {
        let (file, json) = read_list(folder, name)?;
        let split = split_name(name).to_owned();
        Ok(Self { file, split, json })
    }

    fn camera(&self) -> FrameCamera<'_> {
        FrameCamera { frame: &self.json, list: &self.json, file: &self.file }
    }

    fn wrong(&self, expected: &str, found: String, hint: &str) -> DatasetError {
        metadata_error(&self.file, expected, found, hint)
    }

    fn frames(&self) -> Result<&[Value], DatasetError> {
        let expected = "an object with a list `frames` of `file_path` and `transform_matrix`";
        let hint = "export the frame list again";
        match self.json.get("frames").and_then(Value::as_array) {
            None => Err(self.wrong(expected, describe_json(&self.json), hint)),
            Some(frames) if frames.is_empty() => {
                Err(self.wrong("at least one entry in `frames`", "none".to_owned(), hint))
            }
            Some(frames) => Ok(frames),
        }
    }

    fn name_unused_keys(&self, split: Option<&DatasetSplit>, parsed: &mut ParsedFolder) {
        let mut found = BTreeSet::new();
        let depth = split.and_then(|split| split.frames.iter().find_map(FrameEntry::depth_source));
        // 8-bit depth has a fixed scale.
        let is_scaled = depth.is_some_and(|d| matches!(d.encoding.codes, CodeKind::Linear16(_)));
        let scales: &[&str] = if is_scaled { &SCALES } else { &[] };
        unused_keys(&self.json, &[&camera_keys()[..], scales].concat(), &mut found);
        // Frames have no camera of their own.
        for frame in array(&self.json, "frames") {
            unused_keys(frame, &[], &mut found);
        }
        name_keys(parsed, &self.file, &found);
    }

    fn split(
        &self,
        folder: &Folder,
        options: &LoadOptions,
        parsed: &mut ParsedFolder,
    ) -> Result<Option<DatasetSplit>, DatasetError> {
        let listed = self.listed(folder, options, parsed)?;
        let Ok(Some(size)) = photograph_size(listed.colors()) else {
            listed.skip_unreadable(parsed);
            return Ok(None);
        };
        let camera = self.camera();
        same_size(camera.size(size)?, size, &self.file)?;
        check_model(&camera)?;
        let stated = camera.intrinsics(size)?;
        check_intrinsics(&stated, &self.file)?;
        let intrinsics =
            options.intrinsics.map_or(Ok(stated), |numbers| from_user(numbers, size))?;
        let Some(bits) = listed.depth_bits() else {
            listed.skip_unreadable(parsed);
            return Ok(None);
        };
        let encoding = self.depth_encoding(bits, options)?;
        let cameras = Cameras::registered(intrinsics);
        Ok(Some(listed.into_split(|_| (cameras, encoding), parsed)))
    }

    fn listed(
        &self,
        folder: &Folder,
        options: &LoadOptions,
        parsed: &mut ParsedFolder,
    ) -> Result<ListedSplit, DatasetError> {
        let mut images = ImageFolders { folder, listed: BTreeMap::new() };
        let mut frames = Vec::new();
        for (i, frame) in self.frames()?.iter().enumerate() {
            let name = entry_name(frame, i);
            if folder.was_taken(&name) {
                continue;
            }
            match listed_frame(frame, &name, &mut images, options) {
                Ok(frame) => frames.push(frame),
                Err(problem) => parsed.skip(&self.split, &name, self.file.clone(), problem),
            }
        }
        Ok(ListedSplit { name: self.split.clone(), frames })
    }

    fn depth_encoding(
        &self,
        bits: u16,
        options: &LoadOptions,
    ) -> Result<DepthEncoding, DatasetError> {
        let (codes, sensor) = if bits == 16 {
            let [first, other] = SCALES.map(|key| self.camera().number(key));
            let stated = first?.map_or(other, |scale| Ok(Some(scale)))?;
            // The user's scale replaces a wrong one in the file.
            match options.depth_scale.or(stated).filter(|s| s.is_finite() && *s > 0.0) {
                // Scenes of this layout are rendered: 16-bit codes are computed depth.
                Some(unit) => (CodeKind::Linear16(unit), Sensor::Exact { noise: 0.0 }),
                None => {
                    return Err(self.wrong(
                        "a positive `integer_depth_scale` (world units per step) for 16-bit depth",
                        stated.map_or("no such key".to_owned(), |s| s.to_string()),
                        "add the key to the file or set the depth scale",
                    ));
                }
            }
        } else {
            // The original export; its scale is fixed.
            (CodeKind::Inverse8, Sensor::Inverse8Ray)
        };
        let trusted = options.depth_range.unwrap_or(ANY_RANGE);
        let kind = DepthKind::RayDistance;
        Ok(DepthEncoding { codes, kind, trusted, units_per_metre: 1.0, sensor })
    }

    fn range(&self) -> Result<Option<PositionRange>, DatasetError> {
        let Some(value) = self.json.get("position_range") else { return Ok(None) };
        let corners: Option<[[f64; 3]; 2]> = serde_json::from_value(value.clone()).ok();
        let range = corners.and_then(|[lo, hi]| {
            PositionRange::new(lo.into(), hi.into(), "`position_range` of the frame list")
        });
        range.map(Some).ok_or_else(|| {
            let expected = "`position_range` as [[x,y,z],[x,y,z]], low and high corner";
            self.wrong(expected, describe_json(value), "correct the corners or remove the key")
        })
    }
}

fn listed_frame(
    frame: &Value,
    name: &str,
    images: &mut ImageFolders,
    options: &LoadOptions,
) -> Result<ListedFrame, FrameProblem> {
    let Some(file_path) = frame.get("file_path").and_then(Value::as_str) else {
        let expected = "a `file_path` in each entry of `frames`";
        return Err(FrameProblem::Entry { expected, found: describe_json(frame) });
    };
    let matrix = || from_json(frame.get("transform_matrix"));
    let pose = options.pose(|| Ok(Pose::from_opengl(matrix()?)?))?;
    let (color, depth) = images.find(file_path)?;
    let (color, depth) = (color.into(), depth.map(Into::into));
    Ok(ListedFrame { name: name.to_owned(), pose, color, depth })
}

struct ImageFolders<'a> {
    folder: &'a Folder,
    listed: BTreeMap<PathBuf, (Rc<FolderListing>, HashMap<String, String>)>,
}

impl ImageFolders<'_> {
    /// Finds the colour file of a `file_path`, which may lack the extension, and the corresponding depth
    /// file.
    fn find(
        &mut self,
        file_path: &str,
    ) -> Result<(PathBuf, Result<PathBuf, FrameProblem>), FrameProblem> {
        let relative = relative_path(file_path)?;
        let (Some(parent), Some(name)) =
            (relative.parent(), relative.file_name().and_then(|n| n.to_str()))
        else {
            return Err(FrameProblem::MissingColor(format!("`{file_path}`")));
        };
        let missing = || FrameProblem::MissingColor(format!("{file_path}.png (or .jpg)"));
        // Each folder is listed once, not once per frame.
        if !self.listed.contains_key(parent) {
            let listing =
                self.folder.list(parent).map_err(|problem| problem.or_missing(missing))?;
            let depth_files = depth_files(&listing);
            self.listed.insert(parent.to_owned(), (listing, depth_files));
        }
        let (listing, depth_files) = self.listed.get(parent).ok_or_else(missing)?;
        let with_extension =
            PHOTOGRAPHS.iter().map(|e| format!("{name}.{e}")).find(|n| listing.has_file(n));
        let color_name = match listing.has_file(name) {
            true => name.to_owned(),
            false => with_extension.ok_or_else(missing)?,
        };
        let color = self.folder.file(parent, listing, &color_name)?;
        let stem = color_name.rsplit_once('.').map_or(color_name.as_str(), |(stem, _)| stem);
        let depth = match depth_files.get(stem) {
            Some(depth_name) => self.folder.file(parent, listing, depth_name),
            None => Err(FrameProblem::MissingDepth(format!("{stem}_depth_NNNN.png"))),
        };
        Ok((color, depth))
    }
}

/// Maps each `STEM` to its depth file `STEM_depth_DIGITS.png`. Of several files, the one with the lowest
/// number is used.
fn depth_files(listing: &FolderListing) -> HashMap<String, String> {
    let mut by_stem = HashMap::new();
    for name in listing.files() {
        let parts = name.strip_suffix(".png").and_then(|n| n.rsplit_once("_depth_"));
        if let Some((stem, number)) = parts
            && !number.is_empty()
            && number.bytes().all(|b| b.is_ascii_digit())
        {
            // Names are in ascending order: the lowest number comes first.
            by_stem.entry(stem.to_owned()).or_insert_with(|| name.to_owned());
        }
    }
    by_stem
}
