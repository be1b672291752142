//! Reading a dataset's folder without ever leaving it.
//!
//! A dataset may come from anywhere, and its frame lists name files. What they name is read only
//! if it lies inside the folder: parents and absolute paths are refused by their text, links by
//! where they lead. A folder is listed once and then asked by name.
//!
//! A recording may still grow. Then a line counts once it is ended, and frames that were taken
//! before are passed over, so that a look at a long recording costs little more than its listing.

use super::archive::Archive;
use super::error::{DatasetError, FrameProblem};
use super::files::{bytes_of, open_file};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::io::{ErrorKind, Read};
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// No pose, split or intrinsics file is longer; the rest of a longer one is not read.
const SMALL_TEXT_LIMIT: u64 = 1 << 16;

/// Trajectories and frame lists of a day's recording are shorter.
const TEXT_LIMIT: u64 = 256 << 20;

/// The root of a dataset.
pub(super) struct Folder {
    /// As the user gave it; messages and file paths start with it.
    pub path: PathBuf,
    canonical: PathBuf,
    /// What the root holds.
    pub listing: FolderListing,
    only_file: Option<String>,
    recorded: Recorded,
    listed: RefCell<HashMap<PathBuf, Rc<FolderListing>>>,
    texts: RefCell<BTreeSet<PathBuf>>,
    unread: RefCell<Option<DatasetError>>,
}

/// How far a recording has come.
#[derive(Clone, Default)]
pub(super) struct Recorded {
    /// Whether files may still grow.
    pub is_growing: bool,
    /// Names of frames that were taken before and are not asked for again.
    pub taken: Arc<HashSet<String>>,
}

/// What one folder holds, by name.
pub(super) struct FolderListing {
    // Sorted: a system lists a folder in any order, and frames without a list come in that of
    // names.
    entries: BTreeMap<String, EntryKind>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum EntryKind {
    File,
    Folder,
    /// Followed, and checked, only when it is used.
    Link,
}

impl Folder {
    /// Opens and lists the root of a recording that has come so far.
    pub fn open(path: &Path, recorded: Recorded) -> Result<Self, DatasetError> {
        let read = |source| DatasetError::Read { path: path.to_owned(), source };
        // Resolved once: where links lead is compared with where the folder really is.
        let canonical = match path.canonicalize() {
            Ok(canonical) => canonical,
            Err(e) if e.kind() == ErrorKind::NotFound => {
                return Err(DatasetError::NotFound { path: path.to_owned() });
            }
            Err(e) => return Err(read(e)),
        };
        // Asked once and out loud: a disk that does not tell is no answer that it is no folder.
        let kind = std::fs::metadata(&canonical).map_err(read)?;
        if kind.is_file() && Archive::is_one(&canonical).map_err(read)? {
            return Self::of_file(path, &canonical);
        }
        if !kind.is_dir() {
            return Err(DatasetError::NotAFolder { path: path.to_owned() });
        }
        let listing = FolderListing::read(&canonical).map_err(read)?;
        Ok(Self {
            path: path.to_owned(),
            canonical,
            listing,
            only_file: None,
            recorded,
            listed: RefCell::default(),
            texts: RefCell::default(),
            unread: RefCell::default(),
        })
    }

    /// The folder of an archive, as if it held nothing else.
    fn of_file(path: &Path, canonical: &Path) -> Result<Self, DatasetError> {
        let not_a_folder = || DatasetError::NotAFolder { path: path.to_owned() };
        let name = path.file_name().and_then(|name| name.to_str()).ok_or_else(not_a_folder)?;
        let parent = canonical.parent().ok_or_else(not_a_folder)?;
        let entries = BTreeMap::from([(name.to_owned(), EntryKind::File)]);
        Ok(Self {
            path: path.parent().unwrap_or(Path::new("")).to_owned(),
            canonical: parent.to_owned(),
            listing: FolderListing { entries },
            only_file: Some(name.to_owned()),
            recorded: Recorded::default(),
            listed: RefCell::default(),
            texts: RefCell::default(),
            unread: RefCell::default(),
        })
    }

    /// Whether files may still grow: what is not there yet may come.
    pub fn is_growing(&self) -> bool {
        self.recorded.is_growing
    }

    /// Whether a frame was taken before.
    pub fn has_taken(&self, frame: &str) -> bool {
        self.recorded.taken.contains(frame)
    }

    /// Whether any frame was taken before.
    pub fn has_taken_any(&self) -> bool {
        !self.recorded.taken.is_empty()
    }

    /// Folders that were listed and texts that were read, as far as their frames go beyond one.
    pub fn asked(&self) -> Vec<PathBuf> {
        let folders =
            self.listed.borrow().keys().map(|relative| self.path.join(relative)).collect();
        let texts = self.texts.borrow().iter().cloned().collect();
        [vec![self.path.clone()], folders, texts].concat()
    }

