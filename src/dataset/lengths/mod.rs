//! Depth files that are no photographs: floats and codes as EXR, TIFF, NPY or bare bytes.
//!
//! Every reader checks the size that a file states against the bytes that it has before it allocates.

mod bare;
mod exr;
mod npy;
mod tiff;

pub(super) use bare::{bare_bytes, bare_floats};

use super::depth::DepthCodes;
use super::error::FrameProblem;
use crate::math::image::Image;

/// A depth file before its unit is applied.
pub(super) enum StoredDepth {
    /// 16-bit codes.
    Codes(Image<u16>),
    /// Floats.
    Floats(Image<f32>),
}

impl StoredDepth {
    /// Columns and rows.
    pub fn size(&self) -> (usize, usize) {
        match self {
            Self::Codes(image) => (image.width, image.height),
            Self::Floats(image) => (image.width, image.height),
        }
    }

    fn in_units(self, unit: f64) -> DepthCodes {
        match self {
            Self::Codes(codes) => DepthCodes::Linear16 { codes, unit },
            Self::Floats(image) => {
                DepthCodes::Lengths(image.map(|&v| (f64::from(v) * unit) as f32))
            }
        }
    }
}

type Reader = fn(&[u8]) -> Result<StoredDepth, FrameProblem>;

/// First bytes and readers.
const KINDS: [(&[u8], Reader); 4] = [
    (b"\x93NUM", npy::read),
    (b"\x76\x2f\x31\x01", exr::read),
    (b"II*\0", tiff::read),
    (b"MM\0*", tiff::read),
];

fn reader(bytes: &[u8]) -> Option<Reader> {
    KINDS.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, reader)| *reader)
}

/// Whether the first bytes are those of one of these files.
pub(super) fn is_known(bytes: &[u8]) -> bool {
    reader(bytes).is_some()
}

/// Lengths or codes of a file, `unit` world units for one.
pub(super) fn decode(bytes: &[u8], unit: f64) -> Result<DepthCodes, FrameProblem> {
    stored(bytes).map(|stored| stored.in_units(unit))
}

/// Columns and rows of a file.
pub(super) fn size(bytes: &[u8]) -> Result<(usize, usize), FrameProblem> {
    stored(bytes).map(|stored| stored.size())
}

/// No depth image has more pixels.
const MAX_PIXELS: usize = 1 << 28;
/// No packing of these files is tighter: deflate's best.
const MAX_FACTOR: usize = 1040;

/// Whether so many pixels can be in so few bytes, asked before they are allocated.
fn check_size(
    bytes: &[u8],
    [width, height]: [usize; 2],
    per_pixel: usize,
) -> Result<(), FrameProblem> {
    let n = width.checked_mul(height).filter(|n| (1..=MAX_PIXELS).contains(n));
    let fits = |n: usize| n.saturating_mul(per_pixel) <= bytes.len().saturating_mul(MAX_FACTOR);
    match n.is_some_and(fits) {
        true => Ok(()),
        false => Err(FrameProblem::DepthFile {
            expected: "a size that the file's bytes can hold",
            found: format!("{width}x{height} pixels in {} bytes", bytes.len()),
        }),
    }
}

fn stored(bytes: &[u8]) -> Result<StoredDepth, FrameProblem> {
    match reader(bytes) {
        Some(read) => read(bytes),
        None => Err(FrameProblem::DepthFile {
            expected: "depth as EXR, TIFF or NPY",
            found: "another kind of file".to_owned(),
        }),
    }
}
