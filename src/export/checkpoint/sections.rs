//! Typed access to the sections of a file.

use super::container::Container;
use super::element::{ElementType, Stored};
use super::error::{Defect, tag_text};
use crate::export::DEFAULT_MAX_SPLATS;
use crate::export::error::try_with_capacity;

/// Maximum size of a JSON section in bytes; larger ones are refused on reading.
pub const MAX_JSON_BYTES: usize = 64 << 20;

pub(super) struct Sections<'a>(pub &'a Container<'a>);

impl<'a> Sections<'a> {
    pub fn has(&self, tag: [u8; 4]) -> bool {
        self.0.find(tag).is_some()
    }

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

    pub fn optional_text(&self, tag: [u8; 4]) -> Result<Option<String>, Defect> {
        self.has(tag).then(|| self.text(tag)).transpose()
    }
}

pub(super) fn rows<T: Stored, const N: usize>(bytes: &[u8]) -> Result<Vec<[T; N]>, Defect> {
    let n = bytes.len() / (N * size_of::<T>());
    let mut rows = try_with_capacity(n).map_err(Defect::Memory)?;
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

// Upper case: programs without support for such a section refuse the file.
pub const CONFIG: [u8; 4] = *b"CONF";
pub const META: [u8; 4] = *b"META";
pub const NUMERICS: [u8; 4] = *b"NUMX";
pub const CURSOR: [u8; 4] = *b"CURS";
pub const HISTORY: [u8; 4] = *b"HIST";

pub const NORMALIZATION: [u8; 4] = *b"NORM";
pub const PRIOR: [u8; 4] = *b"PRIR";
pub const ALPHA: [u8; 4] = *b"DIRI";
pub const MEANS: [u8; 4] = *b"MINI";
pub const COUNTS: [u8; 4] = *b"STAN";
pub const FIRST: [u8; 4] = *b"STA1";
pub const SECOND: [u8; 4] = *b"STA2";
pub const CARRY_IDS: [u8; 4] = *b"CARI";
pub const CARRY_LIMBS: [u8; 4] = *b"CARL";

pub const ORIGIN: [u8; 4] = *b"ORIG";
pub const SEEDS: [u8; 4] = *b"SEED";
pub const COARSENED: [u8; 4] = *b"COAR";
pub const SHARES: [u8; 4] = *b"SHAR";
pub const SUMS: [u8; 4] = *b"SUMS";
pub const WIDE_IDS: [u8; 4] = *b"WIDI";
pub const WIDE_SUMS: [u8; 4] = *b"WIDE";
pub const VISIBILITY: [u8; 4] = *b"LOOK";
pub const COMPONENTS: [u8; 4] = *b"COMP";
pub const EXPOSURES: [u8; 4] = *b"EXPO";
pub const POSES: [u8; 4] = *b"POSE";
pub const POSE_ROTATIONS: [u8; 4] = *b"POSR";
pub const TRAJECTORY: [u8; 4] = *b"TRAJ";
pub const PHOTO_SPLATS: [u8; 4] = *b"PHSP";
pub const PHOTO_APPEARANCE: [u8; 4] = *b"PHAP";
pub const PHOTO_SHAPE_PRECISION: [u8; 4] = *b"PHFO";
pub const PHOTO_COLOR: [u8; 4] = *b"PHCO";
pub const PHOTO_NOISE: [u8; 4] = *b"PHNO";
pub const PHOTO_POINTS: [u8; 4] = *b"PHPT";
pub const PHOTO_SEEN_THROUGH: [u8; 4] = *b"PHST";
pub const PHOTO_BUFFER: [u8; 4] = *b"PHWA";
pub const PHOTO_PIXELS: [u8; 4] = *b"PHPX";
pub const PHOTO_SCALES: [u8; 4] = *b"PHDS";
pub const PHOTO_DEPTHS: [u8; 4] = *b"PHDP";

const OF_ALL: [[u8; 4]; 5] = [CONFIG, META, NUMERICS, CURSOR, HISTORY];
pub const OF_MIXTURES: [[u8; 4]; 9] =
    [NORMALIZATION, PRIOR, ALPHA, MEANS, COUNTS, FIRST, SECOND, CARRY_IDS, CARRY_LIMBS];
pub const OF_SCENES: [[u8; 4]; 24] = [
    ORIGIN,
    SEEDS,
    COARSENED,
    SHARES,
    SUMS,
    WIDE_IDS,
    WIDE_SUMS,
    COMPONENTS,
    VISIBILITY,
    EXPOSURES,
    POSES,
    POSE_ROTATIONS,
    TRAJECTORY,
    PHOTO_SPLATS,
    PHOTO_APPEARANCE,
    PHOTO_SHAPE_PRECISION,
    PHOTO_COLOR,
    PHOTO_NOISE,
    PHOTO_POINTS,
    PHOTO_SEEN_THROUGH,
    PHOTO_BUFFER,
    PHOTO_PIXELS,
    PHOTO_SCALES,
    PHOTO_DEPTHS,
];

pub fn is_known(tag: [u8; 4]) -> bool {
    [&OF_ALL[..], &OF_MIXTURES, &OF_SCENES].iter().any(|tags| tags.contains(&tag))
}

/// Version of the format that this program writes, major and minor. Scenes need 1.1; from
/// 1.2 on they hold no contributions of single frames, and sums in one form.
pub const VERSION: (u16, u16) = (1, 2);
