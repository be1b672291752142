//! TIFF: 16-bit codes or floats, one sample per pixel.

use super::stored::{StoredDepth, check_size};
use crate::dataset::error::FrameProblem;
use crate::math::image::Image;
use ::tiff::decoder::{Decoder, DecodingResult};
use std::io::Cursor;

/// Reads the first image.
pub(super) fn read(bytes: &[u8]) -> Result<StoredDepth, FrameProblem> {
    let wrong = |found: String| FrameProblem::DepthFile {
        expected: "a TIFF with one 16-bit or float sample per pixel",
        found,
    };
    let damaged = |e: ::tiff::TiffError| wrong(e.to_string());
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(damaged)?;
    let (width, height) = decoder.dimensions().map_err(damaged)?;
    let [width, height] = [width as usize, height as usize];
    check_size(bytes, [width, height], 2)?;
    let stored = match decoder.read_image().map_err(damaged)? {
        DecodingResult::U16(codes) if codes.len() == width * height => {
            StoredDepth::Codes(Image::from_vec(width, height, codes))
        }
        DecodingResult::F32(values) if values.len() == width * height => {
            StoredDepth::Floats(Image::from_vec(width, height, values))
        }
        DecodingResult::F64(values) if values.len() == width * height => {
            let values = values.into_iter().map(|v| v as f32).collect();
            StoredDepth::Floats(Image::from_vec(width, height, values))
        }
        _ => return Err(wrong("other samples".to_owned())),
    };
    Ok(stored)
}
