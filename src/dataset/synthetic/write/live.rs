//! Replay of a written recording: its files appear in another folder, one frame at a time.

use super::{WriteError, create_folder, write_file};
use crate::dataset::growing::END_MARKER;
use crate::dataset::synthetic::write::SyntheticLayout;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// Files of a layout that grow during a recording, by one frame at a time. All other files exist from
/// the start.
#[derive(Clone, Copy, Debug)]
pub struct LiveFiles {
    /// Kinds of files with one file per frame. Each kind has its folders, in order, and a part of its
    /// file names.
    pub files: &'static [(&'static [&'static str], &'static str)],
    /// Lists of frames: file name, number of header lines, and number of lines per frame.
    pub lists: &'static [(&'static str, usize, usize)],
}

const LIVE: &str = "seven-scenes, tum";
const SPLITS: &[&str] = &["train", "eval"];

impl LiveFiles {
    /// Returns the growing files of a layout.
    ///
    /// # Errors
    /// [`WriteError::NotLive`] if the layout lists its frames in a file that is written at the end.
    pub fn of(layout: SyntheticLayout) -> Result<Self, WriteError> {
        match layout {
            SyntheticLayout::SevenScenes => Ok(Self {
                files: &[(SPLITS, ".color."), (SPLITS, ".depth."), (SPLITS, ".pose.")],
                lists: &[],
            }),
            SyntheticLayout::Tum => Ok(Self {
                files: &[(&["rgb"], ""), (&["depth"], "")],
                lists: &[("rgb.txt", 1, 1), ("depth.txt", 1, 1), ("groundtruth.txt", 1, 1)],
            }),
            SyntheticLayout::Blender(_) | SyntheticLayout::Record3d => {
                Err(WriteError::NotLive { layout: format!("{layout:?}"), expected: LIVE })
            }
        }
    }

    /// Copies the recording `finished` into `out`, one frame at a time, and the end marker last. `due`
    /// is called before each frame and blocks until the frame is due. It receives the frame's index from
    /// 0 and the total.
    ///
    /// # Errors
    /// Fails if a file cannot be read or written.
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
            // Lists grow line by line and are not copied whole.
            rest.remove(Path::new(name));
            let path = finished.join(name);
            let text =
                std::fs::read_to_string(&path).map_err(|source| WriteError::Io { path, source })?;
            let lines: Vec<String> = text.split_inclusive('\n').map(str::to_owned).collect();
            append(&out.join(name), &lines[..head])?;
            lists.push((out.join(name), lines, head, of_frame));
        }
        // What does not grow, such as intrinsics, precedes all frames.
        rest.iter().try_for_each(|path| copy(finished, out, path))?;
        // Every kind of file has one file per frame.
        let n = columns.first().map_or(0, Vec::len);
        for i in 0..n {
            due(i, n);
            // Images before list lines, so that a listed image exists.
            columns.iter().try_for_each(|column| copy(finished, out, &column[i]))?;
            for (file, lines, head, of_frame) in &lists {
                append(file, &lines[head + i * of_frame..head + (i + 1) * of_frame])?;
            }
        }
        write_file(&out.join(END_MARKER), "")
    }
}

/// Returns the files of a folder and its subfolders, with paths relative to the folder.
fn files_below(root: &Path) -> Result<BTreeSet<PathBuf>, WriteError> {
    let mut found = BTreeSet::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(folder) = folders.pop() {
        let io = |source| WriteError::Io { path: root.join(&folder), source };
        for entry in std::fs::read_dir(root.join(&folder)).map_err(io)? {
            let entry = entry.map_err(io)?;
            let path = folder.join(entry.file_name());
            match entry.path().is_dir() {
                true => folders.push(path),
                false => drop(found.insert(path)),
            }
        }
    }
    Ok(found)
}

/// Removes the files of one kind from `rest`, and returns them in numerical order.
fn take_frame_files(rest: &mut BTreeSet<PathBuf>, folders: &[&str], part: &str) -> Vec<PathBuf> {
    let key = |path: &PathBuf| {
        let name = path.file_name()?.to_str().filter(|name| name.contains(part))?;
        let place = folders.iter().position(|folder| path.parent() == Some(Path::new(folder)))?;
        // Numbers are zero-padded, or a shorter name means a smaller number.
        Some((place, name.len(), path.clone()))
    };
    let mut taken: Vec<_> = rest.iter().filter_map(key).collect();
    rest.retain(|path| key(path).is_none());
    taken.sort();
    taken.into_iter().map(|(_, _, path)| path).collect()
}

/// Copies a file in two parts, like an encoder that streams to disk.
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