    /// The archive that was opened in place of a folder.
    pub fn only_file(&self) -> Option<&str> {
        self.only_file.as_deref()
    }

    /// What a folder below the root holds; it is listed when it is first asked for.
    pub fn list(&self, relative: &Path) -> Result<Rc<FolderListing>, FrameProblem> {
        if let Some(listing) = self.listed.borrow().get(relative) {
            return Ok(Rc::clone(listing));
        }
        let listing = Rc::new(FolderListing::read(&self.inside(relative)?)?);
        self.listed.borrow_mut().insert(relative.to_owned(), Rc::clone(&listing));
        Ok(listing)
    }

    /// The path of a listed file, checked if it is a link.
    pub fn file(
        &self,
        folder: &Path,
        listing: &FolderListing,
        name: &str,
    ) -> Result<PathBuf, FrameProblem> {
        let relative = folder.join(name);
        // Only a link can lead out: `folder` was checked when it was listed, and `name` is listed.
        // Resolving every frame's path would ask the system once a file.
        if listing.entries.get(name) == Some(&EntryKind::Link) {
            self.inside(&relative)?;
        }
        Ok(self.path.join(relative))
    }

    /// The lines of a list below the root; of one that may still grow those that are ended: the
    /// last number of a line that is not could lack digits.
    pub fn lines(&self, name: &str) -> Result<(PathBuf, String), DatasetError> {
        let (file, mut text) = self.text(name)?;
        if self.is_growing() {
            text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        }
        Ok((file, text))
    }

    /// The start of a text below the root by which a layout may be told; empty where there is none.
    pub fn peek(&self, name: &str) -> String {
        self.peek_by(name, read_small_text)
    }

    /// The same to its end.
    pub fn peek_whole(&self, name: &str) -> String {
        self.peek_by(name, read_text)
    }

    fn peek_by(&self, name: &str, read: fn(&Path) -> std::io::Result<String>) -> String {
        let path = self.file(Path::new(""), &self.listing, name);
        let text = path.and_then(|path| Ok(read(&path)?));
        text.unwrap_or_else(|problem| {
            self.not_read(name, problem);
            String::new()
        })
    }

    /// Keeps why a file of the root was not read that a layout might have been told by. One that is not
    /// there, or a link that leads nowhere, is no file that anything could be told by, and neither is what
    /// is no text.
    pub fn not_read(&self, name: &str, problem: FrameProblem) {
        let is_told = match &problem {
            FrameProblem::Read(e) => match e.kind() {
                ErrorKind::NotFound | ErrorKind::NotADirectory => false,
                // Errors that the system has no number for are of what is no text or far too long.
                _ => e.raw_os_error().is_some(),
            },
            FrameProblem::Escapes(_) => true,
            _ => false,
        };
        if is_told {
            let error = refused(self.path.join(name), problem);
            self.unread.borrow_mut().get_or_insert(error);
        }
    }

    /// What kept the first file from being read that a layout might have been told by. Whatever was
    /// recognised without it may be another recording: of images without their poses, say.
    pub fn unread(&self) -> Option<DatasetError> {
        self.unread.take()
    }

    /// The text of a metadata file below the root, whole.
    pub fn text(&self, name: &str) -> Result<(PathBuf, String), DatasetError> {
        let file = self.path.join(name);
        self.texts.borrow_mut().insert(file.clone());
        let checked =
            self.inside(Path::new(name)).map_err(|problem| refused(file.clone(), problem))?;
        match read_text(&checked) {
            Ok(text) => Ok((file, text)),
            Err(source) => Err(DatasetError::Read { path: file, source }),
        }
    }

    /// The path of a file that metadata names.
    ///
    /// # Errors
    /// A path that leads out of the folder, or to nothing: [`FrameProblem::Read`].
    pub fn named(&self, text: &str) -> Result<PathBuf, FrameProblem> {
        let relative = relative_path(text)?;
        // As for listed files: only a link needs a look at where it leads. What is not listed by this
        // very name may be all the same, where systems do not tell large letters from small ones.
        let parent = relative.parent().and_then(|parent| self.list(parent).ok());
        let name = relative.file_name().and_then(|name| name.to_str());
        let kind = parent.zip(name).and_then(|(listing, name)| listing.entries.get(name).copied());
        if !matches!(kind, Some(EntryKind::File | EntryKind::Folder)) {
            self.inside(&relative)?;
        }
        Ok(self.path.join(relative))
    }

    /// Whether there is a folder of that name in the root; a link that leads to one counts.
    pub fn has_folder(&self, name: &str) -> bool {
        match self.listing.entries.get(name) {
            Some(EntryKind::Folder) => true,
            Some(EntryKind::Link) => self.path.join(name).is_dir(),
            _ => false,
        }
    }

