//! Sections of a file by type and size.

use super::super::error::reserved;
use super::container::Container;
use super::element::{ElementType, Stored};
use super::error::{Defect, tag_text};
use crate::export::DEFAULT_MAX_SPLATS;

/// Most bytes of a JSON section: what is larger is refused when it is read.
pub const MAX_JSON_BYTES: usize = 64 << 20;

/// The sections of a file whose frame is sound.
pub(super) struct Sections<'a>(pub &'a Container<'a>);

impl<'a> Sections<'a> {
    /// Whether there is such a section.
    pub fn has(&self, tag: [u8; 4]) -> bool {
        self.0.find(tag).is_some()
    }

    /// Bytes and code of the elements of a section that must be there.
    pub fn find(&self, tag: [u8; 4]) -> Result<(&'a [u8], u32), Defect> {
        let missing = || Defect::malformed(tag_text(tag), "this section", "none");
        self.0.find(tag).ok_or_else(missing)
    }

    /// Refuses the first of some sections that is there, since they mean nothing `beside` others.
    pub fn refuse(&self, tags: &[[u8; 4]], beside: &str) -> Result<(), Defect> {
        match tags.iter().find(|tag| self.has(**tag)) {
            None => Ok(()),
            Some(tag) => {
                let expected = format!("no such section in a {beside}");
                Err(Defect::malformed(tag_text(*tag), expected, "one"))
            }
        }
    }

    /// Bytes of a section that must hold `count` elements of type `T`, or any number.
    pub fn bytes<T: Stored>(&self, tag: [u8; 4], count: Option<usize>) -> Result<&'a [u8], Defect> {
        let (bytes, code) = self.find(tag)?;
        if code != T::ELEMENT as u32 {
            return Err(wrong_type(tag, &format!("{:?}", T::ELEMENT), code));
        }
        let found = bytes.len() / size_of::<T>();
        match count.filter(|&count| count != found) {
            None => Ok(bytes),
            Some(count) => {
                let expected = format!("{count} elements");
                Err(Defect::malformed(tag_text(tag), expected, found.to_string()))
            }
        }
    }

    /// Elements of a section, `count` of them or any number.
    pub fn elements<T: Stored>(
        &self,
        tag: [u8; 4],
        count: Option<usize>,
    ) -> Result<Vec<T>, Defect> {
        let bytes = self.bytes::<T>(tag, count)?;
        let n = bytes.len() / size_of::<T>();
        let mut elements = reserved(n).map_err(Defect::Memory)?;
        elements.resize(n, T::zeroed());
        // Copied into place, not cast: in a file's bytes elements lie at any address.
        bytemuck::cast_slice_mut(&mut elements).copy_from_slice(bytes);
        Ok(elements)
    }

    /// Elements of a section by rows, `count` rows or any whole number of them.
    pub fn rows<T: Stored, const N: usize>(
        &self,
        tag: [u8; 4],
        count: Option<usize>,
    ) -> Result<Vec<[T; N]>, Defect> {
        let bytes = self.bytes::<T>(tag, count.map(|count| N * count))?;
        // Rows are read as they lie; a torn one would shift all that follow.
        if !bytes.len().is_multiple_of(N * size_of::<T>()) {
            let expected = format!("whole rows of {N} elements");
            let found = (bytes.len() / size_of::<T>()).to_string();
            return Err(Defect::malformed(tag_text(tag), expected, found));
        }
        rows(bytes)
    }

    /// A few numbers.
    pub fn numbers<const N: usize>(&self, tag: [u8; 4]) -> Result<[f64; N], Defect> {
        let bytes = self.bytes::<f64>(tag, Some(N))?;
        let mut numbers = [0.0; N];
        bytemuck::cast_slice_mut(&mut numbers).copy_from_slice(bytes);
        Ok(numbers)
    }

    /// Text of a JSON section.
    pub fn text(&self, tag: [u8; 4]) -> Result<String, Defect> {
        let (bytes, _) = self.find(tag)?;
        // Settings are some kB; a parser fed gigabytes would take the machine with it.
        if bytes.len() > MAX_JSON_BYTES {
            let expected = format!("at most {MAX_JSON_BYTES} bytes");
            return Err(Defect::malformed(tag_text(tag), expected, bytes.len().to_string()));
        }
        String::from_utf8(self.elements::<u8>(tag, None)?)
            .map_err(|_| Defect::malformed(tag_text(tag), "UTF-8 text", "other bytes"))
    }

    /// The text of a section that may be missing.
    pub fn text_if_any(&self, tag: [u8; 4]) -> Result<Option<String>, Defect> {
        self.has(tag).then(|| self.text(tag)).transpose()
    }
}

/// Bytes as whole rows.
pub(super) fn rows<T: Stored, const N: usize>(bytes: &[u8]) -> Result<Vec<[T; N]>, Defect> {
    let n = bytes.len() / (N * size_of::<T>());
    let mut rows = reserved(n).map_err(Defect::Memory)?;
    rows.resize(n, [T::zeroed(); N]);
    bytemuck::cast_slice_mut(rows.as_flattened_mut()).copy_from_slice(bytes);
    Ok(rows)
}

/// Codes of the elements that sections are told apart by.
pub(super) const F32: u32 = ElementType::F32 as u32;
pub(super) const F64: u32 = ElementType::F64 as u32;
pub(super) const I32: u32 = ElementType::I32 as u32;
pub(super) const I64: u32 = ElementType::I64 as u32;
pub(super) const I128: u32 = ElementType::I128 as u32;

/// A section of elements it never has.
pub(super) fn wrong_type(tag: [u8; 4], expected: &str, code: u32) -> Defect {
    let found = ElementType::of_code(code).map_or(format!("type {code}"), |e| format!("{e:?}"));
    Defect::malformed(tag_text(tag), format!("elements of type {expected}"), found)
}

/// Whether a number of components is one that models have.
pub(super) fn check_size(tag: [u8; 4], least: usize, n: usize) -> Result<(), Defect> {
    if (least..=DEFAULT_MAX_SPLATS).contains(&n) {
        return Ok(());
    }
    let expected = format!("{least} to {DEFAULT_MAX_SPLATS} components");
    Err(Defect::malformed(tag_text(tag), expected, n.to_string()))
}
