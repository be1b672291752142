//! Record3D's `.r3d`: a zip archive, opened directly or as the only one in its folder.
//!
//! Members are read by the names of frames only and never unpacked to disk, so no name can lead outside;
//! names that try to are reported.

use super::format::{DatasetFormat, ParsedFolder};
use super::record3d::{FrameSources, Metadata};
use super::recording::{Recording, metadata_error};
use crate::dataset::archive::Archive;
use crate::dataset::decode::CodeKind;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::{Folder, relative_path};
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_convention::PoseConvention;
use crate::dataset::source::ByteSource;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "Record3D's archive: one zip archive with `metadata` and `rgbd/`",
    poses: PoseConvention::Opengl,
    recognise,
    parse,
    known_calibration: |_| None,
};

const METADATA: [&str; 2] = ["metadata", "metadata.json"];
const FRAMES: &str = "rgbd/";

fn recognise(folder: &Folder) -> Option<String> {
    let name = archive_name(folder)?;
    Some(format!("the archive {name} with `metadata` of `K` and `poses`"))
}

/// Name of the archive that was opened, even if damaged, or of the only recording in the root.
fn archive_name(folder: &Folder) -> Option<&str> {
    if let Some(name) = folder.opened_archive() {
        return Some(name);
    }
    let is_ours = |name: &&str| {
        is_recording(folder, name).unwrap_or_else(|problem| {
            folder.record_unread(name, problem);
            false
        })
    };
    let mut ours = folder.listing.files().filter(|name| name.ends_with(".r3d")).filter(is_ours);
    let first = ours.next();
    // Two recordings are two scenes: the user has to choose one.
    first.filter(|_| ours.next().is_none())
}

/// True if a file in the root is an archive with this app's metadata.
fn is_recording(folder: &Folder, name: &str) -> Result<bool, FrameProblem> {
    let path = folder.file(Path::new(""), &folder.listing, name)?;
    if !Archive::is_zip_archive(&path)? {
        return Ok(false);
    }
    let archive = Archive::open(&path)?;
    let names = archive.names();
    for name in METADATA.into_iter().filter(|name| names.iter().any(|n| n == name)) {
        if Metadata::is_one(&archive.read(name)?) {
            return Ok(true);
        }
    }
    Ok(false)
}

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    let mut recording = Recording::new(folder, options);
    let path = folder.path.join(archive_name(folder).unwrap_or_default());
    let damaged = |problem: FrameProblem| match problem {
        FrameProblem::Read(source) => DatasetError::Read { path: path.clone(), source },
        other => {
            let expected = "a recording shared by Record3D";
            metadata_error(&path, expected, other.to_string(), "share the recording again")
        }
    };
    let archive = Archive::open(&path).map_err(damaged)?;
    let archive = Arc::new(archive);
    let names: BTreeSet<String> = archive.names().into_iter().collect();
    for name in names.iter().filter(|name| relative_path(name).is_err()) {
        recording.skip(name, path.clone(), FrameProblem::OutsideFolder(name.clone()));
    }
    let Some(name) = METADATA.into_iter().find(|name| names.contains(*name)) else {
        let found = format!("{} members, none of that name", names.len());
        return Err(metadata_error(
            &path,
            "a member `metadata`",
            found,
            "share the recording again",
        ));
    };
    let text = archive.read(name).map_err(damaged)?;
    let metadata = Metadata::new(path.join(name), &text)?;
    let member = |name: String| names.contains(&name).then(|| ByteSource::member(&archive, &name));
    let mut frames = BTreeMap::new();
    for name in &names {
        let alone = name.strip_prefix(FRAMES).and_then(|n| n.strip_suffix(".depth"));
        if let Some(stem) = alone.filter(|stem| !names.contains(&format!("{FRAMES}{stem}.jpg"))) {
            let problem = FrameProblem::MissingColor(format!("{FRAMES}{stem}.jpg"));
            recording.skip(stem, path.clone(), problem);
        }
        let Some(stem) = name.strip_prefix(FRAMES).and_then(|n| n.strip_suffix(".jpg")) else {
            continue;
        };
        let Ok(number) = stem.parse::<u64>() else { continue };
        let sources = FrameSources {
            color: ByteSource::member(&archive, name),
            depth: member(format!("{FRAMES}{stem}.depth")),
            confidence: member(format!("{FRAMES}{stem}.conf")),
        };
        match frames.contains_key(&number) {
            true => {
                let problem = FrameProblem::Duplicate(format!("`{name}`"));
                recording.skip(stem, path.clone(), problem);
            }
            false => drop(frames.insert(number, sources)),
        }
    }
    metadata.record(&mut recording, &frames, CodeKind::BareFloats)?;
    Ok(recording.finish())
}
