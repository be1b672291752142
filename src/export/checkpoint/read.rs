//! Sections as a checkpoint.

use super::super::error::{Fault, reserved};
use super::check;
use super::columns::{self, N_FIRST, N_SECOND};
use super::container::{Container, MAGIC, is_text_damaged};
use super::element::{Element, Stored};
use super::error::{CheckpointError, Defect, tag_text};
use super::{Checkpoint, Cursor, Loaded, tag};
use crate::export::{DEFAULT_MAX_SPLATS, read_file};
use crate::math::points::Normalization;
use crate::model::prior::Hyper;
use crate::model::state::{Means, ModelState, Totals};
use crate::model::statistics::N_SUMS;
use std::io::Read;
use std::path::Path;

/// Most bytes of a JSON section.
const MAX_JSON: usize = 64 << 20;

/// Whether a file is a checkpoint by its first bytes, or was one before a transfer in text mode
/// damaged it. Files that cannot be read are none.
pub fn is_checkpoint(path: &Path) -> bool {
    let mut start = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(16).read_to_end(&mut start));
    read.is_ok() && (start.starts_with(&MAGIC) || is_text_damaged(&start))
}

/// Reads a checkpoint and checks all of it.
///
/// # Errors
/// The file cannot be read, is none, is damaged, of another version, or holds values no model has;
/// the [`Defect`] says where.
pub fn read(path: &Path) -> Result<Loaded, CheckpointError> {
    let bytes = read_file(path).map_err(|fault| {
        let fault = match fault {
            Fault::Missing => Fault::NoCheckpoint,
            other => other,
        };
        fault.at(path)
    })?;
    parse(&bytes).map_err(|defect| CheckpointError::Content { path: path.to_owned(), defect })
}

/// Like [`read`], from the bytes of a file.
///
/// # Errors
/// As [`read`].
pub fn parse(bytes: &[u8]) -> Result<Loaded, Defect> {
    let container = Container::parse(bytes)?;
    let sections = Sections(&container);
    let alpha_init: Vec<f64> = sections.elements(tag::ALPHA, None)?;
    let n = alpha_init.len();
    if !(1..=DEFAULT_MAX_SPLATS).contains(&n) {
        let expected = format!("1 to {DEFAULT_MAX_SPLATS} components");
        return Err(Defect::malformed(tag_text(tag::ALPHA), expected, n.to_string()));
    }
    let model = ModelState { alpha_init, means: sections.means(n)?, totals: sections.totals(n)? };
    check::model(&model)?;
    let checkpoint = Checkpoint {
        config: sections.text(tag::CONFIG)?,
        meta: sections.text(tag::META)?,
        numerics: sections.text(tag::NUMERICS)?,
        history: match container.find(tag::HISTORY) {
            Some(_) => Some(sections.text(tag::HISTORY)?),
            None => None,
        },
        cursor: sections.cursor()?,
        normalization: sections.normalization()?,
        hyper: sections.hyper(n)?,
        model,
    };
    Ok(Loaded { checkpoint, version: container.version, bytes: bytes.len() as u64 })
}

struct Sections<'a>(&'a Container<'a>);

impl<'a> Sections<'a> {
    fn find(&self, tag: [u8; 4]) -> Result<(&'a [u8], u32), Defect> {
        let missing = || Defect::malformed(tag_text(tag), "this section", "none");
        self.0.find(tag).ok_or_else(missing)
    }

    /// Bytes of a section that must hold `count` elements of type `T`, or any number.
    fn bytes<T: Stored>(&self, tag: [u8; 4], count: Option<usize>) -> Result<&'a [u8], Defect> {
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

    fn elements<T: Stored>(&self, tag: [u8; 4], count: Option<usize>) -> Result<Vec<T>, Defect> {
        let bytes = self.bytes::<T>(tag, count)?;
        let n = bytes.len() / size_of::<T>();
        let mut elements = reserved(n).map_err(Defect::Memory)?;
        elements.resize(n, T::zeroed());
        bytemuck::cast_slice_mut(&mut elements).copy_from_slice(bytes);
        Ok(elements)
    }

    /// A few numbers.
    fn numbers<const N: usize>(&self, tag: [u8; 4]) -> Result<[f64; N], Defect> {
        let bytes = self.bytes::<f64>(tag, Some(N))?;
        let mut numbers = [0.0; N];
        bytemuck::cast_slice_mut(&mut numbers).copy_from_slice(bytes);
        Ok(numbers)
    }

    fn text(&self, tag: [u8; 4]) -> Result<String, Defect> {
        let (bytes, _) = self.find(tag)?;
        if bytes.len() > MAX_JSON {
            let expected = format!("at most {MAX_JSON} bytes");
            return Err(Defect::malformed(tag_text(tag), expected, bytes.len().to_string()));
        }
        String::from_utf8(self.elements::<u8>(tag, None)?)
            .map_err(|_| Defect::malformed(tag_text(tag), "UTF-8 text", "other bytes"))
    }

