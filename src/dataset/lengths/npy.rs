//! NumPy array files: a text header and the array's bytes.

use super::stored::StoredDepth;
use crate::dataset::error::FrameProblem;
use crate::math::image::Image;

/// Reads an array with two axes, or with three of which the last has length one.
pub(super) fn read(bytes: &[u8]) -> Result<StoredDepth, FrameProblem> {
    let wrong = |found: String| FrameProblem::DepthFile {
        expected: "a little-endian NPY array of rows and columns in C order (f2, f4, f8, u2, u4)",
        found,
    };
    let (header, data) = split(bytes).ok_or_else(|| wrong("a damaged header".to_owned()))?;
    let kind = text_of(header, "descr").ok_or_else(|| wrong(shorten(header)))?;
    let in_order = header.contains("'fortran_order': False");
    let size = shape(header).filter(|_| in_order).ok_or_else(|| wrong(shorten(header)))?;
    let [height, width] = size;
    let n = width.checked_mul(height).ok_or_else(|| wrong(shorten(header)))?;
    let width_of = kind.get(2..).and_then(|digits| digits.parse::<usize>().ok()).unwrap_or(0);
    // Exact: a file longer or shorter than its header states is damaged.
    if n.checked_mul(width_of) != Some(data.len()) || n == 0 {
        return Err(wrong(format!("{} bytes of data for {}", data.len(), shorten(header))));
    }
    let floats = |values: Vec<f32>| StoredDepth::Floats(Image::from_vec(width, height, values));
    Ok(match kind {
        "<u2" => {
            let codes = data.as_chunks().0.iter().map(|b| u16::from_le_bytes(*b)).collect();
            StoredDepth::Codes(Image::from_vec(width, height, codes))
        }
        "<f2" => floats(
            data.as_chunks()
                .0
                .iter()
                .map(|b| ::exr::prelude::f16::from_le_bytes(*b).to_f32())
                .collect(),
        ),
        "<f4" => floats(data.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)).collect()),
        "<f8" => floats(data.as_chunks().0.iter().map(|b| f64::from_le_bytes(*b) as f32).collect()),
        "<u4" => floats(data.as_chunks().0.iter().map(|b| u32::from_le_bytes(*b) as f32).collect()),
        _ => return Err(wrong(format!("values of type {kind}"))),
    })
}

/// Splits a file into header text and data.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    // Signature, two bytes of version, then the header's length in two bytes or, from version 2, in four.
    let rest = bytes.get(8..)?;
    let (length, rest) = match bytes.get(6)? {
        1 => (usize::from(u16::from_le_bytes([*rest.first()?, *rest.get(1)?])), rest.get(2..)?),
        _ => (u32::from_le_bytes(*rest.first_chunk()?) as usize, rest.get(4..)?),
    };
    let (header, data) = rest.split_at_checked(length)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

/// Quoted value of a key.
fn text_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    header.split_once(&format!("'{key}':"))?.1.split('\'').nth(1)
}

/// Rows and columns.
fn shape(header: &str) -> Option<[usize; 2]> {
    let list = header.split_once("'shape':")?.1.split_once('(')?.1.split_once(')')?.0;
    let axes: Option<Vec<usize>> =
        list.split(',').map(str::trim).filter(|t| !t.is_empty()).map(|t| t.parse().ok()).collect();
    match axes?[..] {
        [rows, columns] | [rows, columns, 1] | [1, rows, columns] => Some([rows, columns]),
        _ => None,
    }
}

fn shorten(header: &str) -> String {
    header.trim().chars().take(80).collect()
}
