//! A recording that is still being written. Each poll returns the frames completed since the previous
//! one.
//!
//! A poll reads the folder as opening does, but skips frames that were already taken. Their poses and
//! headers are not read; only folders are listed and frame lists read. Changes of the modification
//! times or sizes of these folders and lists trigger another poll. File system events (such as inotify)
//! would name the changed files, but do not work over networks or into containers. Polling would be
//! needed anyway.

use super::decode::CodeKind;
use super::entry::{FrameEntry, FrameSource, HELD_OUT};
use super::error::{DatasetError, FrameError, FrameProblem, Warning};
use super::folder::{Folder, RecordingState, open_file};
use super::formats::Layout;
use super::opened::{no_usable_frame, read};
use super::options::{ByteSource, LoadOptions};
use super::splits::is_for_training;
use super::{Dataset, decode};
use std::collections::{HashMap, HashSet};
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

/// Name of the file that a recorder writes last, when all other files are complete.
pub const END_MARKER: &str = "recording.done";

/// Longest time, seconds, for which an incomplete frame delays later frames, so that frames are trained
/// in order.
const MAX_DELAY_S: f64 = 1.0;

/// Recording that may still be written, polled for frames that became complete.
pub struct GrowingRecording {
    path: PathBuf,
    options: LoadOptions,
    split: Option<String>,
    layout: Option<Layout>,
    taken: Arc<HashSet<String>>,
    /// Time at which each incomplete frame was first listed, seconds, by frame name.
    unfinished: HashMap<String, f64>,
    /// Modification times and sizes of the files of frames that were complete but could not be read, by
    /// frame name.
    unreadable: HashMap<String, FrameMarks>,
    /// Paths that the last poll read, with their modification times and sizes from before that poll.
    polled: Vec<(PathBuf, Option<FileMark>)>,
    /// True if the last poll found changes. The files may have changed again within one tick of the file
    /// system's clock, so another poll is due.
    has_recent_changes: bool,
    is_unresolved: bool,
}

impl GrowingRecording {
    /// Starts following a recording from its first frame. Polls return frames of `split`, or of the
    /// split with depth if `split` is `None`. The folder may be created later.
    ///
    /// # Errors
    /// An option out of range, or a file in place of a folder.
    pub fn new(
        path: &Path,
        options: &LoadOptions,
        split: Option<&str>,
    ) -> Result<Self, DatasetError> {
        options.check()?;
        // A missing folder is allowed: following may start before the recorder.
        if path.is_file() {
            return Err(DatasetError::not_a_folder(path));
        }
        Ok(Self::begin(path, *options, split))
    }

