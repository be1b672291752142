//! Splats as SPZ version 2, 3 or 4.
//!
//! Splats are written along a space-filling curve, so that neighbours are similar and compress well.
//! Coordinates are rounded to an eighth of a small splat's size. The rounding is invisible, and further
//! bits would be incompressible noise.

use super::quantise::{
    coefficient, fixed, scale, to_coefficient, to_color, to_first_three, to_fixed, to_opacity,
    to_scale, to_smallest_three,
};
use super::read::{COLUMN_NAMES, IS_ANTIALIASED, MAGIC, NGSP_BYTES};
use crate::export::error::Fault;
use crate::export::format::SpzVersion;
use crate::export::gaussian::{Gaussian, directional_to_harmonics, harmonics_to_directional};
use crate::export::stream::{
    CURVE_BITS, ProgressCounter, SplatRows, morton_order, small_quantile, write_rows,
};
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use rayon::prelude::*;
use std::io;
use std::io::Write;

/// Zstandard compression level.
// Higher levels take twice as long for 1 % of the size.
const LEVEL: i32 = 9;
/// Rounding step of coordinates, relative to the middle one of a small splat's three standard
/// deviations.
const STEP_OF_DEVIATION: f64 = 1.0 / 8.0;
/// Number of bits of a coordinate without its sign.
const COORDINATE_BITS: i32 = 23;
/// Maximum number of fraction bits of a coordinate.
// Every reader accepts these.
const MAX_FRACTION_BITS: i32 = 20;

pub(in crate::export) struct SpzLayout {
    order: Vec<u32>,
    fraction_bits: u8,
    degree: u8,
    version: SpzVersion,
    is_antialiased: bool,
}

impl SpzLayout {
    /// Prepares the layout of a file for the given splats. Fails if coordinates are too large for 24
    /// bits.
    pub fn new(
        rows: &impl SplatRows,
        version: SpzVersion,
        is_antialiased: bool,
    ) -> Result<Self, Fault> {
        let largest = (0..rows.n_rows())
            .into_par_iter()
            .map(|i| rows.row(i).mean.abs().max_element())
            .reduce(|| 0.0, f64::max);
        let fraction_bits = fraction_bits(rows, largest)?;
        let order = file_order(rows, fraction_bits);
        let degree = u8::from(rows.has_directions());
        Ok(Self { order, fraction_bits, degree, version, is_antialiased })
    }

    pub fn n_columns(&self) -> usize {
        if self.degree == 0 { COLUMN_NAMES.len() - 1 } else { COLUMN_NAMES.len() }
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        rows: &impl SplatRows,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        let row = |i: usize| rows.row(self.order[i] as usize);
        if self.version != SpzVersion::V4 {
            let mut gzip = GzEncoder::new(out, Compression::default());
            gzip.write_all(&self.header(0))?;
            for (encode, _) in self.encoders() {
                write_rows(&mut gzip, self.order.len(), steps, |i, bytes| encode(&row(i), bytes))?;
            }
            return gzip.finish().map(drop);
        }
        // All columns are compressed in memory first, because their lengths precede them.
        let mut columns = Vec::new();
        for (encode, width) in self.encoders() {
            let unpacked = (self.order.len() * width) as u64;
            let mut encoder = zstd::Encoder::new(Vec::new(), LEVEL)?;
            encoder.set_pledged_src_size(Some(unpacked))?;
            write_rows(&mut encoder, self.order.len(), steps, |i, bytes| encode(&row(i), bytes))?;
            columns.push((encoder.finish()?, unpacked));
        }
        out.write_all(&self.header(columns.len()))?;
        for (packed, unpacked) in &columns {
            out.write_all(&(packed.len() as u64).to_le_bytes())?;
            out.write_all(&unpacked.to_le_bytes())?;
        }
        columns.iter().try_for_each(|(packed, _)| out.write_all(packed))
    }

    fn header(&self, n_streams: usize) -> Vec<u8> {
        let mut header = MAGIC.to_vec();
        header.extend((self.version as u32).to_le_bytes());
        header.extend((self.order.len() as u32).to_le_bytes());
        // This program's own splats have no flag: they were not made for viewers that lower opacities.
        let flags = if self.is_antialiased { IS_ANTIALIASED } else { 0 };
        header.extend([self.degree, self.fraction_bits, flags, n_streams as u8]);
        if self.version == SpzVersion::V4 {
            header.extend((NGSP_BYTES as u32).to_le_bytes());
            header.resize(NGSP_BYTES, 0);
        }
        header
    }

