//! Typed access to the sections of a file.

use super::super::error::try_with_capacity;
use super::container::Container;
use super::element::{ElementType, Stored};
use super::error::{Defect, tag_text};
use crate::export::DEFAULT_MAX_SPLATS;

/// Maximum size of a JSON section in bytes; larger ones are refused on reading.
pub const MAX_JSON_BYTES: usize = 64 << 20;

pub(super) struct Sections<'a>(pub &'a Container<'a>);

impl<'a> Sections<'a> {
    pub fn has(&self, tag: [u8; 4]) -> bool {
        self.0.find(tag).is_some()
    }

    /// Returns the bytes and the element code of a required section.
    pub fn find(&self, tag: [u8; 4]) -> Result<(&'a [u8], u32), Defect> {
        let missing = || Defect::malformed(tag_text(tag), "this section", "none");
        self.0.find(tag).ok_or_else(missing)
    }

    /// Refuses a file that has any of the `tags`, which have no meaning in a `beside`.
    pub fn refuse(&self, tags: &[[u8; 4]], beside: &str) -> Result<(), Defect> {
        match tags.iter().find(|tag| self.has(**tag)) {
            None => Ok(()),
            Some(tag) => {
                let expected = format!("no such section in a {beside}");
                Err(Defect::malformed(tag_text(*tag), expected, "one"))
            }
        }
    }

    /// Returns the bytes of a section, which must hold elements of type `T`, exactly `count` if given.
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

    /// Reads the elements of a section, exactly `count` if given.
    pub fn elements<T: Stored>(
        &self,
        tag: [u8; 4],
        count: Option<usize>,
    ) -> Result<Vec<T>, Defect> {
        let bytes = self.bytes::<T>(tag, count)?;
        let n = bytes.len() / size_of::<T>();
        let mut elements = try_with_capacity(n).map_err(Defect::Memory)?;
        elements.resize(n, T::zeroed());
        // Copied, not cast: elements may start at any address of the file's bytes.
        bytemuck::cast_slice_mut(&mut elements).copy_from_slice(bytes);
        Ok(elements)
    }

    /// Reads a section in rows of `N` elements, exactly `count` rows if given.
    pub fn rows<T: Stored, const N: usize>(
        &self,
        tag: [u8; 4],
        count: Option<usize>,
    ) -> Result<Vec<[T; N]>, Defect> {
        let bytes = self.bytes::<T>(tag, count.map(|count| N * count))?;
        // An incomplete row would mean that rows are misread.
        if !bytes.len().is_multiple_of(N * size_of::<T>()) {
            let expected = format!("whole rows of {N} elements");
            let found = (bytes.len() / size_of::<T>()).to_string();
            return Err(Defect::malformed(tag_text(tag), expected, found));
        }
        rows(bytes)
    }

    pub fn read_numbers<const N: usize>(&self, tag: [u8; 4]) -> Result<[f64; N], Defect> {
        let bytes = self.bytes::<f64>(tag, Some(N))?;
        let mut numbers = [0.0; N];
        bytemuck::cast_slice_mut(&mut numbers).copy_from_slice(bytes);
        Ok(numbers)
    }

    pub fn text(&self, tag: [u8; 4]) -> Result<String, Defect> {
        let (bytes, _) = self.find(tag)?;
        // Settings take some kB; parsing gigabytes could exhaust the memory.
        if bytes.len() > MAX_JSON_BYTES {
            let expected = format!("at most {MAX_JSON_BYTES} bytes");
            return Err(Defect::malformed(tag_text(tag), expected, bytes.len().to_string()));
        }
        String::from_utf8(self.elements::<u8>(tag, None)?)
            .map_err(|_| Defect::malformed(tag_text(tag), "UTF-8 text", "other bytes"))
    }

    pub fn optional_text(&self, tag: [u8; 4]) -> Result<Option<String>, Defect> {
        self.has(tag).then(|| self.text(tag)).transpose()
    }
}

/// Splits bytes into whole rows.
pub(super) fn rows<T: Stored, const N: usize>(bytes: &[u8]) -> Result<Vec<[T; N]>, Defect> {
    let n = bytes.len() / (N * size_of::<T>());
    let mut rows = try_with_capacity(n).map_err(Defect::Memory)?;
    rows.resize(n, [T::zeroed(); N]);
    bytemuck::cast_slice_mut(rows.as_flattened_mut()).copy_from_slice(bytes);
    Ok(rows)
}

/// Codes of the element types that distinguish variants of a section.
pub(super) const F32: u32 = ElementType::F32 as u32;
pub(super) const F64: u32 = ElementType::F64 as u32;
pub(super) const I32: u32 = ElementType::I32 as u32;
pub(super) const I64: u32 = ElementType::I64 as u32;
pub(super) const I128: u32 = ElementType::I128 as u32;

/// Error for a section whose element type is not permitted.
pub(super) fn wrong_type(tag: [u8; 4], expected: &str, code: u32) -> Defect {
    let found = ElementType::of_code(code).map_or(format!("type {code}"), |e| format!("{e:?}"));
    Defect::malformed(tag_text(tag), format!("elements of type {expected}"), found)
}

/// Checks that the number of components is between `least` and the maximum model size.
pub(super) fn check_size(tag: [u8; 4], least: usize, n: usize) -> Result<(), Defect> {
    if (least..=DEFAULT_MAX_SPLATS).contains(&n) {
        return Ok(());
    }
    let expected = format!("{least} to {DEFAULT_MAX_SPLATS} components");
    Err(Defect::malformed(tag_text(tag), expected, n.to_string()))
}