    /// Follows the recording of an opened dataset after its last frame: frames of `split` in the
    /// dataset are marked as taken ([`Self::mark_taken`]). Returns `None` if the dataset was not read
    /// from a folder. Does not access the drive, which may no longer respond.
    pub fn of(dataset: &Dataset, split: usize) -> Option<Self> {
        let path = dataset.path.as_ref().filter(|_| dataset.is_folder)?;
        let name = &dataset.splits.get(split)?.name;
        // All polls share one origin. A zero origin, which the options leave open, is therefore fixed as
        // well.
        let mut growing = Self::begin(path, dataset.options.with_fixed_origin(), Some(name));
        growing.mark_taken(dataset);
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
            unreadable: HashMap::new(),
            polled: Vec::new(),
            // The first poll is always due.
            has_recent_changes: true,
            is_unresolved: true,
        }
    }

    /// Returns the folder of the recording.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// True if the recorder has written the file [`END_MARKER`].
    pub fn has_ended(&self) -> bool {
        self.path.join(END_MARKER).exists()
    }

    /// True if folders or frame lists have changed since the last poll.
    pub fn has_changed(&self) -> bool {
        self.has_recent_changes
            || self.polled.iter().any(|(path, mark)| FileMark::of(path) != *mark)
    }

    /// True if the last poll failed, or found a frame that is incomplete or unusable. The frame may
    /// become usable without a change of a folder or frame list.
    pub fn is_unresolved(&self) -> bool {
        self.is_unresolved
    }

    /// Reads the recording and returns a dataset of new frames, in order; it may have no frames. New
    /// frames are complete frames of the followed split that are not marked as taken
    /// ([`Self::mark_taken`]). Once the recording has ended (`is_growing` false), all frames not yet
    /// taken are returned, and defects become warnings. `now_s` is a monotonic time in seconds.
    ///
    /// # Errors
    /// Errors of opening the folder. Most errors vanish as the recording grows.
    pub fn poll(&mut self, is_growing: bool, now_s: f64) -> Result<Dataset, DatasetError> {
        let found = self.read(is_growing);
        self.is_unresolved = match &found {
            Ok(dataset) => !dataset.warnings.is_empty(),
            Err(_) => true,
        };
        // Returned only after `is_unresolved` is set, because an error may vanish as the recording
        // grows.
        let mut dataset = found?;
        if let Some(layout) = self.layout.filter(|layout| *layout != dataset.layout) {
            let found = format!("{} and {}", layout.name(), dataset.layout.name());
            return Err(DatasetError::TwoLayouts { path: self.path.clone(), found });
        }
        let split = self.split_of(&dataset);
        // Every frame may still be incomplete; the other splits must not be used for training instead.
        if is_growing && matches!(split, Err(DatasetError::TrainingSplit { .. })) {
            dataset.splits.clear();
        }
        // The split for training may appear after one for evaluation.
        let chosen = split.as_ref().ok().and_then(|at| dataset.splits.get(*at));
        let other = chosen.filter(|split| self.split.is_none() && !is_for_training(split));
        if let Some(other) = other.filter(|_| is_growing) {
            return Err(DatasetError::TrainingSplit {
                path: self.path.clone(),
                split: "train".to_owned(),
                found: format!("frames of `{}` alone", other.name),
            });
        }
        if let Ok(at) = split.as_ref().copied() {
            // Frames are held out of those taken, not of those found.
            let held_out = dataset.splits.iter_mut().filter(|split| split.name == HELD_OUT);
            held_out.for_each(|split| split.frames.clear());
            if let Some(split) = dataset.splits.get_mut(at) {
                let frames = std::mem::take(&mut split.frames);
                split.frames = match is_growing {
                    true => self.complete_frames(frames, now_s),
                    false => with_depth(frames, &split.name, &mut dataset.warnings),
                };
            }
            dataset.extend_held_out(at);
        }
        dataset.splits.retain(|split| !split.frames.is_empty());
        // While the recording grows, an incomplete file is not a defect yet.
        if is_growing && !dataset.splits.is_empty() {
            dataset.warnings.clear();
        }
        Ok(dataset)
    }

    /// Returns an error that explains why a poll found no frame; `found` is the result of the poll.
    pub fn empty_poll_error(&self, found: Dataset) -> DatasetError {
        match self.unfinished.len() {
            0 => no_usable_frame(&self.path, found.warnings),
            frames => DatasetError::Unfinished { path: self.path.clone(), frames },
        }
    }

    /// Marks the frames of a poll as taken, so that later polls skip them; returns their number.
    pub fn mark_taken(&mut self, found: &Dataset) -> usize {
        let split = self.split_of(found).ok().and_then(|at| found.splits.get(at));
        let Some(split) = split else { return 0 };
        if !split.frames.is_empty() {
            self.layout = Some(found.layout);
            // The first frames determine the local origin.
            self.options = LoadOptions {
                local_origin: found.options.with_fixed_origin().local_origin,
                ..self.options
            };
            self.split = Some(split.name.clone());
        }
        let names = split.frames.iter().map(|frame| frame.name.clone());
        Arc::make_mut(&mut self.taken).extend(names);
        split.frames.len()
    }

    /// Returns true if any frame has been handed out for training.
    pub fn has_begun(&self) -> bool {
        !self.taken.is_empty()
    }

    /// Returns the name of the followed split; `None` until it is chosen.
    pub fn split(&self) -> Option<&str> {
        self.split.as_deref()
    }

    /// Returns the index of the followed split in a dataset.
    ///
    /// # Errors
    /// The dataset has no split of that name, or no split with depth.
    pub fn split_of(&self, dataset: &Dataset) -> Result<usize, DatasetError> {
        match &self.split {
            Some(name) => dataset.split_named(name),
            None => dataset.training_split(),
        }
    }

    /// Marks a frame as not taken, because it could not be read. Polls return the frame again once its
    /// files differ from `marks`.
    pub fn return_frame(&mut self, frame: String, marks: FrameMarks) {
        if Arc::make_mut(&mut self.taken).remove(&frame) {
            self.unreadable.insert(frame, marks);
            self.is_unresolved = true;
        }
    }

    fn read(&mut self, is_growing: bool) -> Result<Dataset, DatasetError> {
        // Marks are read first, so that the next poll detects changes made during this one.
        let marks = self.polled.iter().map(|(path, _)| (path.clone(), FileMark::of(path)));
        let marks: HashMap<PathBuf, Option<FileMark>> = marks.collect();
        self.has_recent_changes =
            self.polled.iter().any(|(path, mark)| marks.get(path) != Some(mark));
        let recorded = RecordingState { is_growing, taken: Arc::clone(&self.taken) };
        let folder = Folder::open(&self.path, recorded)?;
        let dataset = read(&folder, &self.path, &self.options);
        self.polled.clear();
        for path in folder.watched_paths() {
            let mark = marks.get(&path).cloned();
            self.has_recent_changes |= mark.is_none();
            self.polled.push((path.clone(), mark.unwrap_or_else(|| FileMark::of(&path))));
        }
        dataset
    }

    /// Returns the complete frames before the first incomplete frame that still delays later frames.
    fn complete_frames(&mut self, frames: Vec<FrameEntry>, now_s: f64) -> Vec<FrameEntry> {
        let is_first = self.taken.is_empty();
        let mut whole = Vec::new();
        for frame in frames {
            let has_failed =
                self.unreadable.get(&frame.name).is_some_and(|old| *old == frame.marks());
            if !has_failed && frame.depth_path().is_some() && frame.is_complete() {
                self.unfinished.remove(&frame.name);
                whole.push(frame);
                continue;
            }
            self.is_unresolved = true;
            let since = *self.unfinished.entry(frame.name).or_insert(now_s);
            // In a recording that began before, the first poll delays nothing: files incomplete by now may
            // never be completed.
            if !is_first && !has_failed && now_s - since < MAX_DELAY_S {
                break;
            }
        }
        whole
    }
}

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

