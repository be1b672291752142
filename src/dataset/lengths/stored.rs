//! Values of a depth file before its unit is applied, and a plausibility check of its size.

use crate::dataset::depth::DepthCodes;
use crate::dataset::error::FrameProblem;
use crate::math::image::Image;

pub(super) enum StoredDepth {
    Codes(Image<u16>),
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

    pub fn in_units(self, unit: f64) -> DepthCodes {
        match self {
            Self::Codes(codes) => DepthCodes::Linear16 { codes, unit },
            Self::Floats(image) => {
                DepthCodes::Lengths(image.map(|&v| (f64::from(v) * unit) as f32))
            }
        }
    }
}

/// Limit for depth images: 67 million pixels.
const MAX_PIXELS: usize = 1 << 26;
/// Highest compression factor of these formats and PNG, that of deflate.
pub(in crate::dataset) const MAX_FACTOR: usize = 1040;

/// Checks, before allocation, that the file's bytes can contain this number of pixels.
pub(super) fn check_size(
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
