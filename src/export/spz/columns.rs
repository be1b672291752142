//! What the columns of a file hold and how wide they are.

use crate::export::error::Fault;

/// The first bytes of a file, or of what its gzip holds.
pub(super) const MAGIC: &[u8] = b"NGSP";
/// Highest degree of harmonics that a file may have.
const MAX_DEGREE: u8 = 4;
/// Most bits behind the point of a coordinate: it has 24 in all.
const MAX_FRACTION_BITS: u8 = 24;
/// Bit of the flags: records of extensions are in the file.
const HAS_EXTENSIONS: u8 = 2;

/// The fields that every version's header starts with, behind magic and version.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpzHeader {
    pub version: u32,
    pub n_splats: u32,
    /// Degree of the harmonics, 0 to 4.
    pub degree: u8,
    /// Bits behind the point of coordinates.
    pub fraction_bits: u8,
    pub flags: u8,
    /// Number of compressed streams; 0 before version 4.
    pub n_streams: u8,
}

/// Bytes of magic, version and these fields.
pub(super) const HEADER_BYTES: usize = 16;

impl SpzHeader {
    /// From the first 16 bytes of a file, or of what its gzip holds.
    pub fn parse(bytes: &[u8; HEADER_BYTES]) -> Result<Self, Fault> {
        let &[magic @ .., v0, v1, v2, v3, n0, n1, n2, n3, degree, fraction_bits, flags, n_streams] =
            bytes;
        let version = u32::from_le_bytes([v0, v1, v2, v3]);
        let n_splats = u32::from_le_bytes([n0, n1, n2, n3]);
        let header = Self { version, n_splats, degree, fraction_bits, flags, n_streams };
        let fault =
            |expected: String, found: String| Err(Fault::malformed(HEADER, expected, found));
        if magic != MAGIC {
            return fault("\"NGSP\" at its start".into(), format!("{magic:02x?}"));
        }
        if !(1..=4).contains(&version) {
            return Err(Fault::Unsupported {
                feature: format!("{HEADER}: expected version 1 to 4, found {version}"),
                advice: "save the file as SPZ version 4 or as PLY",
            });
        }
        if degree > MAX_DEGREE {
            return fault(format!("harmonics of degree 0 to {MAX_DEGREE}"), degree.to_string());
        }
        if fraction_bits > MAX_FRACTION_BITS {
            let expected = format!("at most {MAX_FRACTION_BITS} bits behind the point");
            return fault(expected, fraction_bits.to_string());
        }
        Ok(header)
    }

    pub fn has_extensions(&self) -> bool {
        self.flags & HAS_EXTENSIONS != 0
    }

    /// Bytes a splat of each column, in file order: position, opacity, colour, scale, rotation and
    /// harmonics above degree 0.
    pub fn widths(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        [position, 1, 3, 3, rotation, 3 * self.n_coefficients()]
    }

    /// Coefficients per channel above degree 0.
    pub fn n_coefficients(&self) -> usize {
        let degree = usize::from(self.degree);
        (degree + 1) * (degree + 1) - 1
    }
}

pub(super) const HEADER: &str = "SPZ header";
/// The columns as messages name them.
pub(super) const COLUMN_NAMES: [&str; 6] =
    ["positions", "opacities", "colours", "scales", "rotations", "harmonics"];