const PNG: [u8; 8] = *b"\x89PNG\r\n\x1a\n";
/// Final chunk of a PNG file: length 0, name and checksum.
const PNG_END: [u8; 12] = *b"\0\0\0\0IEND\xaeB`\x82";
const JPEG: [u8; 2] = [0xFF, 0xD8];

impl FrameEntry {
    pub(super) fn is_complete(&self) -> bool {
        let FrameSource::Files(files) = &self.source else { return true };
        let is_seen =
            is_whole(&files.color) && files.mask.as_ref().is_none_or(|mask| is_whole(&mask.file));
        let Some(depth) = files.depth.as_ref().filter(|_| is_seen) else { return is_seen };
        // Files without a header may start with any bytes, also those of an image.
        let is_bare = depth.encoding.codes == CodeKind::BareFloats;
        let depth_ends = if is_bare { None } else { has_image_end(depth.file.path()) };
        let map_ends = depth.confidence.as_ref().map(|(map, _)| has_image_end(map.path()));
        match (depth_ends, map_ends) {
            (Some(false), _) | (_, Some(Some(false))) => false,
            (Some(true), None | Some(Some(true))) => true,
            // Values without a header and arrays have a length but no end marker. Other defects do not
            // vanish as the file grows.
            _ => !self.load_depth().is_err_and(|error| may_still_grow(&error.problem)),
        }
    }

    /// Returns the current modification times and sizes of the frame's files.
    pub fn marks(&self) -> FrameMarks {
        FrameMarks(self.files().filter_map(FileMark::of).collect())
    }
}

/// Modification time and size of each existing file of a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FrameMarks(Vec<FileMark>);

impl FrameMarks {
    /// Returns the latest modification time of the files, measured from 1970 by the file system's
    /// clock. `None` if it is unknown.
    pub fn last_modified(&self) -> Option<Duration> {
        self.0.iter().filter_map(|mark| mark.changed).max()
    }
}

