//! Folders exported by Record3D: `metadata.json` (or `metadata`), `rgb/N.jpg`, `depth/N.exr`, and
//! `confidence/N.*` if recorded.

use super::format::{DatasetFormat, ParsedFolder};
use super::numbered::{NumberedFiles, PHOTOGRAPHS};
use super::record3d::{FrameSources, Metadata};
use super::recording::{Recording, metadata_error};
use crate::dataset::decode::CodeKind;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_convention::PoseConvention;
use std::collections::BTreeMap;
use std::path::Path;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "Record3D's export: `metadata.json` with `K` and `poses`, `rgb/` and `depth/`",
    poses: PoseConvention::Opengl,
    recognise,
    parse,
    known_calibration: |_| None,
};

const METADATA: [&str; 2] = ["metadata.json", "metadata"];
const COLORS: &str = "rgb";
const DEPTHS: &str = "depth";
const CONFIDENCES: [&str; 2] = ["confidence", "conf"];
/// Metres per unit of float files; codes would be millimetres.
const FLOAT_UNIT: f64 = 1.0;
const CODE_UNIT: f64 = 0.001;

fn recognise(folder: &Folder) -> Option<String> {
    let name = metadata(folder)?;
    let is_ours = folder.has_folder(COLORS);
    is_ours.then(|| format!("{name} with `K` and `poses`, and images in {COLORS}/"))
}

fn metadata(folder: &Folder) -> Option<&'static str> {
    METADATA.into_iter().find(|name| {
        folder.listing.has_file(name) && Metadata::is_one(folder.peek_whole(name).as_bytes())
    })
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let (file, text) = folder.text(metadata(folder).unwrap_or(METADATA[0]))?;
    let metadata = Metadata::new(file, text.as_bytes())?;
    let list = |name: &str, extensions: &[&str]| {
        NumberedFiles::list(folder, name, "", extensions).map_err(|problem| {
            let expected = "a folder of numbered images";
            metadata_error(
                &folder.path.join(name),
                expected,
                problem.to_string(),
                "export it again",
            )
        })
    };
    let colors = list(COLORS, &PHOTOGRAPHS)?;
    recording.skip_doubled(&colors, COLORS);
    let depths = match folder.has_folder(DEPTHS) {
        true => Some(list(DEPTHS, &["exr", "png", "tiff", "tif", "npy"])?),
        false => None,
    };
    if let Some(depths) = &depths {
        recording.skip_doubled(depths, DEPTHS);
    }
    let confidence = CONFIDENCES.into_iter().find(|name| folder.has_folder(name));
    let confidences = confidence.map(|name| list(name, &["png", "conf", "bin"])).transpose()?;
    let mut frames = BTreeMap::new();
    let lists: Vec<&NumberedFiles> =
        [Some(&colors), depths.as_ref()].into_iter().flatten().collect();
    let taken = |number: &u64| folder.was_taken(&number.to_string());
    for number in NumberedFiles::union(&lists).into_iter().filter(|number| !taken(number)) {
        match sources(folder, [Some(&colors), depths.as_ref(), confidences.as_ref()], number) {
            Ok(sources) => drop(frames.insert(number, sources)),
            Err(problem) => {
                recording.skip(&number.to_string(), folder.path.join(COLORS), problem);
            }
        }
    }
    // By name: the unit must not depend on whether a file can be read.
    let is_codes = depths
        .as_ref()
        .is_some_and(|d| d.numbers().next().is_some_and(|n| d.has_extension(n, "png")));
    let unit = CodeKind::ByContent(if is_codes { CODE_UNIT } else { FLOAT_UNIT });
    metadata.record(&mut recording, &frames, unit)?;
    Ok(recording.finish())
}

fn sources(
    folder: &Folder,
    [colors, depths, confidences]: [Option<&NumberedFiles>; 3],
    number: u64,
) -> Result<FrameSources, FrameProblem> {
    let file = |files: Option<&NumberedFiles>| {
        files.and_then(|files| files.file(folder, number)).transpose()
    };
    let missing = || {
        FrameProblem::MissingColor(Path::new(COLORS).join(number.to_string()).display().to_string())
    };
    let confidence = file(confidences)?;
    if folder.is_growing() && confidences.is_some() && confidence.is_none() {
        return Err(FrameProblem::MissingConfidence(number.to_string()));
    }
    Ok(FrameSources {
        color: file(colors)?.ok_or_else(missing)?.into(),
        depth: file(depths)?.map(Into::into),
        confidence: confidence.map(Into::into),
    })
}