    fn cursor(&self) -> Result<Cursor, Defect> {
        let numbers: Vec<u64> = self.elements(tag::CURSOR, None)?;
        let [frames, points, visited @ ..] = numbers.as_slice() else {
            let found = format!("{} numbers", numbers.len());
            return Err(Defect::malformed(tag_text(tag::CURSOR), "2 numbers or more", found));
        };
        let visited = check::visited(visited, *frames)?;
        Ok(Cursor { frames: *frames, points: *points, visited })
    }

    fn normalization(&self) -> Result<Normalization, Defect> {
        let [ox, oy, oz, sx, sy, sz] = self.numbers(tag::NORMALIZATION)?;
        let normalization = Normalization { offset: [ox, oy, oz], scale: [sx, sy, sz] };
        check::normalization(&normalization)?;
        Ok(normalization)
    }

    fn hyper(&self, components: usize) -> Result<Hyper, Defect> {
        let numbers = self.numbers::<8>(tag::PRIOR)?;
        check::prior(&numbers)?;
        let [alpha0, kappa0_space, kappa_init_space, u0_space, nu0, rest @ ..] = numbers;
        let [kappa0_color, kappa_init_color, u0_color] = rest;
        Ok(Hyper {
            components,
            alpha0,
            kappa0_space,
            kappa_init_space,
            u0_space,
            nu0,
            kappa0_color,
            kappa_init_color,
            u0_color,
        })
    }

    fn means(&self, n: usize) -> Result<Means, Defect> {
        match self.find(tag::MEANS)?.1 {
            F32 => {
                let [space, color] = self.means_of(n)?;
                Ok(Means::F32 { space, color })
            }
            F64 => {
                let [space, color] = self.means_of(n)?;
                Ok(Means::F64 { space, color })
            }
            code => Err(wrong_type(tag::MEANS, "F32 or F64", code)),
        }
    }

    fn means_of<T: Stored>(&self, n: usize) -> Result<[Vec<[T; 3]>; 2], Defect> {
        let bytes = self.bytes::<T>(tag::MEANS, Some(6 * n))?;
        let (space, color) = bytes.split_at(bytes.len() / 2);
        Ok([arrays(space)?, arrays(color)?])
    }

    fn totals(&self, n: usize) -> Result<Totals, Defect> {
        let (_, form) = self.find(tag::COUNTS)?;
        if form != I64 && self.0.find(tag::CARRY_IDS).is_some() {
            let expected = "I64 sums beside carries";
            return Err(wrong_type(tag::COUNTS, expected, form));
        }
        match form {
            I64 => {
                let rows = self.rows(n)?;
                let mut carries = Vec::new();
                if self.0.find(tag::CARRY_IDS).is_some() {
                    let ids = self.bytes::<u32>(tag::CARRY_IDS, None)?;
                    let n = ids.len() / size_of::<u32>();
                    let limbs = self.bytes::<i32>(tag::CARRY_LIMBS, Some(N_SUMS * n))?;
                    carries = columns::carries(ids, limbs, reserved(n).map_err(Defect::Memory)?);
                }
                Ok(Totals::Fixed64 { rows, carries })
            }
            I128 => Ok(Totals::Fixed128(self.rows(n)?)),
            F32 => Ok(Totals::F32(self.rows(n)?)),
            code => Err(wrong_type(tag::COUNTS, "I64, I128 or F32", code)),
        }
    }

    fn rows<T: Stored>(&self, n: usize) -> Result<Vec<[T; N_SUMS]>, Defect> {
        let columns = [
            self.bytes::<T>(tag::COUNTS, Some(n))?,
            self.bytes::<T>(tag::FIRST, Some(N_FIRST * n))?,
            self.bytes::<T>(tag::SECOND, Some(N_SECOND * n))?,
        ];
        Ok(columns::join(columns, reserved(n).map_err(Defect::Memory)?))
    }
}

/// Rows of `W` elements.
fn arrays<T: Stored, const W: usize>(bytes: &[u8]) -> Result<Vec<[T; W]>, Defect> {
    let n = bytes.len() / size_of::<[T; W]>();
    let mut rows = reserved(n).map_err(Defect::Memory)?;
    rows.resize(n, [T::zeroed(); W]);
    bytemuck::cast_slice_mut(rows.as_flattened_mut()).copy_from_slice(bytes);
    Ok(rows)
}

const F32: u32 = Element::F32 as u32;
const F64: u32 = Element::F64 as u32;
const I64: u32 = Element::I64 as u32;
const I128: u32 = Element::I128 as u32;

fn wrong_type(tag: [u8; 4], expected: &str, code: u32) -> Defect {
    let found = Element::of_code(code).map_or(format!("type {code}"), |e| format!("{e:?}"));
    Defect::malformed(tag_text(tag), format!("elements of type {expected}"), found)
}
