//! Photographs in `color/` (`image/`, `rgb/`) and depth in `depth/`, paired by number. Shared by the Open3D
//! layout and by recordings without poses. Depth is in millimetres.

use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::recording::{Cameras, Recording, metadata_error};
use super::stated::{self, PRIMESENSE};
use crate::dataset::decode::{CodeKind, DepthEncoding};
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::source::ByteSource;
use crate::dataset::surface::sensor::Sensor;
use std::collections::BTreeMap;

const COLOR_FOLDERS: [&str; 3] = ["color", "image", "rgb"];
const DEPTH_FOLDER: &str = "depth";
/// Metres per code.
const DEPTH_UNIT: f64 = 0.001;
/// Metres; range of a structured-light depth camera.
const TRUSTED_DEPTH: [f64; 2] = [0.3, 4.0];

/// Describes the image folders, if both exist.
pub(super) fn recognise(folder: &Folder) -> Option<String> {
    let color = color_folder(folder)?;
    folder.has_folder(DEPTH_FOLDER).then(|| format!("images in {color}/ and {DEPTH_FOLDER}/"))
}

fn color_folder(folder: &Folder) -> Option<&'static str> {
    COLOR_FOLDERS.into_iter().find(|name| folder.has_folder(name))
}

/// Pairs of photograph and depth by number, and their cameras.
type PairedImages = (BTreeMap<u64, Pair>, Cameras);

/// Reads the images of a recording; `None` if none can be read.
pub(super) fn read(recording: &mut Recording) -> Result<Option<PairedImages>, DatasetError> {
    let folder = recording.folder;
    let color_name = color_folder(folder).unwrap_or("color");
    let mut list = |name: &str, extensions: &[&str]| {
        let files = NumberedFiles::list(folder, name, "", extensions);
        if let Ok(files) = &files {
            recording.skip_doubled(files, name);
        }
        files.map_err(|problem| {
            metadata_error(
                &folder.path.join(name),
                "a folder of images",
                problem.to_string(),
                "restore it",
            )
        })
    };
    let colors = list(color_name, &PHOTOGRAPHS)?;
    let depths = list(DEPTH_FOLDER, &["png"])?;
    let pairs = pairs(recording, &colors, &depths, color_name);
    let cameras = cameras(recording, &pairs)?;
    Ok(cameras.map(|cameras| (pairs, cameras)))
}

pub(super) fn encoding(recording: &Recording) -> DepthEncoding {
    recording.encoding(CodeKind::Linear16(DEPTH_UNIT), Sensor::Kinect, TRUSTED_DEPTH)
}

pub(super) struct Pair {
    /// File name of the photograph without its extension.
    pub name: String,
    pub color: Option<ByteSource>,
    depth: Result<ByteSource, String>,
}

impl Pair {
    pub fn depth(&self) -> Result<ByteSource, FrameProblem> {
        self.depth.clone().map_err(FrameProblem::MissingDepth)
    }
}

/// Pairs files by number, or by order if the counts are equal and the numbers differ.
fn pairs(
    recording: &mut Recording,
    colors: &NumberedFiles,
    depths: &NumberedFiles,
    color_name: &str,
) -> BTreeMap<u64, Pair> {
    let folder = recording.folder;
    let same = colors.numbers().eq(depths.numbers());
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
    let (file, k) = match (stated::in_json_file(folder)?, stated::in_text_file(folder, size)?) {
        (Some(stated), _) | (None, Some(stated)) => stated,
        (None, None) => {
            let is_known = size == (PRIMESENSE.width, PRIMESENSE.height);
            let file = folder.path.join("camera.json");
            if !is_known && recording.options.intrinsics.is_none() {
                let expected = format!("a camera for images of {}x{}", size.0, size.1);
                let found = "no JSON file with an `intrinsic_matrix`".to_owned();
                return Err(metadata_error(
                    &file,
                    &expected,
                    found,
                    "export it, or set the intrinsics",
                ));
            }
            recording.note("no camera file: a PrimeSense's 525, 525, 319.5, 239.5 are used");
            (file, PRIMESENSE)
        }
    };
    if (k.width, k.height) != depth_size {
        super::recording::same_size((k.width, k.height), size, &file)?;
    }
    recording.cameras_of_lens(&k, size, depth_size, &file).map(Some)
}
