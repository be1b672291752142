//! Tags of the sections, and typed access to them.

use super::container::Container;
use super::element::{ElementType, Stored};
use super::error::{Defect, tag_text};
use crate::export::DEFAULT_MAX_SPLATS;
use crate::export::error::try_with_capacity;

/// Maximum size of a JSON section in bytes; larger ones are refused on reading.
pub const MAX_JSON_BYTES: usize = 64 << 20;

impl<'a> Container<'a> {
    pub fn has(&self, tag: [u8; 4]) -> bool {
        self.section(tag).is_some()
    }

    pub fn find(&self, tag: [u8; 4]) -> Result<(&'a [u8], u32), Defect> {
        let missing = || Defect::malformed(tag_text(tag), "this section", "none");
        self.section(tag).ok_or_else(missing)
    }

    /// Reads a value with the function `read` if the section `tag` exists, otherwise returns the
    /// default. Simpler models and older files lack some sections.
    pub fn optional<R: Default>(
        &self,
        tag: [u8; 4],
        read: impl FnOnce() -> Result<R, Defect>,
    ) -> Result<R, Defect> {
        if self.has(tag) { read() } else { Ok(R::default()) }
    }

    /// Returns the bytes of a section. Its elements must have type `T`, and their number must be `count`
    /// if given.
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
}

pub(super) fn rows<T: Stored, const N: usize>(bytes: &[u8]) -> Result<Vec<[T; N]>, Defect> {
    let n = bytes.len() / (N * size_of::<T>());
    let mut rows = try_with_capacity(n).map_err(Defect::Memory)?;
    // Copied, not cast, as in `elements`.
    rows.resize(n, [T::zeroed(); N]);
    bytemuck::cast_slice_mut(rows.as_flattened_mut()).copy_from_slice(bytes);
    Ok(rows)
}

pub(super) const F32: u32 = ElementType::F32 as u32;
pub(super) const F64: u32 = ElementType::F64 as u32;
pub(super) const I64: u32 = ElementType::I64 as u32;
pub(super) const I128: u32 = ElementType::I128 as u32;

pub(super) fn wrong_type(tag: [u8; 4], expected: &str, code: u32) -> Defect {
    let found = ElementType::of_code(code).map_or(format!("type {code}"), |e| format!("{e:?}"));
    Defect::malformed(tag_text(tag), format!("elements of type {expected}"), found)
}

pub(super) fn check_size(tag: [u8; 4], least: usize, n: usize) -> Result<(), Defect> {
    // The limit of imported models bounds the memory here too.
    if (least..=DEFAULT_MAX_SPLATS).contains(&n) {
        return Ok(());
    }
    let expected = format!("{least} to {DEFAULT_MAX_SPLATS} components");
    Err(Defect::malformed(tag_text(tag), expected, n.to_string()))
}

/// Defines a constant for each section tag, and a list of all of them.
macro_rules! tags {
    ($list:ident { $($name:ident: $tag:literal,)* }) => {
        $(pub const $name: [u8; 4] = *$tag;)*
        pub const $list: &[[u8; 4]] = &[$($name),*];
    };
}

// Upper case: programs without support for such a section refuse the file.
tags! { OF_ALL {
    CONFIG: b"CONF",
    META: b"META",
    NUMERICS: b"NUMX",
    CURSOR: b"CURS",
    HISTORY: b"HIST",
} }
tags! { OF_MIXTURES {
    NORMALIZATION: b"NORM",
    PRIOR: b"PRIR",
    ALPHA: b"DIRI",
    MEANS: b"MINI",
    COUNTS: b"STAN",
    FIRST: b"STA1",
    SECOND: b"STA2",
    CARRY_IDS: b"CARI",
    CARRY_LIMBS: b"CARL",
} }
tags! { OF_SCENES {
    ORIGIN: b"ORIG",
    SEEDS: b"SEED",
    COARSENED: b"COAR",
    SHARES: b"SHAR",
    SUMS: b"SUMS",
    WIDE_IDS: b"WIDI",
    WIDE_SUMS: b"WIDE",
    VISIBILITY: b"LOOK",
    COMPONENTS: b"COMP",
    EXPOSURES: b"EXPO",
    POSES: b"POSE",
    POSE_ROTATIONS: b"POSR",
    TRAJECTORY: b"TRAJ",
    PHOTO_SPLATS: b"PHSP",
    PHOTO_APPEARANCE: b"PHAP",
    PHOTO_SHAPE_PRECISION: b"PHFO",
    PHOTO_COLOR: b"PHCO",
    PHOTO_NOISE: b"PHNO",
    PHOTO_POINTS: b"PHPT",
    PHOTO_SEEN_THROUGH: b"PHST",
    PHOTO_POSES: b"PHPS",
    PHOTO_BUFFER: b"PHWA",
    PHOTO_PIXELS: b"PHPX",
    PHOTO_SCALES: b"PHDS",
    PHOTO_DEPTHS: b"PHDP",
    TEXTURE_STEPS: b"TXST",
    TEXTURE_IDS: b"TXID",
    TEXTURE_LATTICES: b"TXLA",
    TEXTURE_SIZES: b"TXSI",
    TEXTURE_PREDICTED: b"TXPR",
    TEXTURE_INDICES: b"TXIX",
    TEXTURE_TEXELS: b"TXEL",
    TEXTURE_FORMER: b"TXFO",
    TEXTURE_FORMER_LATTICES: b"TXFL",
} }

pub fn is_known(tag: [u8; 4]) -> bool {
    [OF_ALL, OF_MIXTURES, OF_SCENES].iter().any(|tags| tags.contains(&tag))
}

/// Version of the format that this program writes, major and minor. Scenes require 1.1 or later. From
/// 1.2 on, scenes hold no contributions of single frames, and their sums have only one encoding.
pub const VERSION: (u16, u16) = (1, 2);
