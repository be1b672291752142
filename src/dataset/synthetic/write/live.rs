//! Replay of a written recording: its files appear in another folder, one frame at a time.

use super::files::{WriteError, create_folder, write_text};
use crate::dataset::growing::END_MARKER;
use crate::dataset::synthetic::write::SyntheticLayout;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Kinds of files with one file per frame: folders in order, and a part of the file name that identifies
/// the kind.
type FrameFileKinds = &'static [(&'static [&'static str], &'static str)];
/// List files: name, number of header lines, lines per frame.
type FrameLists = &'static [(&'static str, usize, usize)];

/// Files and lists that hold a layout's frames.
pub(super) struct LiveLayout {
    files: FrameFileKinds,
    lists: FrameLists,
}

const LIVE: &str = "seven-scenes, tum, open3d, replica, scannet, stray-scanner, arkit, rtab-map";

impl LiveLayout {
    /// Returns the places of a layout.
    ///
    /// # Errors
    /// [`WriteError::NotLive`] if the layout cannot be written frame by frame.
    pub fn of(layout: SyntheticLayout) -> Result<Self, WriteError> {
        let (files, lists): (FrameFileKinds, FrameLists) = match layout {
            SyntheticLayout::SevenScenes => (
                &[
                    (&["train", "eval"], ".color."),
                    (&["train", "eval"], ".depth."),
                    (&["train", "eval"], ".pose."),
                ],
                &[],
            ),
            SyntheticLayout::Tum => (
                &[(&["rgb"], ""), (&["depth"], "")],
                &[("rgb.txt", 1, 1), ("depth.txt", 1, 1), ("groundtruth.txt", 1, 1)],
            ),
            SyntheticLayout::Open3d => {
                (&[(&["color"], ""), (&["depth"], "")], &[("trajectory.log", 0, 5)])
            }
            SyntheticLayout::Replica => {
                (&[(&["results"], "frame"), (&["results"], "depth")], &[("traj.txt", 0, 1)])
            }
            SyntheticLayout::Scannet => {
                (&[(&["color"], ""), (&["depth"], ""), (&["pose"], "")], &[])
            }
            SyntheticLayout::StrayScanner => (
                &[(&["rgb"], ""), (&["depth"], ""), (&["confidence"], "")],
                &[("odometry.csv", 1, 1)],
            ),
            SyntheticLayout::Arkit => (
                &[(&["images"], ""), (&["depth"], ""), (&["confidence"], "")],
                &[("frames.jsonl", 0, 1)],
            ),
            SyntheticLayout::RtabMap => {
                (&[(&["rgb"], ""), (&["depth"], ""), (&["calib"], "")], &[("poses.txt", 1, 1)])
            }
            SyntheticLayout::Blender(_)
            | SyntheticLayout::Nerfstudio
            | SyntheticLayout::Record3d
            | SyntheticLayout::Record3dArchive => {
                let layout = format!("{layout:?}");
                return Err(WriteError::NotLive { layout, expected: LIVE });
            }
        };
        Ok(Self { files, lists })
    }

    /// Copies a recording; `due` blocks until the next frame is due.
    pub fn replay(
        &self,
        finished: &Path,
        out: &Path,
        due: &mut dyn FnMut(usize, usize),
    ) -> Result<(), WriteError> {
        let mut rest = files_below(finished)?;
        let columns: Vec<Vec<PathBuf>> = self
            .files
            .iter()
            .map(|(folders, part)| take_frame_files(&mut rest, folders, part))
            .collect();
        let mut lists = Vec::new();
        for &(name, head, of_frame) in self.lists {
            rest.remove(Path::new(name));
            let path = finished.join(name);
            let text =
                std::fs::read_to_string(&path).map_err(|source| WriteError::Io { path, source })?;
            let lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
            append(&out.join(name), &lines[..head])?;
            lists.push((out.join(name), lines, head, of_frame));
        }
        for path in rest.keys() {
            copy(finished, out, path)?;
        }
        let n = columns.first().map_or(0, Vec::len);
        for i in 0..n {
            due(i, n);
            columns.iter().try_for_each(|column| copy(finished, out, &column[i]))?;
            for (file, lines, head, of_frame) in &lists {
                append(file, &lines[head + i * of_frame..head + (i + 1) * of_frame])?;
            }
        }
        write_text(&out.join(END_MARKER), "")
    }
}

/// Lists all files below a folder: relative path to (folder, file name).
fn files_below(root: &Path) -> Result<BTreeMap<PathBuf, (String, String)>, WriteError> {
    let mut found = BTreeMap::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(folder) = folders.pop() {
        let io = |source| WriteError::Io { path: root.join(&folder), source };
        for entry in std::fs::read_dir(root.join(&folder)).map_err(io)? {
            let entry = entry.map_err(io)?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = folder.join(&name);
            match entry.path().is_dir() {
                true => folders.push(path),
                false => drop(found.insert(path, (folder.display().to_string(), name))),
            }
        }
    }
    Ok(found)
}

/// Removes the files of one kind from `rest`; returns them in numerical order.
fn take_frame_files(
    rest: &mut BTreeMap<PathBuf, (String, String)>,
    folders: &[&str],
    part: &str,
) -> Vec<PathBuf> {
    let place = |folder: &str| folders.iter().position(|name| *name == folder);
    let mut taken = Vec::new();
    rest.retain(|path, (folder, name)| match place(folder).filter(|_| name.contains(part)) {
        Some(place) => {
            // Numbers are zero-padded, or a shorter name means a smaller number.
            taken.push((place, name.len(), path.clone()));
            false
        }
        None => true,
    });
    taken.sort();
    taken.into_iter().map(|(_, _, path)| path).collect()
}

/// Writes in two parts, as an encoder that streams to disk would.
fn copy(from: &Path, to: &Path, file: &Path) -> Result<(), WriteError> {
    let target = to.join(file);
    let io = |source| WriteError::Io { path: target.clone(), source };
    create_folder(target.parent().unwrap_or(to))?;
    let bytes = std::fs::read(from.join(file)).map_err(io)?;
    let (first, second) = bytes.split_at(bytes.len() / 2);
    let mut out = File::create(&target).map_err(io)?;
    out.write_all(first).and_then(|()| out.write_all(second)).map_err(io)
}

fn append(path: &Path, lines: &[String]) -> Result<(), WriteError> {
    let io = |source| WriteError::Io { path: path.to_owned(), source };
    let mut file = File::options().create(true).append(true).open(path).map_err(io)?;
    file.write_all(lines.concat().as_bytes()).map_err(io)
}