    /// Names of the folders in the root; links that lead to folders count.
    pub fn subfolders(&self) -> Vec<String> {
        self.listing.entries.keys().filter(|name| self.has_folder(name)).cloned().collect()
    }

    fn inside(&self, relative: &Path) -> Result<PathBuf, FrameProblem> {
        let target = self.path.join(relative).canonicalize()?;
        if target.starts_with(&self.canonical) {
            Ok(target)
        } else {
            Err(FrameProblem::Escapes(relative.display().to_string()))
        }
    }
}

impl FolderListing {
    fn read(folder: &Path) -> std::io::Result<Self> {
        let mut entries = BTreeMap::new();
        for entry in std::fs::read_dir(folder)? {
            let entry = entry?;
            let kind = entry.file_type()?;
            let kind = match (kind.is_symlink(), kind.is_dir(), kind.is_file()) {
                (true, _, _) => EntryKind::Link,
                (_, true, _) => EntryKind::Folder,
                (_, _, true) => EntryKind::File,
                // FIFOs and devices hold no frames: whoever opens one may wait for ever.
                _ => continue,
            };
            // What is no UTF-8 no metadata can name.
            if let Ok(name) = entry.file_name().into_string() {
                entries.insert(name, kind);
            }
        }
        Ok(Self { entries })
    }

    /// Whether there is a file (or link) of that name.
    pub fn has_file(&self, name: &str) -> bool {
        matches!(self.entries.get(name), Some(EntryKind::File | EntryKind::Link))
    }

    /// Names of files and links, ascending.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().filter(|(_, k)| **k != EntryKind::Folder).map(|(n, _)| n.as_str())
    }

    /// A few words on the content, for messages.
    pub fn summary(&self) -> String {
        let n_folders = self.entries.values().filter(|k| **k == EntryKind::Folder).count();
        let mut names: Vec<&str> = self.entries.keys().take(4).map(String::as_str).collect();
        if self.entries.is_empty() {
            return "an empty folder".to_owned();
        }
        if self.entries.len() > names.len() {
            names.push("…");
        }
        let n_files = self.entries.len() - n_folders;
        format!("{n_files} files and {n_folders} folders ({})", names.join(", "))
    }
}

/// What is wrong with a file of metadata that is not read.
fn refused(file: PathBuf, problem: FrameProblem) -> DatasetError {
    let found = match problem {
        FrameProblem::Read(source) => return DatasetError::Read { path: file, source },
        FrameProblem::Escapes(_) => "a link that leads outside".to_owned(),
        other => other.to_string(),
    };
    DatasetError::Metadata {
        file,
        expected: "a file inside the dataset folder".to_owned(),
        found,
        hint: "copy the file into the folder".to_owned(),
    }
}

/// Turns a path from a dataset file into a clean relative one.
pub(super) fn relative_path(text: &str) -> Result<PathBuf, FrameProblem> {
    let escapes = || FrameProblem::Escapes(text.to_owned());
    // Lists exported on Windows name their files with backslashes.
    let forward = text.replace('\\', "/");
    if forward.as_bytes().get(1) == Some(&b':') {
        return Err(escapes()); // a Windows drive is no component elsewhere
    }
    let mut clean = PathBuf::new();
    for component in Path::new(&forward).components() {
        match component {
            Component::CurDir => {}
            Component::Normal(name) => clean.push(name),
            Component::ParentDir | Component::RootDir | Component::Prefix(_) => {
                return Err(escapes());
            }
        }
    }
    Ok(clean)
}

/// A whole text file; bytes that are no UTF-8 become replacement characters.
pub(super) fn read_text(path: &Path) -> std::io::Result<String> {
    Ok(String::from_utf8_lossy(&bytes_of(path, TEXT_LIMIT)?).into_owned())
}

/// The start of a small text file; bytes that are no UTF-8 become replacement characters.
pub(super) fn read_small_text(path: &Path) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    // Bounded: what a foreign dataset calls a pose may be of any length.
    open_file(path)?.take(SMALL_TEXT_LIMIT).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_relative_paths_without_parents_pass() {
        for (text, clean) in
            [("./test/r_0", Some("test/r_0")), ("a\\b.png", Some("a/b.png")), ("x", Some("x"))]
        {
            assert_eq!(relative_path(text).ok(), clean.map(PathBuf::from), "{text}");
        }
        for text in ["../x", "a/../../x", "/etc/passwd", "C:\\x.png", "..\\x", "\\\\host\\x"] {
            assert!(matches!(relative_path(text), Err(FrameProblem::Escapes(_))), "{text}");
        }
    }
}
