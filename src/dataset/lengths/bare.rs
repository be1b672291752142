//! Arrays without a header, plain or LZFSE-compressed, as phones write them.

use crate::dataset::depth::DepthCodes;
use crate::dataset::error::FrameProblem;
use crate::math::image::Image;
use std::borrow::Cow;
use std::io::Read;

/// Decodes 32-bit floats of an image of `size` (columns, rows), in world units.
pub(in crate::dataset) fn bare_floats(
    bytes: &[u8],
    size: (u32, u32),
) -> Result<DepthCodes, FrameProblem> {
    let bytes = unpacked(bytes, size, size_of::<f32>())?;
    let lengths = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
    Ok(DepthCodes::Lengths(Image::from_vec(size.0 as usize, size.1 as usize, lengths)))
}

/// Decodes bytes of an image of `size` (columns, rows).
pub(in crate::dataset) fn bare_bytes(
    bytes: &[u8],
    size: (u32, u32),
) -> Result<Image<u8>, FrameProblem> {
    let bytes = unpacked(bytes, size, 1)?.into_owned();
    Ok(Image::from_vec(size.0 as usize, size.1 as usize, bytes))
}

/// Decompresses the bytes; checks that their number matches the image.
fn unpacked(
    bytes: &[u8],
    (width, height): (u32, u32),
    per_pixel: usize,
) -> Result<Cow<'_, [u8]>, FrameProblem> {
    let expected = width as usize * height as usize * per_pixel;
    let wrong = |found: String| FrameProblem::DepthFile {
        expected: "values without a header, of the size stated in the metadata, plain or LZFSE-compressed",
        found,
    };
    let short = |n: usize| wrong(format!("{n} bytes for {width}x{height} pixels of {per_pixel}"));
    if bytes.len() == expected {
        return Ok(Cow::Borrowed(bytes));
    }
    // Start of LZFSE blocks; for any other file, the size is wrong.
    if !bytes.starts_with(b"bvx") {
        return Err(short(bytes.len()));
    }
    let mut decoder = lzfse_rust::LzfseRingDecoder::default();
    let mut out = Vec::new();
    let mut stream = decoder.reader_bytes(bytes);
    // One byte more detects a file with too much data, without unpacking all of it.
    let read = stream.by_ref().take(expected as u64 + 1).read_to_end(&mut out);
    read.map_err(|e| wrong(e.to_string()))?;
    if out.len() == expected { Ok(Cow::Owned(out)) } else { Err(short(out.len())) }
}
