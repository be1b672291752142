//! A recording whose files are still written: looked at again and again, each time for the frames that
//! became whole since.
//!
//! A look reads the folder as opening does, but passes over the frames that were taken before, ahead of
//! their poses and headers: what is left is the listing and the text of lists. Whether a look is worth
//! it tell the times and lengths of the folders and lists that the last one asked for, a few calls of
//! the system. Events of the system (inotify and its kin) would name the files, but reach neither over
//! networks nor into containers, and a poll would be needed beside them.

use super::Dataset;
use super::entry::{FrameEntry, HELD_OUT};
use super::error::{DatasetError, FrameError, FrameProblem, Warning};
use super::folder::{Folder, Recorded};
use super::formats::Layout;
use super::opened::{no_usable_frame, read};
use super::options::LoadOptions;
use super::whole::{FileMark, FrameMarks};
use std::collections::{HashMap, HashSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The file that a recorder writes last: everything before it is whole.
pub const END_MARKER: &str = "recording.done";

/// Seconds for which a frame that is not whole holds back those behind it, so that all are learnt in
/// their order.
const PATIENCE_S: f64 = 1.0;

/// A recording that may still grow.
pub struct GrowingRecording {
    path: PathBuf,
    options: LoadOptions,
    /// Name of the split that is taken, from the first look on or as asked.
    split: Option<String>,
    layout: Option<Layout>,
    taken: Arc<HashSet<String>>,
    /// When frames were first seen of which files are not whole, seconds.
    unfinished: HashMap<String, f64>,
    /// What files looked like that were whole and could not be read all the same.
    failed: HashMap<String, FrameMarks>,
    /// What the last look read, as it was before.
    asked: Vec<(PathBuf, Option<FileMark>)>,
    /// Whether that had changed since the look before: it may have changed again within a tick of the
    /// file system's clock.
    is_fresh: bool,
    /// Whether something was listed that is no frame yet.
    is_unresolved: bool,
}

impl GrowingRecording {
    /// A recording of which nothing was taken; `split` is the one wanted, if not the one with depth.
    /// The folder need not be there.
    ///
    /// # Errors
    /// An option out of its range, and a file in place of a folder.
    pub fn new(
        path: &Path,
        options: &LoadOptions,
        split: Option<&str>,
    ) -> Result<Self, DatasetError> {
        options.check()?;
        if path.is_file() {
            return Err(DatasetError::NotAFolder { path: path.to_owned() });
        }
        Ok(Self::begin(path, *options, split))
    }

    /// The recording that a dataset was opened from, all of whose frames in `split` are taken; `None`
    /// for frames that come from no folder. The drive is asked nothing, which may have fallen silent since.
    pub fn of(dataset: &Dataset, split: usize) -> Option<Self> {
        let path = dataset.path.as_ref().filter(|_| dataset.is_folder)?;
        let name = &dataset.splits.get(split)?.name;
        // All looks have one origin: zero too, which options leave out, is settled.
        let mut growing = Self::begin(path, dataset.options.settled(), Some(name));
        growing.take(dataset);
        Some(growing)
    }

    fn begin(path: &Path, options: LoadOptions, split: Option<&str>) -> Self {
        Self {
            path: path.to_owned(),
            options,
            split: split.map(str::to_owned),
            layout: None,
            taken: Arc::default(),
            unfinished: HashMap::new(),
            failed: HashMap::new(),
            asked: Vec::new(),
            is_fresh: true,
            is_unresolved: true,
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Whether the recorder wrote its last file.
    pub fn has_ended(&self) -> bool {
        self.path.join(END_MARKER).exists()
    }

    /// Whether folders or lists are not as they were at the last look.
    pub fn has_changed(&self) -> bool {
        self.is_fresh || self.asked.iter().any(|(path, mark)| FileMark::of(path) != *mark)
    }

    /// Whether something was there at the last look that is no whole frame yet, and may become one
    /// without a change of a folder or list.
    pub fn is_unresolved(&self) -> bool {
        self.is_unresolved
    }

    /// Frames of the split that became whole and were not taken before, in their order, as a dataset
    /// that may hold none. If the recording grows no more all are, and what is wrong with others is
    /// told. `now_s` are seconds on any clock that does not go back.
    ///
    /// # Errors
    /// What opening the folder can meet, most of which time mends.
    pub fn look(&mut self, is_growing: bool, now_s: f64) -> Result<Dataset, DatasetError> {
        let found = self.read(is_growing);
        self.is_unresolved = match &found {
            Ok(dataset) => !dataset.warnings.is_empty(),
            Err(_) => true,
        };
        let mut dataset = found?;
        if let Some(layout) = self.layout.filter(|layout| *layout != dataset.layout) {
            let found = format!("{} and {}", layout.name(), dataset.layout.name());
            return Err(DatasetError::TwoLayouts { path: self.path.clone(), found });
        }
        let split = self.split_of(&dataset);
        // Frames that are still written are refused for now; what others hold is not what trains.
        if is_growing && matches!(split, Err(DatasetError::TrainingSplit { .. })) {
            dataset.splits.clear();
        }
        if let Ok(at) = split.as_ref().copied() {
            // Of the frames that are taken, not of those that were found.
            let held_out = dataset.splits.iter_mut().filter(|split| split.name == HELD_OUT);
            held_out.for_each(|split| split.frames.clear());
            if let Some(split) = dataset.splits.get_mut(at) {
                let frames = std::mem::take(&mut split.frames);
                split.frames = match is_growing {
                    true => self.whole(frames, now_s),
                    false => with_depth(frames, &split.name, &mut dataset.warnings),
                };
            }
            dataset.hold_out(at);
        }
        dataset.splits.retain(|split| !split.frames.is_empty());
        if is_growing && !dataset.splits.is_empty() {
            dataset.warnings.clear();
        }
        Ok(dataset)
    }

    /// Why a look found no frame.
    pub fn why_empty(&self, found: Dataset) -> DatasetError {
        match self.unfinished.len() {
            0 => no_usable_frame(&self.path, found.warnings),
            frames => DatasetError::Unfinished { path: self.path.clone(), frames },
        }
    }

    /// Takes what a look has found: these frames are not found again. Their number.
    pub fn take(&mut self, found: &Dataset) -> usize {
        let split = self.split_of(found).ok().and_then(|at| found.splits.get(at));
        let Some(split) = split else { return 0 };
        if !split.frames.is_empty() {
            self.layout = Some(found.layout);
            // The first frames decide where the origin lies.
            self.options =
                LoadOptions { local_origin: found.options.settled().local_origin, ..self.options };
            self.split = Some(split.name.clone());
        }
        let names = split.frames.iter().map(|frame| frame.name.clone());
        Arc::make_mut(&mut self.taken).extend(names);
        split.frames.len()
    }

    /// Whether any frame was taken.
    pub fn has_begun(&self) -> bool {
        !self.taken.is_empty()
    }

    /// Position of the split that is taken.
    ///
    /// # Errors
    /// There is none of that name, or none with depth.
    pub fn split_of(&self, dataset: &Dataset) -> Result<usize, DatasetError> {
        match &self.split {
            Some(name) => dataset.split_named(name),
            None => dataset.training_split(),
        }
    }

    /// Gives back a frame that could not be read: it is found again when its files no longer look so.
    pub fn give_back(&mut self, frame: String, marks: FrameMarks) {
        if Arc::make_mut(&mut self.taken).remove(&frame) {
            self.failed.insert(frame, marks);
            self.is_unresolved = true;
        }
    }

    fn read(&mut self, is_growing: bool) -> Result<Dataset, DatasetError> {
        // Before anything is read: what changes meanwhile is found by the next look.
        let marks = self.asked.iter().map(|(path, _)| (path.clone(), FileMark::of(path)));
        let marks: HashMap<PathBuf, Option<FileMark>> = marks.collect();
        self.is_fresh = self.asked.iter().any(|(path, mark)| marks.get(path) != Some(mark));
        let recorded = Recorded { is_growing, taken: Arc::clone(&self.taken) };
        let folder = Folder::open(&self.path, recorded)?;
        let dataset = read(&folder, &self.path, &self.options);
        self.asked.clear();
        for path in folder.asked() {
            let mark = marks.get(&path).cloned();
            self.is_fresh |= mark.is_none();
            self.asked.push((path.clone(), mark.unwrap_or_else(|| FileMark::of(&path))));
        }
        dataset
    }

    /// The frames that are whole, up to one that others have to wait for.
    fn whole(&mut self, frames: Vec<FrameEntry>, now_s: f64) -> Vec<FrameEntry> {
        let is_first = self.taken.is_empty();
        let mut whole = Vec::new();
        for frame in frames {
            let has_failed = self.failed.get(&frame.name).is_some_and(|old| *old == frame.marks());
            if !has_failed && frame.depth_path().is_some() && frame.is_whole() {
                self.unfinished.remove(&frame.name);
                whole.push(frame);
                continue;
            }
            self.is_unresolved = true;
            let since = *self.unfinished.entry(frame.name).or_insert(now_s);
            // Of a recording that was begun before, nothing is held back: what is not whole by now may
            // never be.
            if !is_first && !has_failed && now_s - since < PATIENCE_S {
                break;
            }
        }
        whole
    }
}

/// Frames that can be learnt; the others are told.
fn with_depth(
    frames: Vec<FrameEntry>,
    split: &str,
    warnings: &mut Vec<Warning>,
) -> Vec<FrameEntry> {
    let (with, without): (Vec<_>, Vec<_>) =
        frames.into_iter().partition(|frame| frame.depth_path().is_some());
    warnings.extend(without.into_iter().map(|frame| {
        let file = frame.color_path().map(Path::to_owned).unwrap_or_default();
        let problem = FrameProblem::MissingDepth(format!("of frame {}", frame.name));
        let error = Arc::new(FrameError { file, frame: frame.name, problem });
        Warning { split: split.to_owned(), error }
    }));
    with
}
