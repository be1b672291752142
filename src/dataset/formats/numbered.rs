//! Files matched to frames by the number in their names.

use super::recording::{Cameras, frame_entry};
use super::stated::majority;
use crate::dataset::decode;
use crate::dataset::decode::DepthEncoding;
use crate::dataset::entry::{DatasetSplit, DepthSource};
use crate::dataset::error::FrameProblem;
use crate::dataset::folder::{Folder, FolderListing};
use crate::dataset::formats::ParsedFolder;
use crate::dataset::options::ByteSource;
use crate::math::pose::Pose;
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::PathBuf;
use std::rc::Rc;

/// File name extensions of photographs, in the order in which they are tried if a list omits the
/// extension.
pub(super) const PHOTOGRAPHS: [&str; 3] = ["png", "jpg", "jpeg"];

/// Extensions of depth files of a layout that prescribes none.
pub(super) const DEPTH_FILES: [&str; 6] = ["png", "exr", "npy", "npz", "tif", "tiff"];

pub(super) struct NumberedFiles {
    relative: PathBuf,
    listing: Rc<FolderListing>,
    by_number: BTreeMap<u64, String>,
    /// Files whose number another file already has: the number and the file's name.
    pub duplicates: Vec<(u64, String)>,
}

impl NumberedFiles {
    /// Lists the files whose names consist of `prefix`, a number and one of the extensions.
    pub fn list(
        folder: &Folder,
        relative: &str,
        prefix: &str,
        extensions: &[&str],
    ) -> Result<Self, FrameProblem> {
        let relative = PathBuf::from(relative);
        let listing = folder.list(&relative)?;
        let (mut by_number, mut doubled) = (BTreeMap::new(), Vec::new());
        for name in listing.files() {
            let Some(number) = number(name, prefix, extensions) else { continue };
            // The listing is sorted, so the choice does not depend on the file system.
            match by_number.contains_key(&number) {
                true => doubled.push((number, name.to_owned())),
                false => drop(by_number.insert(number, name.to_owned())),
            }
        }
        Ok(Self { relative, listing, by_number, duplicates: doubled })
    }

    pub fn any(folder: &Folder, relative: &str, prefix: &str, extensions: &[&str]) -> bool {
        folder
            .list_if_any(relative)
            .is_some_and(|listing| listing.files().any(|n| number(n, prefix, extensions).is_some()))
    }

    pub fn numbers(&self) -> impl Iterator<Item = u64> {
        self.by_number.keys().copied()
    }

    /// Returns all numbers that occur in any of the lists. Frames with a missing file are thus reported
    /// instead of ignored.
    pub fn union(lists: &[&Self]) -> BTreeSet<u64> {
        lists.iter().flat_map(|list| list.numbers()).collect()
    }

    pub fn stem(&self, number: u64) -> Option<&str> {
        let name = self.by_number.get(&number)?;
        Some(name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem))
    }

    pub fn has_extension(&self, number: u64, extension: &str) -> bool {
        let own = self.by_number.get(&number).and_then(|name| name.rsplit_once('.'));
        own.is_some_and(|(_, own)| own.eq_ignore_ascii_case(extension))
    }

    pub fn sources(&self, folder: &Folder) -> impl Iterator<Item = ByteSource> {
        self.numbers().filter_map(|n| self.file(folder, n)?.ok()).map(Into::into)
    }

    pub fn file(&self, folder: &Folder, number: u64) -> Option<Result<PathBuf, FrameProblem>> {
        let name = self.by_number.get(&number)?;
        Some(folder.file(&self.relative, &self.listing, name))
    }

    pub fn required(
        &self,
        folder: &Folder,
        number: u64,
        missing: FrameProblem,
    ) -> Result<ByteSource, FrameProblem> {
        Ok(self.file(folder, number).transpose()?.ok_or(missing)?.into())
    }
}

/// Correspondence of two lists of numbers, such as those of photographs and of depth images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Correspondence {
    /// Items belong together if the second number exceeds the first by this difference.
    Numbers(i128),
    /// Items belong together in the order of their numbers.
    Order,
}

impl Correspondence {
    /// Finds how two lists of ascending numbers correspond: by number if most numbers agree, also if
    /// one list counts from another start; by order if counts are equal. Returns `None` if neither
    /// holds, since a lost file would then shift all later pairs.
    pub fn of(first: &[u64], second: &[u64]) -> Option<Self> {
        let fewer = first.len().min(second.len());
        let known: HashSet<u64> = second.iter().copied().collect();
        let n_shared = |shift: i128| {
            first.iter().filter(|n| shifted(**n, shift).is_some_and(|n| known.contains(&n))).count()
        };
        let difference = |a: Option<&u64>, b: Option<&u64>| Some(i128::from(*b?) - i128::from(*a?));
        // Both ends must agree: if only one does, a file at the other may be lost.
        let start = difference(first.first(), second.first());
        let start = start.filter(|start| Some(*start) == difference(first.last(), second.last()));
        let other = start.map_or((0, 0), |shift| (n_shared(shift), shift));
        let (n, shift) = [(n_shared(0), 0), other].into_iter().rev().max_by_key(|(n, _)| *n)?;
        if 3 * n > 2 * fewer || fewer == 0 {
            return Some(Self::Numbers(shift));
        }
        (first.len() == second.len()).then_some(Self::Order)
    }

    /// Returns the pairs of corresponding numbers, with each number of `second`.
    pub fn pairs(self, first: &[u64], second: &[u64]) -> Vec<(Option<u64>, u64)> {
        match self {
            Self::Numbers(shift) => second.iter().map(|n| (shifted(*n, -shift), *n)).collect(),
            Self::Order => first.iter().map(|n| Some(*n)).zip(second.iter().copied()).collect(),
        }
    }
}

