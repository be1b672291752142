//! `.splat` (`export.md`, Dot-splat): 32 bytes a splat and nothing else: no header, no version, no axes.

use super::error::Fault;
use super::gaussian::Gaussian;
use super::imported::{Imported, ModelKind, Rows};
use glam::{DMat3, DVec3};

/// Bytes of a splat: position and scale as six f32, colour and opacity as four bytes, the rotation
/// `w x y z` as four more.
const ROW_BYTES: usize = 32;
/// Rows looked at to tell the format, which has no mark of its own.
const N_PROBED: usize = 64;
/// Largest distance of a quaternion's squared length from 1: eight bits and a byte of 255 for one.
const LENGTH_SLACK: f64 = 0.1;

/// Whether most of the first rows look like splats: finite, scales not negative and no rotation
/// other than one of length 1, which words and pictures are not.
pub(super) fn is_likely(bytes: &[u8]) -> bool {
    let rows = &bytes.as_chunks::<ROW_BYTES>().0;
    let probed = &rows[..rows.len().min(N_PROBED)];
    let likely = |row: &&[u8; ROW_BYTES]| {
        let (mean, scale) = (vector(row, 0), vector(row, 12));
        let length: f64 = quaternion(row).iter().map(|v| v * v).sum();
        mean.is_finite()
            && scale.is_finite()
            && scale.min_element() >= 0.0
            && (length - 1.0).abs() < LENGTH_SLACK
    };
    !probed.is_empty() && 2 * probed.iter().filter(likely).count() > probed.len()
}

/// Reads a file of at most `max_splats` splats.
pub(super) fn splat(bytes: &[u8], max_splats: usize) -> Result<Imported, Fault> {
    let (records, rest) = bytes.as_chunks::<ROW_BYTES>();
    if !rest.is_empty() {
        let expected = format!("a multiple of {ROW_BYTES} bytes");
        return Err(Fault::malformed(".splat", expected, format!("{} bytes", bytes.len())));
    }
    if records.len() > max_splats {
        return Err(Fault::TooMany { declared: records.len() as u64, cap: max_splats });
    }
    let mut rows = Rows::with_room(records.len())?;
    for record in records {
        let rotation = rows.rotation(quaternion(record));
        let scale = vector(record, 12);
        rows.push(Gaussian {
            mean: vector(record, 0),
            opacity: f64::from(record[27]) / 255.0,
            color: DVec3::from_array([24, 25, 26].map(|i| f64::from(record[i]) / 255.0)),
            // A negative deviation is no number of the format: counted as not finite.
            scale: if scale.min_element() < 0.0 { DVec3::NAN } else { scale },
            rotation,
            directional: DMat3::ZERO,
        });
    }
    rows.finish(ModelKind::Splats, Vec::new(), Vec::new())
}

fn vector(record: &[u8; ROW_BYTES], at: usize) -> DVec3 {
    let float = |i: usize| {
        let b = &record[at + 4 * i..];
        f64::from(f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
    };
    DVec3::new(float(0), float(1), float(2))
}

/// `w x y z`, each byte 128 for 0 and a step of 1/128.
fn quaternion(record: &[u8; ROW_BYTES]) -> [f64; 4] {
    std::array::from_fn(|i| (f64::from(record[28 + i]) - 128.0) / 128.0)
}
