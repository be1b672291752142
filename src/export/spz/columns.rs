//! Header of an SPZ, and names and widths of its columns.

use crate::export::error::Fault;

/// First bytes of a file, or of its gzip content.
pub(super) const MAGIC: &[u8] = b"NGSP";
/// Highest permitted degree of harmonics.
const MAX_DEGREE: u8 = 4;
/// Maximum number of fraction bits of a 24-bit coordinate.
const MAX_FRACTION_BITS: u8 = 24;
/// Flag bit: the file has extension records.
const HAS_EXTENSIONS: u8 = 2;

/// Header fields common to all versions.
#[derive(Clone, Copy, Debug)]
pub(super) struct SpzHeader {
    pub version: u32,
    pub n_splats: u32,
    /// Degree of the harmonics, 0 to 4.
    pub degree: u8,
    /// Fraction bits of coordinates.
    pub fraction_bits: u8,
    pub flags: u8,
    /// Number of compressed streams; 0 before version 4.
    pub n_streams: u8,
}

/// Bytes of magic, version and these fields.
pub(super) const HEADER_BYTES: usize = 16;

impl SpzHeader {
    /// Parses the first 16 bytes of a file, or of its gzip content.
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
            let expected = format!("at most {MAX_FRACTION_BITS} fraction bits");
            return fault(expected, fraction_bits.to_string());
        }
        Ok(header)
    }

    pub fn has_extensions(&self) -> bool {
        self.flags & HAS_EXTENSIONS != 0
    }

    /// Bytes per splat of each column, in file order: position, opacity, colour, scale, rotation and
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
pub(super) const COLUMN_NAMES: [&str; 6] =
    ["positions", "opacities", "colours", "scales", "rotations", "harmonics"];