fn shifted(number: u64, shift: i128) -> Option<u64> {
    u64::try_from(i128::from(number) + shift).ok()
}

/// Parses the first number after the prefix. For example, `00012-000033.png` has the number 12.
fn number(name: &str, prefix: &str, extensions: &[&str]) -> Option<u64> {
    let (stem, extension) = name.rsplit_once('.')?;
    // Some cameras write extensions in upper case.
    if !extensions.iter().any(|e| e.eq_ignore_ascii_case(extension)) {
        return None;
    }
    // As in `frame_000012.png`.
    let digits = stem.strip_prefix(prefix)?.trim_start_matches(['_', '-']);
    digits.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

pub(super) struct ListedFrame {
    pub name: String,
    pub pose: Pose,
    pub color: ByteSource,
    // An error is reported only after all frames are listed: without any depth in the split it is none.
    pub depth: Result<ByteSource, FrameProblem>,
}

pub(super) struct ListedSplit {
    pub name: String,
    pub frames: Vec<ListedFrame>,
}

impl ListedSplit {
    pub fn has_depth(&self) -> bool {
        self.frames.iter().any(|c| c.depth.is_ok())
    }

    pub fn colors(&self) -> impl Iterator<Item = &ByteSource> {
        self.frames.iter().map(|frame| &frame.color)
    }

    pub fn depths(&self) -> impl Iterator<Item = &ByteSource> {
        self.frames.iter().filter_map(|frame| frame.depth.as_ref().ok())
    }

    /// Returns the most frequent number of bits per channel of the depth images; 8 if there are none.
    /// Returns `None` if no depth image can be read.
    pub fn depth_bits(&self) -> Option<u16> {
        let depths: Vec<_> = self.depths().collect();
        let bits = majority(&depths, |depth| decode::header(depth).map(|h| h.bits_per_channel));
        // Without depth no encoding is used; 8 bits need no scale from the file.
        bits.map(|bits| bits.unwrap_or(8)).ok()
    }

    /// Creates the split from the listed frames. `read_as` returns cameras and depth encoding of the frame
    /// of a name. If any frame has depth, frames without depth are skipped.
    pub fn into_split(
        self,
        read_as: impl Fn(&str) -> (Cameras, DepthEncoding),
        parsed: &mut ParsedFolder,
    ) -> DatasetSplit {
        // One frame with depth makes this a split with depth, whose other frames lack a file.
        let has_depth = self.has_depth();
        let mut frames = Vec::with_capacity(self.frames.len());
        for ListedFrame { name, pose, color, depth } in self.frames {
            let (cameras, encoding) = read_as(&name);
            let depth = match depth {
                Ok(file) => Some(DepthSource::new(file, encoding)),
                Err(problem) if has_depth => {
                    parsed.skip(&self.name, &name, color.path().to_owned(), problem);
                    continue;
                }
                Err(_) => None,
            };
            frames.push(frame_entry(name, pose, cameras, color, depth));
        }
        DatasetSplit { name: self.name, frames, has_depth }
    }

    /// Skips every frame with a warning. Used if a split's camera or depth encoding is unknown because
    /// no file header can be read.
    pub fn skip_unreadable(self, parsed: &mut ParsedFolder) {
        for ListedFrame { name, color, depth, .. } in self.frames {
            let (file, problem) = match (decode::header(&color), depth) {
                (Err(problem), _) | (_, Err(problem)) => (color, problem),
                (Ok(_), Ok(depth)) => match decode::header(&depth) {
                    Err(problem) => (depth, problem),
                    // The error did not occur again, but must not be hidden.
                    Ok(_) => {
                        let passing = std::io::Error::other("a temporary read error");
                        (color, FrameProblem::Read(passing))
                    }
                },
            };
            parsed.skip(&self.name, &name, file.path().to_owned(), problem);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Correspondence::{Numbers, Order};
    use super::*;

    #[test]
    fn a_lost_file_on_either_side_moves_no_other_pair() {
        let all: Vec<u64> = (0..12).collect();
        let without = |lost: u64| all.iter().copied().filter(|n| *n != lost).collect::<Vec<_>>();
        let from = |start: u64| all.iter().map(|n| n + start).collect::<Vec<_>>();
        let of = Correspondence::of;
        assert_eq!(of(&without(3), &without(7)), Some(Numbers(0)));
        assert_eq!(of(&without(0), &all), Some(Numbers(0)));
        assert_eq!(of(&from(1), &all), Some(Numbers(-1)), "counted from 1 and from 0");
        let lost: Vec<u64> = from(1).into_iter().filter(|n| *n != 5).collect();
        assert_eq!(of(&lost, &all), Some(Numbers(-1)));
        let tens: Vec<u64> = all.iter().map(|n| 10 * n).collect();
        assert_eq!(of(&tens, &all), Some(Order));
        assert_eq!(of(&tens, &without(3)), None);
        assert_eq!(of(&[], &all), Some(Numbers(0)));
        assert_eq!(of(&[u64::MAX], &[0]), Some(Numbers(-i128::from(u64::MAX))));
    }

    #[test]
    fn numbers_are_read_behind_the_prefix() {
        for (name, prefix, expected) in [
            ("000012.jpg", "", Some(12)),
            ("frame000012.JPG", "frame", Some(12)),
            ("frame_3.png", "frame", Some(3)),
            ("0000001-000000033369.jpg", "", Some(1)),
            ("12.txt", "", None),
            ("x12.jpg", "", None),
            ("99999999999999999999999.jpg", "", None),
        ] {
            assert_eq!(number(name, prefix, &PHOTOGRAPHS), expected, "{name}");
        }
    }
}
