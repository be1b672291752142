//! Rows of a PLY, in any of its three encodings.
//!
//! Every value becomes an f64, which represents all property types exactly. Row counts are checked against
//! the remaining bytes before rows are allocated, because headers are untrusted. Of a file, only a block is in
//! memory.

use super::{Encoding, Kind, PlyElement, Property, Scalar};
use crate::export::error::{Fault, shorten};
use crate::export::read::Source;
use std::io::ErrorKind;

#[derive(Clone)]
pub(super) struct Body<'a> {
    encoding: Encoding,
    source: Source<'a>,
}

/// Longest number in ASCII, bytes.
const MAX_TOKEN: u64 = 1024;

type Found = String;

impl<'a> Body<'a> {
    /// Creates the body of a file of which `source` holds what follows the header.
    pub fn new(encoding: Encoding, source: Source<'a>) -> Self {
        Self { encoding, source }
    }

    pub fn skip(&mut self, element: &PlyElement) -> Result<(), Fault> {
        // Rows without properties take no bytes, so any count is valid.
        if element.properties.is_empty() {
            return Ok(());
        }
        if let (Some(row), false) = (row_size(element), self.encoding == Encoding::Ascii) {
            let size = self.checked_size(element, row)?;
            return self.source.skip(size).map_err(|e| number_fault(element, 0, found(&e)));
        }
        // Each row takes at least one byte, so a wrong count stops at the end of the file.
        for row in 0..element.count {
            for property in &element.properties {
                self.skip_property(property).map_err(|found| number_fault(element, row, found))?;
            }
        }
        Ok(())
    }

    fn skip_property(&mut self, property: &Property) -> Result<(), Found> {
        let (length, item) = match property.kind {
            Kind::Scalar(kind) => return self.value(kind).map(drop),
            Kind::List { length, item } => (length, item),
        };
        let n = self.value(length)?;
        // In ASCII files, any number may appear as a length.
        if n.is_nan() || n < 0.0 {
            return Err(format!("a list of length {n}"));
        }
        if self.encoding == Encoding::Ascii {
            return (0..n as u64).try_for_each(|_| self.value(item).map(drop));
        }
        let size = (n as u64).saturating_mul(item.size() as u64);
        self.source.skip(size).map_err(|e| found(&e))
    }

    /// Returns the number of rows of an element without list properties. Fails if the file is too small
    /// for that many rows.
    pub fn n_rows(&self, element: &PlyElement) -> Result<usize, Fault> {
        let row = row_size(element).ok_or_else(|| Fault::Unsupported {
            feature: format!("a list among the properties of {}", element.place()),
            advice: "export the vertices without list properties",
        })?;
        // In ASCII a value takes at least one character and one white space.
        let ascii = self.encoding == Encoding::Ascii;
        // This minimum exposes wrong counts before memory is allocated.
        let row = if ascii { 2 * element.properties.len() } else { row };
        self.checked_size(element, row)?;
        Ok(element.count as usize)
    }

    fn checked_size(&self, element: &PlyElement, row: usize) -> Result<u64, Fault> {
        // The last row of an ASCII file may lack a line break.
        let slack = u64::from(self.encoding == Encoding::Ascii);
        match element.count.checked_mul(row as u64) {
            Some(size) if size <= self.source.left + slack => Ok(size),
            _ => Err(Fault::malformed(
                element.place(),
                format!("{} rows of at least {row} bytes", element.count),
                format!("{} bytes", self.source.left),
            )),
        }
    }

    pub fn read_row(
        &mut self,
        element: &PlyElement,
        row: usize,
        values: &mut [f64],
    ) -> Result<(), Fault> {
        for (value, property) in values.iter_mut().zip(&element.properties) {
            if let Kind::Scalar(kind) = property.kind {
                *value =
                    self.value(kind).map_err(|found| number_fault(element, row as u64, found))?;
            }
        }
        Ok(())
    }

    fn value(&mut self, kind: Scalar) -> Result<f64, Found> {
        match self.encoding {
            Encoding::Ascii => self.token(),
            Encoding::LittleEndian | Encoding::BigEndian => self.binary(kind),
        }
    }

    fn token(&mut self) -> Result<f64, Found> {
        loop {
            let text = self.text()?;
            let start = text.iter().position(|byte| !byte.is_ascii_whitespace());
            let n = start.unwrap_or(text.len());
            self.next_bytes(n)?;
            if start.is_some() {
                break;
            }
        }
        let left = self.source.left;
        let text = self.text()?;
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        if end == text.len() && (end as u64) < left {
            return Err(format!("a number of more than {MAX_TOKEN} bytes"));
        }
        let token = self.next_bytes(end)?;
        let number = std::str::from_utf8(token).ok().and_then(|token| token.parse().ok());
        number.ok_or_else(|| format!("\"{}\"", shorten(&String::from_utf8_lossy(token))))
    }

    /// Returns unread text of at least [`MAX_TOKEN`] bytes, or what is left.
    fn text(&mut self) -> Result<&[u8], Found> {
        let n = self.source.left.clamp(1, MAX_TOKEN) as usize;
        self.source.peek(n).map_err(|e| found(&e))
    }

    fn next_bytes(&mut self, n: usize) -> Result<&[u8], Found> {
        self.source.take(n).map_err(|e| found(&e))
    }

    fn binary(&mut self, kind: Scalar) -> Result<f64, Found> {
        let is_swapped = self.encoding == Encoding::BigEndian;
        let value = self.next_bytes(kind.size())?;
        // Missing high bytes stay zero, and the casts below take the low ones.
        let mut bytes = [0; 8];
        let places = bytes.iter_mut();
        match is_swapped {
            true => places.zip(value.iter().rev()).for_each(|(to, from)| *to = *from),
            false => places.zip(value).for_each(|(to, from)| *to = *from),
        }
        let bits = u64::from_le_bytes(bytes);
        Ok(match kind {
            Scalar::I8 => f64::from(bits as i8),
            Scalar::U8 => f64::from(bits as u8),
            Scalar::I16 => f64::from(bits as i16),
            Scalar::U16 => f64::from(bits as u16),
            Scalar::I32 => f64::from(bits as i32),
            Scalar::U32 => f64::from(bits as u32),
            Scalar::F32 => f64::from(f32::from_bits(bits as u32)),
            Scalar::F64 => f64::from_bits(bits),
        })
    }
}

#[expect(clippy::indexing_slicing, reason = "a row has a value for every property")]
pub(super) fn pick<const N: usize>(values: &[f64], columns: [usize; N]) -> [f64; N] {
    columns.map(|column| values[column])
}

fn row_size(element: &PlyElement) -> Option<usize> {
    element
        .properties
        .iter()
        .map(|p| match p.kind {
            Kind::Scalar(kind) => Some(kind.size()),
            Kind::List { .. } => None,
        })
        .sum()
}

fn found(error: &std::io::Error) -> Found {
    match error.kind() {
        ErrorKind::UnexpectedEof => "the end of the file".to_owned(),
        _ => error.to_string(),
    }
}

fn number_fault(element: &PlyElement, row: u64, found: Found) -> Fault {
    Fault::malformed(format!("{}, row {row}", element.place()), "a number", found)
}