    fn encoders(&self) -> Vec<(Encode, usize)> {
        let bits = self.fraction_bits;
        let mut encoders: Vec<(Encode, usize)> = vec![
            (
                Box::new(move |g, row| {
                    g.mean.to_array().iter().for_each(|&v| row.extend(to_fixed(v, bits)));
                }),
                9,
            ),
            (Box::new(|g, row| row.push(to_opacity(g.opacity))), 1),
            (Box::new(|g, row| row.extend(to_color(color(g)))), 3),
            (Box::new(|g, row| row.extend(to_scale(g.scale))), 3),
        ];
        encoders.push(match self.version {
            SpzVersion::V2 => (Box::new(|g, row| row.extend(to_first_three(g.rotation))), 3),
            _ => (Box::new(|g, row| row.extend(to_smallest_three(g.rotation))), 4),
        });
        if self.degree > 0 {
            let harmonics = |g: &Gaussian, row: &mut Vec<u8>| {
                let coefficients = directional_to_harmonics(g.directional);
                row.extend(coefficients.iter().flat_map(DVec3::to_array).map(to_coefficient));
            };
            encoders.push((Box::new(harmonics), 9));
        }
        encoders
    }
}

/// Returns the colour with what rounding takes off the harmonics in the mean direction from which the splat was observed.
fn color(g: &Gaussian) -> DVec3 {
    let held = |v: f64| coefficient(to_coefficient(v));
    let stored = directional_to_harmonics(g.directional).map(|v| v.map(held));
    g.with_slope(harmonics_to_directional(stored)).color
}

type Encode = Box<dyn Fn(&Gaussian, &mut Vec<u8>) + Sync>;

fn fraction_bits(rows: &impl SplatRows, largest: f64) -> Result<u8, Fault> {
    // Bits left after the integer part.
    let room = COORDINATE_BITS - largest.max(f64::MIN_POSITIVE).log2().floor() as i32 - 1;
    if room < 0 {
        return Err(Fault::setting(
            "SPZ",
            format!("coordinates below {}", 1 << COORDINATE_BITS),
            format!("{largest}; use a smaller unit scale or export PLY"),
        ));
    }
    // Quantised as in the file, so that a file that was read gets the same fraction bits again.
    let middle = |g: &Gaussian| Gaussian { scale: scale(to_scale(g.scale)), ..*g }.middle_scale();
    let small = small_quantile(rows, middle);
    let needed = -(small * STEP_OF_DEVIATION).log2().floor() as i32;
    Ok(needed.clamp(0, MAX_FRACTION_BITS).min(room) as u8)
}

/// Returns the order of the rows along a Morton curve through the cube of all representable coordinates.
fn file_order(rows: &impl SplatRows, fraction_bits: u8) -> Vec<u32> {
    // Quantised coordinates, so that a file that was read keeps its order.
    let cell = |v: f64| {
        let held = (fixed(to_fixed(v, fraction_bits), 0) as i64 + (1 << COORDINATE_BITS)) as u64;
        held >> (COORDINATE_BITS as u32 + 1 - CURVE_BITS)
    };
    morton_order(rows.n_rows(), |i| rows.row(i).mean.to_array().map(cell))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Rows(Vec<Gaussian>, bool);

    impl SplatRows for Rows {
        fn n_rows(&self) -> usize {
            self.0.len()
        }

        fn row(&self, row: usize) -> Gaussian {
            self.0[row]
        }

        fn has_directions(&self) -> bool {
            self.1
        }
    }

    fn rows(places: &[[f64; 3]], has_directions: bool) -> Rows {
        let row = |mean: &[f64; 3]| Gaussian { mean: (*mean).into(), ..Gaussian::INVISIBLE };
        Rows(places.iter().map(row).collect(), has_directions)
    }

    #[test]
    fn splats_follow_a_morton_curve_of_cells_of_eight_steps() {
        // From z, the highest axis of the curve, to x; the fourth and the fifth share a cell.
        let above = [[0.0, 0.0, 8.0], [0.0, 8.0, 0.0], [8.0, 0.0, 0.0], [7.0, 0.0, 0.0], [0.0; 3]];
        let below = [[-8.0, 0.0, 0.0], [0.0, -8.0, 0.0], [0.0, 0.0, -8.0]];
        let places = [&above[..], &below[..]].concat();
        assert_eq!(file_order(&rows(&places, false), 0), [7, 6, 5, 3, 4, 2, 1, 0]);
    }

    #[test]
    fn columns_and_fraction_bits_fit_the_splats() {
        let layout = |has_directions| {
            SpzLayout::new(&rows(&[[0.0; 3]], has_directions), SpzVersion::V4, false).unwrap()
        };
        assert_eq!([false, true].map(|directions| layout(directions).n_columns()), [5, 6]);
        let of = |x: f64| fraction_bits(&rows(&[[x, 0.0, 0.0]], false), x);
        assert_eq!((of(5e6).unwrap(), of(4e6).unwrap()), (0, 1));
        assert!(of(9e6).is_err());
    }
}