/// Modification time and size, by which a change of a file or folder is detected.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FileMark {
    bytes: u64,
    /// Modification time, measured from 1970; `None` if unknown.
    changed: Option<Duration>,
}

impl FileMark {
    pub fn of(path: &Path) -> Option<Self> {
        let metadata = path.metadata().ok()?;
        let changed = metadata.modified().ok().and_then(|at| at.duration_since(UNIX_EPOCH).ok());
        Some(Self { bytes: metadata.len(), changed })
    }
}

fn is_whole(color: &ByteSource) -> bool {
    match color {
        ByteSource::File(path) => has_image_end(path).unwrap_or(false),
        // The placeholder of a missing photograph needs no file.
        ByteSource::Grey(_) => true,
        // Videos, archives and bags are read only once the recording has ended.
        ByteSource::VideoFrame { .. } | ByteSource::Member { .. } | ByteSource::Message(_) => false,
    }
}

/// True if a PNG or JPEG file contains its end marker; `None` for files of other formats.
fn has_image_end(path: &Path) -> Option<bool> {
    let Ok(mut file) = open_file(path) else { return Some(false) };
    let mut head = Vec::new();
    if file.by_ref().take(PNG.len() as u64).read_to_end(&mut head).is_err() || head.is_empty() {
        return Some(false);
    }
    if head == PNG {
        let mut end = [0; PNG_END.len()];
        let read = file
            // From the end: only the last bytes are read, however large the file is.
            .seek(SeekFrom::End(-(PNG_END.len() as i64)))
            .and_then(|_| file.read_exact(&mut end));
        return Some(read.is_ok() && end == PNG_END);
    }
    if head.starts_with(&JPEG) {
        // The whole file: phones append data after the end marker.
        let ends = file.read_to_end(&mut head).is_ok() && decode::has_jpeg_end(&head);
        return Some(ends);
    }
    // A file shorter than the signature may become either format.
    let is_begun = PNG.starts_with(&head) || JPEG.starts_with(&head);
    is_begun.then_some(false)
}

fn may_still_grow(problem: &FrameProblem) -> bool {
    // A file cut off in the middle gives one of these errors, depending on its decoder.
    matches!(
        problem,
        FrameProblem::Read(_)
            | FrameProblem::Decode(_)
            | FrameProblem::DepthFile { .. }
            | FrameProblem::TruncatedJpeg
            | FrameProblem::DecoderCrash
    )
}

#[cfg(test)]
mod whole_tests {
    use super::*;
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    /// Returns pixels of noise, in which every byte value and many chunk lengths occur.
    fn pixels() -> Vec<u8> {
        (0..40 * 30 * 3u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 13) as u8).collect()
    }

    #[test]
    fn no_prefix_of_an_image_is_whole() {
        let (mut png, mut jpeg) = (Vec::new(), Vec::new());
        PngEncoder::new(&mut png).write_image(&pixels(), 40, 30, ExtendedColorType::Rgb8).unwrap();
        JpegEncoder::new(&mut jpeg)
            .write_image(&pixels(), 40, 30, ExtendedColorType::Rgb8)
            .unwrap();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image");
        for image in [png, jpeg] {
            for length in 0..image.len() {
                std::fs::write(&path, &image[..length]).unwrap();
                assert_eq!(has_image_end(&path), Some(false), "{length} of {} bytes", image.len());
            }
            std::fs::write(&path, &image).unwrap();
            assert_eq!(has_image_end(&path), Some(true));
        }
        std::fs::remove_file(&path).unwrap();
        assert_eq!(has_image_end(&path), Some(false), "a missing file is no image");
        std::fs::write(&path, [0.5f32.to_le_bytes(); 8].as_flattened()).unwrap();
        assert_eq!(has_image_end(&path), None, "bare floats have no end");
    }

    #[test]
    fn more_may_follow_the_end_of_a_jpeg() {
        let mut jpeg = Vec::new();
        JpegEncoder::new(&mut jpeg)
            .write_image(&pixels(), 40, 30, ExtendedColorType::Rgb8)
            .unwrap();
        jpeg.extend(b"SEFT: what a phone adds");
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("image.jpg");
        std::fs::write(&path, jpeg).unwrap();
        assert_eq!(has_image_end(&path), Some(true));
    }
}
