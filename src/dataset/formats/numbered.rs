//! Files matched to frames by the number in their names.

use crate::dataset::error::FrameProblem;
use crate::dataset::folder::{Folder, FolderListing};
use crate::dataset::source::ByteSource;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// Extensions of photographs.
pub(super) const PHOTOGRAPHS: [&str; 3] = ["jpg", "jpeg", "png"];

/// The files of a folder by the number in their names.
pub(super) struct NumberedFiles {
    relative: PathBuf,
    listing: Rc<FolderListing>,
    by_number: BTreeMap<u64, String>,
    /// Numbers with more than one file, and the names of the further files.
    pub duplicates: Vec<(u64, String)>,
}

impl NumberedFiles {
    /// Lists files with one of the extensions whose names are `prefix` followed by a number.
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
            match by_number.contains_key(&number) {
                true => doubled.push((number, name.to_owned())),
                false => drop(by_number.insert(number, name.to_owned())),
            }
        }
        Ok(Self { relative, listing, by_number, duplicates: doubled })
    }

    /// True if a folder contains such a file.
    pub fn any(folder: &Folder, relative: &str, prefix: &str, extensions: &[&str]) -> bool {
        folder
            .list(Path::new(relative))
            .is_ok_and(|listing| listing.files().any(|n| number(n, prefix, extensions).is_some()))
    }

    /// Numbers of all files in ascending order.
    pub fn numbers(&self) -> impl Iterator<Item = u64> {
        self.by_number.keys().copied()
    }

    /// Numbers in any of the lists, so that frames with a missing file are reported instead of skipped.
    pub fn union(lists: &[&Self]) -> BTreeSet<u64> {
        lists.iter().flat_map(|list| list.numbers()).collect()
    }

    pub fn len(&self) -> usize {
        self.by_number.len()
    }

    /// Name of the file without its extension.
    pub fn stem(&self, number: u64) -> Option<&str> {
        let name = self.by_number.get(&number)?;
        Some(name.rsplit_once('.').map_or(name.as_str(), |(stem, _)| stem))
    }

    /// True if the file of a number has the extension.
    pub fn has_extension(&self, number: u64, extension: &str) -> bool {
        let own = self.by_number.get(&number).and_then(|name| name.rsplit_once('.'));
        own.is_some_and(|(_, own)| own.eq_ignore_ascii_case(extension))
    }

    /// All accessible files, ordered by number.
    pub fn sources(&self, folder: &Folder) -> impl Iterator<Item = ByteSource> {
        self.numbers().filter_map(|n| self.file(folder, n)?.ok()).map(Into::into)
    }

    /// File of a number; `None` if there is none.
    pub fn file(&self, folder: &Folder, number: u64) -> Option<Result<PathBuf, FrameProblem>> {
        let name = self.by_number.get(&number)?;
        Some(folder.file(&self.relative, &self.listing, name))
    }
}

/// Parses the first digits after the prefix; `00012-000033.png` has the number 12.
fn number(name: &str, prefix: &str, extensions: &[&str]) -> Option<u64> {
    let (stem, extension) = name.rsplit_once('.')?;
    if !extensions.iter().any(|e| e.eq_ignore_ascii_case(extension)) {
        return None;
    }
    let digits = stem.strip_prefix(prefix)?.trim_start_matches(['_', '-']);
    digits.split(|c: char| !c.is_ascii_digit()).next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

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
