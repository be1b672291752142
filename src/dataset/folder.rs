//! Reads a dataset's folder without ever leaving it.
//!
//! Datasets are untrusted, and their frame lists contain paths. Such a path is read only if it is
//! inside the folder: `..` and absolute paths are rejected, and so are links whose target is outside.
//! Each folder is listed once; later queries use the listing.
//!
//! While a recording grows, unterminated lines are ignored and frames from earlier polls are skipped.
//! So polling a long recording costs little more than listing its folder.

use super::archive::Archive;
use super::bag::is_bag;
use super::error::{DatasetError, FrameProblem};
use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom};
use std::path::{Component, Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

/// Size limit for pose, split and intrinsics files, bytes. The rest of a longer file is ignored.
const SMALL_TEXT_LIMIT: u64 = 1 << 16;

/// Size limit for trajectories and frame lists, bytes: 128 bytes for each of [`MAX_LINES`] and more.
const TEXT_LIMIT: u64 = 96 << 20;
/// Largest number of lines of a list: poses at 100 Hz for an hour and a half.
const MAX_LINES: usize = 1 << 19;
/// Size limit for a line of a list, bytes.
const MAX_LINE: usize = 1 << 20;
/// Size limit for a text file with bytes that are not UTF-8, bytes.
const MAX_DAMAGED_TEXT: usize = 16 << 20;

pub(super) struct Folder {
    /// Path as given by the user; messages and file paths start with it.
    pub path: PathBuf,
    canonical: PathBuf,
    pub listing: FolderListing,
    only_file: Option<String>,
    recorded: RecordingState,
    // Caches behind `&self`, without locks: one thread opens a dataset.
    listed: RefCell<HashMap<PathBuf, Rc<FolderListing>>>,
    texts: RefCell<BTreeSet<PathBuf>>,
    unread: RefCell<Option<DatasetError>>,
}

#[derive(Clone, Default)]
pub(super) struct RecordingState {
    pub is_growing: bool,
    /// Names of frames that earlier polls delivered; they are not read again.
    pub taken: Arc<HashSet<String>>,
}

pub(super) struct FolderListing {
    // Sorted: the system lists a folder in any order, and frames without a list are ordered by name.
    entries: BTreeMap<String, EntryKind>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum EntryKind {
    File,
    Folder,
    /// A link, whose target is resolved and checked only when the link is used.
    Link,
}

impl Folder {
    pub fn open(path: &Path, recorded: RecordingState) -> Result<Self, DatasetError> {
        let read = |source| DatasetError::Read { path: path.to_owned(), source };
        // Resolved once: the targets of links are compared with the real path.
        let canonical = match path.canonicalize() {
            Ok(canonical) => canonical,
            Err(e) if e.kind() == ErrorKind::NotFound => {
                return Err(DatasetError::NotFound { path: path.to_owned() });
            }
            Err(e) => return Err(read(e)),
        };
        // A disk error here is returned: it does not mean that the path is not a folder.
        let kind = std::fs::metadata(&canonical).map_err(read)?;
        let is_packed = |path: &Path| Ok(Archive::is_zip_archive(path)? || is_bag(path)?);
        if kind.is_file() && is_packed(&canonical).map_err(read)? {
            return Self::of_file(path, &canonical);
        }
        if !kind.is_dir() {
            return Err(DatasetError::not_a_folder(path));
        }
        let listing = FolderListing::read(&canonical).map_err(read)?;
        Ok(Self::new(path, canonical, listing, None, recorded))
    }

    fn of_file(path: &Path, canonical: &Path) -> Result<Self, DatasetError> {
        let not_a_folder = || DatasetError::NotAFolder { path: path.to_owned() };
        let name = path.file_name().and_then(|name| name.to_str()).ok_or_else(not_a_folder)?;
        let parent = canonical.parent().ok_or_else(not_a_folder)?;
        // The archive appears as the only file of its folder, so that layouts need no other way to find it.
        let entries = BTreeMap::from([(name.to_owned(), EntryKind::File)]);
        let (listing, folder) = (FolderListing { entries }, path.parent().unwrap_or(Path::new("")));
        // Archives are written as a whole: no recording that may still grow.
        let recorded = RecordingState::default();
        Ok(Self::new(folder, parent.to_owned(), listing, Some(name.to_owned()), recorded))
    }

    fn new(
        path: &Path,
        canonical: PathBuf,
        listing: FolderListing,
        only_file: Option<String>,
        recorded: RecordingState,
    ) -> Self {
        Self {
            path: path.to_owned(),
            canonical,
            listing,
            only_file,
            recorded,
            listed: RefCell::default(),
            texts: RefCell::default(),
            unread: RefCell::default(),
        }
    }

    pub fn is_growing(&self) -> bool {
        self.recorded.is_growing
    }

    pub fn was_taken(&self, frame: &str) -> bool {
        self.recorded.taken.contains(frame)
    }

    pub fn was_any_taken(&self) -> bool {
        !self.recorded.taken.is_empty()
    }

    /// Returns the paths of all folders listed and text files read so far. Another poll is due when one
    /// of them changes.
    pub fn watched_paths(&self) -> Vec<PathBuf> {
        let folders =
            self.listed.borrow().keys().map(|relative| self.path.join(relative)).collect();
        let texts = self.texts.borrow().iter().cloned().collect();
        [vec![self.path.clone()], folders, texts].concat()
    }

    pub fn opened_archive(&self) -> Option<&str> {
        self.only_file.as_deref()
    }

    pub fn list(&self, relative: &Path) -> Result<Rc<FolderListing>, FrameProblem> {
        if let Some(listing) = self.listed.borrow().get(relative) {
            return Ok(Rc::clone(listing));
        }
        let listing = Rc::new(FolderListing::read(&self.resolve_inside(relative)?)?);
        self.listed.borrow_mut().insert(relative.to_owned(), Rc::clone(&listing));
        Ok(listing)
    }

    /// Lists a folder that may identify a layout. Returns `None` if it does not exist or cannot be read.
    pub fn list_if_any(&self, relative: &str) -> Option<Rc<FolderListing>> {
        let listing = self.list(Path::new(relative));
        listing.map_err(|problem| self.record_unread(relative, problem)).ok()
    }

    /// Returns the path of a listed file; checks that a link does not lead outside the dataset folder.
    pub fn file(
        &self,
        folder: &Path,
        listing: &FolderListing,
        name: &str,
    ) -> Result<PathBuf, FrameProblem> {
        let relative = folder.join(name);
        // Only a link can lead outside: `folder` was checked when it was listed, and `name` is listed.
        // Resolving every frame's path would cost a system call per file.
        if listing.entries.get(name) == Some(&EntryKind::Link) {
            self.resolve_inside(&relative)?;
        }
        Ok(self.path.join(relative))
    }

    /// Reads a text file in the dataset folder; returns its path and text. While the recording grows, an
    /// unterminated last line is removed, because its last number may lack digits.
    ///
    /// # Errors
    /// As [`Self::text`], and more or longer lines than a list has.
    pub fn lines(&self, name: &str) -> Result<(PathBuf, String), DatasetError> {
        let (file, mut text) = self.text(name)?;
        check_lines(&file, &text)?;
        if self.is_growing() {
            text.truncate(text.rfind('\n').map_or(0, |end| end + 1));
        }
        Ok((file, text))
    }

    /// Returns the start of a text file in the dataset folder that may identify a layout. The text is
    /// empty if the file cannot be read.
    pub fn peek(&self, name: &str) -> String {
        self.peek_with(name, read_small_text)
    }

    pub fn peek_whole(&self, name: &str) -> String {
        self.peek_with(name, read_text)
    }

    fn peek_with(&self, name: &str, read: fn(&Path) -> std::io::Result<String>) -> String {
        let path = match name.rsplit_once('/') {
            None => self.file(Path::new(""), &self.listing, name),
            // Listed again, so that a link in the folder below cannot lead outside either.
            Some((below, file)) => {
                let below = Path::new(below);
                self.list(below).and_then(|listing| self.file(below, &listing, file))
            }
        };
        let text = path.and_then(|path| Ok(read(&path)?));
        text.unwrap_or_else(|problem| {
            self.record_unread(name, problem);
            String::new()
        })
    }

    /// Stores the reason why a file that could identify the layout was not read. Missing files, broken
    /// links and files that are not text could not identify a layout and are ignored.
    pub fn record_unread(&self, name: &str, problem: FrameProblem) {
        let is_reported = match &problem {
            FrameProblem::Read(e) => match e.kind() {
                ErrorKind::NotFound | ErrorKind::NotADirectory => false,
                // Errors without a system error code concern files that are not text or too long.
                _ => e.raw_os_error().is_some(),
            },
            FrameProblem::OutsideFolder(_) => true,
            _ => false,
        };
        if is_reported {
            let error = metadata_error(self.path.join(name), problem);
            self.unread.borrow_mut().get_or_insert(error);
        }
    }

    /// Returns a list of poses under any name. The text is empty if the list has more or longer lines than it may
    /// have, or cannot be read.
    pub fn peek_lines(&self, name: &str) -> String {
        let text = self.peek_whole(name);
        match check_lines(&self.path.join(name), &text) {
            Ok(()) => text,
            Err(error) => {
                self.unread.borrow_mut().get_or_insert(error);
                String::new()
            }
        }
    }

    /// Removes and returns the error of the first file that could have identified a layout but was not
    /// read. Without that file, a wrong layout may be recognised, such as images without poses.
    pub fn take_unread(&self) -> Option<DatasetError> {
        self.unread.take()
    }

    pub fn text(&self, name: &str) -> Result<(PathBuf, String), DatasetError> {
        self.opened(name, read_text)
    }

    /// Opens a file in the dataset folder that is read in pieces; returns its path as well.
    pub fn reader(&self, name: &str) -> Result<(PathBuf, BufReader<RetryingFile>), DatasetError> {
        self.opened(name, |path| RetryingFile::open(path).map(BufReader::new))
    }

    fn opened<T>(
        &self,
        name: &str,
        open: impl FnOnce(&Path) -> IoResult<T>,
    ) -> Result<(PathBuf, T), DatasetError> {
        let file = self.path.join(name);
        self.texts.borrow_mut().insert(file.clone());
        let checked = self
            .resolve_inside(Path::new(name))
            .map_err(|problem| metadata_error(file.clone(), problem))?;
        match open(&checked) {
            Ok(content) => Ok((file, content)),
            Err(source) => Err(DatasetError::Read { path: file, source }),
        }
    }

    /// Returns the path of a file that metadata names.
    ///
    /// # Errors
    /// [`FrameProblem::OutsideFolder`] if the path leads outside the folder; [`FrameProblem::Read`] if
    /// nothing exists at the path.
    pub fn resolve_named(&self, text: &str) -> Result<PathBuf, FrameProblem> {
        let relative = relative_path(text)?;
        // As for listed files, only a link has to be resolved. An unlisted name may exist nevertheless:
        // some file systems ignore case.
        let parent = relative.parent().and_then(|parent| self.list(parent).ok());
        let name = relative.file_name().and_then(|name| name.to_str());
        let kind = parent.zip(name).and_then(|(listing, name)| listing.entries.get(name).copied());
        if !matches!(kind, Some(EntryKind::File | EntryKind::Folder)) {
            self.resolve_inside(&relative)?;
        }
        Ok(self.path.join(relative))
    }

    pub fn has_folder(&self, name: &str) -> bool {
        let kind = match name.rsplit_once('/') {
            None => self.listing.entries.get(name).copied(),
            Some((parent, below)) => {
                self.list_if_any(parent).and_then(|listing| listing.entries.get(below).copied())
            }
        };
        match kind {
            Some(EntryKind::Folder) => true,
            Some(EntryKind::Link) => self.path.join(name).is_dir(),
            _ => false,
        }
    }

    pub fn subfolders(&self) -> Vec<String> {
        self.listing.entries.keys().filter(|name| self.has_folder(name)).cloned().collect()
    }

    fn resolve_inside(&self, relative: &Path) -> Result<PathBuf, FrameProblem> {
        let path = self.path.join(relative);
        // One system call, where resolving takes one for each folder: a list may name any number of missing files.
        path.symlink_metadata()?;
        let target = path.canonicalize()?;
        if target.starts_with(&self.canonical) {
            Ok(target)
        } else {
            Err(FrameProblem::OutsideFolder(relative.display().to_string()))
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
                // FIFOs and devices contain no frames, and opening a FIFO may block forever.
                _ => continue,
            };
            // Metadata cannot name a file that is not UTF-8.
            if let Ok(name) = entry.file_name().into_string() {
                entries.insert(name, kind);
            }
        }
        Ok(Self { entries })
    }

    pub fn has_file(&self, name: &str) -> bool {
        matches!(self.entries.get(name), Some(EntryKind::File | EntryKind::Link))
    }

    /// Returns the names of files and links in ascending order.
    pub fn files(&self) -> impl Iterator<Item = &str> {
        self.entries.iter().filter(|(_, k)| **k != EntryKind::Folder).map(|(n, _)| n.as_str())
    }

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

fn metadata_error(file: PathBuf, problem: FrameProblem) -> DatasetError {
    let found = match problem {
        FrameProblem::Read(source) => return DatasetError::Read { path: file, source },
        FrameProblem::OutsideFolder(_) => "a link that leads outside".to_owned(),
        other => other.to_string(),
    };
    DatasetError::Metadata {
        file,
        expected: "a file inside the dataset folder".to_owned(),
        found,
        hint: "copy the file into the folder".to_owned(),
    }
}

/// Checks the lines of a list before anything is allocated for each of them.
fn check_lines(file: &Path, text: &str) -> Result<(), DatasetError> {
    let (n, longest) = text.lines().fold((0, 0), |(n, most), line| (n + 1, line.len().max(most)));
    if longest > MAX_LINE {
        let expected = format!("lines of at most {MAX_LINE} bytes");
        let (found, hint) = (format!("one of {longest}"), "export the list again".to_owned());
        return Err(DatasetError::Metadata { file: file.to_owned(), expected, found, hint });
    }
    check_count(file, "lines", n, MAX_LINES)
}

/// Checks the number of entries of a list, of which `what` is the name.
pub(super) fn check_count(
    file: &Path,
    what: &str,
    found: usize,
    most: usize,
) -> Result<(), DatasetError> {
    match found <= most {
        true => Ok(()),
        false => Err(DatasetError::Metadata {
            file: file.to_owned(),
            expected: format!("at most {most} {what}"),
            found: found.to_string(),
            hint: "split the recording into shorter ones".to_owned(),
        }),
    }
}

pub(super) fn relative_path(text: &str) -> Result<PathBuf, FrameProblem> {
    let escapes = || FrameProblem::OutsideFolder(text.to_owned());
    // Lists exported on Windows name their files with backslashes.
    let forward = text.replace('\\', "/");
    if forward.as_bytes().get(1) == Some(&b':') {
        return Err(escapes()); // other systems do not parse a Windows drive
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

pub(super) fn read_text(path: &Path) -> std::io::Result<String> {
    text_of(read_bytes(path, TEXT_LIMIT)?)
}

/// Returns a text, with U+FFFD for damaged letters, each of which takes up to three times its bytes.
pub(super) fn text_of(bytes: Vec<u8>) -> IoResult<String> {
    match String::from_utf8(bytes) {
        Ok(text) => Ok(text),
        Err(error) if error.as_bytes().len() > MAX_DAMAGED_TEXT => {
            let found = format!("{} bytes that are not UTF-8", error.as_bytes().len());
            Err(Error::new(ErrorKind::InvalidData, found))
        }
        Err(error) => Ok(String::from_utf8_lossy(error.as_bytes()).into_owned()),
    }
}

pub(super) fn read_small_text(path: &Path) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    // Bounded: a pose file of an untrusted dataset may be of any length.
    open_file(path)?.take(SMALL_TEXT_LIMIT).read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Size limit for settings files, bytes. The settings of a day-long recording, with one exposure per
/// frame, are smaller.
const MAX_SETTINGS_BYTES: u64 = 64 << 20;
/// Size limit for an image, a depth file or a confidence map, bytes. It also applies to unpacked members
/// of an archive. A photograph of 100 megapixels is smaller.
pub(super) const MAX_IMAGE_BYTES: u64 = 256 << 20;

/// Opens a regular file for reading. Refuses folders, FIFOs and devices, which could block or never end.
pub(super) fn open_file(path: &Path) -> IoResult<File> {
    // Checked before opening: opening a FIFO blocks until it has a writer.
    match std::fs::metadata(path)?.is_file() {
        true => File::open(path),
        false => Err(Error::other("a folder, FIFO or device where a file was expected")),
    }
}

/// True if the file starts with these bytes. Only disk errors are returned; a short file starts otherwise.
pub(super) fn starts_with<const N: usize>(path: &Path, magic: [u8; N]) -> IoResult<bool> {
    let mut found = [0; N];
    match open_file(path).and_then(|mut file| file.read_exact(&mut found)) {
        Ok(()) => Ok(found == magic),
        Err(e) if e.raw_os_error().is_some() => Err(e),
        Err(_) => Ok(false),
    }
}

/// True if a regular file exists at the path. Disk errors are returned, so that an unreadable file is
/// not mistaken for a missing one.
pub(super) fn is_file(path: &Path) -> IoResult<bool> {
    match std::fs::metadata(path) {
        Ok(metadata) => Ok(metadata.is_file()),
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(false),
        Err(e) => Err(e),
    }
}

/// File that retries reads interrupted by a signal. Such interruptions occur on network drives, and not
/// every decoder retries.
#[derive(Debug)]
pub(super) struct RetryingFile(File);

impl RetryingFile {
    pub fn open(path: &Path) -> IoResult<Self> {
        open_file(path).map(Self)
    }
}

impl Read for RetryingFile {
    fn read(&mut self, bytes: &mut [u8]) -> IoResult<usize> {
        loop {
            match self.0.read(bytes) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                done => return done,
            }
        }
    }
}

impl Seek for RetryingFile {
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        self.0.seek(to)
    }
}

pub(super) fn read_bytes(path: &Path, most: u64) -> IoResult<Vec<u8>> {
    let mut file = open_file(path)?;
    let size = file.metadata()?.len();
    // Checked before allocating the stated size.
    if size > most {
        let (found, most) = (size.div_ceil(1 << 20), most >> 20);
        return Err(Error::other(format!("{found} MiB, above the limit of {most} MiB")));
    }
    let mut bytes = Vec::with_capacity(size as usize);
    // Bounded again: the file may have grown since.
    file.by_ref().take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a settings file as text.
///
/// # Errors
/// The file cannot be read, is not a regular file, is too large, or is not UTF-8.
pub fn read_settings(path: &Path) -> IoResult<String> {
    let bytes = read_bytes(path, MAX_SETTINGS_BYTES)?;
    String::from_utf8(bytes)
        .map_err(|e| Error::new(ErrorKind::InvalidData, format!("text that is not UTF-8 ({e})")))
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
            assert!(matches!(relative_path(text), Err(FrameProblem::OutsideFolder(_))), "{text}");
        }
    }
}
