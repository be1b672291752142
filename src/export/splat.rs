//! Import of `.splat` (`export.md`, Dot-splat): 32 bytes per splat, without header, version or axes.

use super::error::Fault;
use super::gaussian::Gaussian;
use super::imported::{Imported, ModelKind, Rows};
use glam::{DMat3, DVec3};

/// Bytes of a splat: position and scale as six f32, colour and opacity as four bytes, the rotation `w x y z`
/// as four more.
const ROW_BYTES: usize = 32;
/// Number of rows examined to detect the format, which has no magic bytes.
const N_PROBED: usize = 64;
/// Tolerance of a quaternion's squared length: 8-bit components, of which 255 represents 1.
const LENGTH_SLACK: f64 = 0.1;

/// True if most of the first rows are plausible splats: finite, no negative scales, and a unit quaternion.
/// Text and images are not.
pub(super) fn is_likely(bytes: &[u8]) -> bool {
    let probed = bytes.as_chunks::<ROW_BYTES>().0.iter().take(N_PROBED);
    let likely = |row: &&[u8; ROW_BYTES]| {
        let Record { mean, scale, rotation, .. } = Record::of(row);
        let length: f64 = rotation.iter().map(|v| v * v).sum();
        mean.is_finite()
            && scale.is_finite()
            && scale.min_element() >= 0.0
            && (length - 1.0).abs() < LENGTH_SLACK
    };
    // False for an empty file.
    2 * probed.clone().filter(likely).count() > probed.len()
}

pub(super) fn read_splat(bytes: &[u8], max_splats: usize) -> Result<Imported, Fault> {
    let (records, rest) = bytes.as_chunks::<ROW_BYTES>();
    if !rest.is_empty() {
        let expected = format!("a multiple of {ROW_BYTES} bytes");
        return Err(Fault::malformed(".splat", expected, format!("{} bytes", bytes.len())));
    }
    if records.len() > max_splats {
        return Err(Fault::TooMany { declared: records.len() as u64, cap: max_splats });
    }
    let mut rows = Rows::with_capacity(records.len())?;
    for record in records {
        let Record { mean, scale, color: [r, g, b, opacity], rotation } = Record::of(record);
        let rotation = rows.rotation(rotation);
        rows.push(Gaussian {
            mean,
            opacity,
            color: DVec3::new(r, g, b),
            // A negative standard deviation is invalid, so the row counts as not finite.
            scale: if scale.min_element() < 0.0 { DVec3::NAN } else { scale },
            rotation,
            directional: DMat3::ZERO,
        });
    }
    rows.finish(ModelKind::Splats, Vec::new(), Vec::new())
}

struct Record {
    mean: DVec3,
    scale: DVec3,
    /// Red, green, blue and opacity, 0 to 1.
    color: [f64; 4],
    /// `w x y z`; byte 128 is 0, with steps of 1/128.
    rotation: [f64; 4],
}

impl Record {
    fn of(row: &[u8; ROW_BYTES]) -> Self {
        let [x, y, z, sx, sy, sz, color, rotation]: [[u8; 4]; 8] = bytemuck::cast(*row);
        let vector = |numbers: [[u8; 4]; 3]| DVec3::from_array(numbers.map(float));
        Self {
            mean: vector([x, y, z]),
            scale: vector([sx, sy, sz]),
            color: color.map(|byte| f64::from(byte) / 255.0),
            rotation: rotation.map(|byte| (f64::from(byte) - 128.0) / 128.0),
        }
    }
}

fn float(bytes: [u8; 4]) -> f64 {
    f64::from(f32::from_le_bytes(bytes))
}
