//! Splats as OpenUSD in text form (`files.md`, USD): one `ParticleField3DGaussianSplat` of OpenUSD 26.03.
//!
//! The text is written by hand: a file of this schema has two kinds of lines, and crates of USD need newer compilers or
//! the C++ library.

use super::format::WriteOptions;
use super::gaussian::{Gaussian, color_to_harmonic, directional_to_harmonics, wxyz};
use super::source::Placement;
use super::stream::{ProgressCounter, SplatRows, write_rows};
use glam::DVec3;
use rayon::prelude::*;
use std::io;
use std::io::Write;

/// Visible extent of a splat from its centre, in standard deviations, for the bounds of the field.
const EXTENT_SIGMAS: f64 = 3.0;
/// Name of the prim.
const PRIM: &str = "Splats";

/// Appends the value of a row to an array.
type Encode = fn(&Gaussian, &mut Vec<u8>);

pub(super) struct UsdLayout {
    start: String,
    /// Declarations of arrays, and the encoders of their values.
    arrays: Vec<(&'static str, Encode)>,
}

impl UsdLayout {
    pub fn new(rows: &impl SplatRows, options: &WriteOptions) -> Self {
        let has_directions = rows.has_directions();
        let arrays: Vec<(&str, Encode)> = vec![
            ("point3f[] positions", |g, row| put_tuple(row, &g.mean.to_array())),
            ("quatf[] orientations", |g, row| put_tuple(row, &wxyz(g.rotation))),
            ("float3[] scales", |g, row| put_tuple(row, &g.scale.to_array())),
            ("float[] opacities", |g, row| put_number(row, g.opacity)),
            match has_directions {
                true => (HARMONICS, put_degree_1),
                false => {
                    (HARMONICS, |g, row| put_tuple(row, &color_to_harmonic(g.color).to_array()))
                }
            },
        ];
        Self { start: start(rows, options), arrays }
    }

    pub fn n_columns(&self) -> usize {
        self.arrays.len()
    }

    pub fn write(
        &self,
        out: &mut dyn Write,
        rows: &impl SplatRows,
        steps: &mut ProgressCounter,
    ) -> io::Result<()> {
        out.write_all(self.start.as_bytes())?;
        for (declaration, encode) in &self.arrays {
            write!(out, "    {declaration} = [")?;
            write_rows(out, rows.n_rows(), steps, |i, bytes| {
                if i > 0 {
                    bytes.extend(b", ");
                }
                encode(&rows.row(i), bytes);
            })?;
            out.write_all(b"]\n")?;
        }
        out.write_all(b"}\n")
    }
}

const HARMONICS: &str = "float3[] radiance:sphericalHarmonicsCoefficients";

fn put_degree_1(g: &Gaussian, row: &mut Vec<u8>) {
    put_tuple(row, &color_to_harmonic(g.color).to_array());
    for coefficient in directional_to_harmonics(g.directional) {
        row.extend(b", ");
        put_tuple(row, &coefficient.to_array());
    }
}

fn put_tuple(row: &mut Vec<u8>, values: &[f64]) {
    for (i, value) in values.iter().enumerate() {
        row.extend(if i == 0 { &b"("[..] } else { b", " });
        put_number(row, *value);
    }
    row.push(b')');
}

/// Writes the shortest decimal number that is read as the same f32.
fn put_number(row: &mut Vec<u8>, value: f64) {
    row.extend((value as f32).to_string().bytes());
}

/// Returns the text up to the first array.
fn start(rows: &impl SplatRows, options: &WriteOptions) -> String {
    let none = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let merge = |(a, b): (DVec3, DVec3), (c, d): (DVec3, DVec3)| (a.min(c), b.max(d));
    let bounds = (0..rows.n_rows()).into_par_iter().map(|i| {
        let g = rows.row(i);
        let reach = DVec3::splat(EXTENT_SIGMAS * g.scale.max_element());
        (g.mean - reach, g.mean + reach)
    });
    let (low, high) = bounds.reduce(|| none, merge);
    let tuple = |v: DVec3| {
        let mut text = Vec::new();
        put_tuple(&mut text, &v.to_array());
        String::from_utf8_lossy(&text).into_owned()
    };
    // Without metres in the world, a unit counts as one, because USD's default is a centimetre.
    let metres = 1.0 / options.unit_scale;
    let units = if options.is_metric() { "known" } else { "unknown: taken as metres" };
    let comments: String = options.comments.iter().map(|line| format!("# {line}\n")).collect();
    let Placement { origin, .. } = Placement::of(options);
    let translation = match origin == DVec3::ZERO {
        true => String::new(),
        false => {
            let [x, y, z] = origin.to_array();
            format!(
                "    double3 xformOp:translate = ({x}, {y}, {z})\n    uniform token[] xformOpOrder = [\"xformOp:translate\"]\n"
            )
        }
    };
    let degree = u8::from(rows.has_directions());
    format!(
        "#usda 1.0\n{comments}(\n    defaultPrim = \"{PRIM}\"\n    doc = \"vbgs-studio {}; units {units}\"\n    \
         metersPerUnit = {metres}\n    upAxis = \"Y\"\n)\n\ndef ParticleField3DGaussianSplat \"{PRIM}\"\n{{\n    \
         float3[] extent = [{}, {}]\n{translation}    \
         uniform token projectionModeHint = \"perspective\"\n    \
         uniform token sortingModeHint = \"cameraDistance\"\n    \
         uniform int radiance:sphericalHarmonicsDegree = {degree}\n",
        env!("CARGO_PKG_VERSION"),
        tuple(low),
        tuple(high),
    )
}
