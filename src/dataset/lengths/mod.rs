//! Depth files other than PNG: floats and codes as EXR, TIFF, NPY or without a header.
//!
//! Every reader compares the size stated in a file with its number of bytes before it allocates memory.

mod bare;
mod exr;
mod npy;
mod stored;
mod tiff;

pub(super) use bare::{bare_bytes, bare_floats};

use super::depth::DepthCodes;
use super::error::FrameProblem;
pub(super) use stored::MAX_FACTOR;
use stored::StoredDepth;

type Reader = fn(&[u8]) -> Result<StoredDepth, FrameProblem>;

/// File signatures and their readers.
const KINDS: [(&[u8], Reader); 4] = [
    (b"\x93NUM", npy::read),
    (b"\x76\x2f\x31\x01", exr::read),
    (b"II*\0", tiff::read),
    (b"MM\0*", tiff::read),
];

fn reader(bytes: &[u8]) -> Option<Reader> {
    KINDS.iter().find(|(magic, _)| bytes.starts_with(magic)).map(|(_, reader)| *reader)
}

/// True if the bytes start with one of the signatures.
pub(super) fn is_known(bytes: &[u8]) -> bool {
    reader(bytes).is_some()
}

/// Decodes lengths or codes; `unit` is in world units per stored unit.
pub(super) fn decode(bytes: &[u8], unit: f64) -> Result<DepthCodes, FrameProblem> {
    stored(bytes).map(|stored| stored.in_units(unit))
}

/// Reads columns and rows of a file.
pub(super) fn size(bytes: &[u8]) -> Result<(usize, usize), FrameProblem> {
    stored(bytes).map(|stored| stored.size())
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
