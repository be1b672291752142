//! PlayCanvas' compressed PLY (`files.md`, Compressed PLY). Splats form chunks of 256; each value is
//! quantised between the bounds of its chunk and packed into four words. Harmonics are bytes in a separate
//! element.

use super::body::{Body, pick};
use super::{PlyElement, PlyHeader};
use crate::export::error::{Fault, try_with_capacity};
use crate::export::gaussian::{Gaussian, harmonics_to_directional};
use crate::export::imported::{Imported, Intake, ModelKind, Note, Rows};
use glam::{DMat3, DVec3};
use std::f64::consts::SQRT_2;

/// Name of the element with the chunk bounds, which identifies the format.
pub(super) const CHUNK: &str = "chunk";
const CHUNK_SPLATS: usize = 256;
/// Number of spherical-harmonic coefficients above degree 0, in all channels together, for a maximum
/// degree of 1, 2 and 3.
const SH_COUNTS: [usize; 3] = [N_DEGREE_1, 24, 45];
/// Number of harmonic coefficients of degree 1, over all channels.
const N_DEGREE_1: usize = 9;
/// Largest magnitude of a quantised harmonic coefficient.
const SH_RANGE: f64 = 4.0;

pub(super) fn read(
    mut body: Body,
    header: PlyHeader,
    size: u64,
    intake: Intake,
) -> Result<Imported, Fault> {
    let max_splats = intake.max_splats;
    let (mut chunks, mut words, mut sh) = (None, None, None);
    for element in &header.elements {
        match element.name.as_str() {
            // A clone, because `skip` below advances over every element.
            CHUNK => chunks = Some(read_chunks(body.clone(), element, max_splats)?),
            "vertex" => words = Some(open_words(&body, element, max_splats)?),
            "sh" => sh = Some(open_harmonics(&body, element)?),
            _ => {}
        }
        body.skip(element)?;
    }
    let (Some(chunks), Some(mut words)) = (chunks, words) else {
        return Err(Fault::malformed("header", "an element vertex beside element chunk", "none"));
    };
    let n = words.n_rows;
    if chunks.len() != n.div_ceil(CHUNK_SPLATS) {
        let expected = format!("{} chunks for {n} splats", n.div_ceil(CHUNK_SPLATS));
        return Err(Fault::malformed("element chunk", expected, chunks.len().to_string()));
    }
    if let Some(sh) = sh.as_ref().filter(|sh| sh.n_rows != n) {
        let expected = format!("{n} rows, as many as element vertex");
        return Err(Fault::malformed("element sh", expected, sh.n_rows.to_string()));
    }
    let names = header.elements.iter().map(|element| element.name.as_str());
    let others = names.filter(|name| ![CHUNK, "vertex", "sh"].contains(name));
    let mut notes: Vec<Note> = Note::not_used("element", others).into_iter().collect();
    let mut rows = Rows::with_capacity(n, sh.is_some(), size, intake)?;
    let extremes = chunks.iter().flat_map(|chunk| std::iter::repeat_n(chunk, CHUNK_SPLATS));
    for (i, extremes) in (0..n).zip(extremes) {
        // Exact: f64 holds all integers of 32 bits.
        let [position, rotation, scale, color] = words.row(i)?.map(|word| word as u32);
        let [r, g, b, opacity] = unpack_fractions(color, [8, 8, 8, 8]);
        let rotation = rows.rotation(smallest_three(rotation));
        let directional = match &mut sh {
            Some(sh) => directional(sh.row(i)?),
            None => DMat3::ZERO,
        };
        rows.push(Gaussian {
            mean: extremes.position.at(DVec3::from_array(unpack_fractions(position, [11, 10, 11]))),
            opacity,
            color: extremes.color.at(DVec3::new(r, g, b)),
            scale: extremes
                .scale
                .at(DVec3::from_array(unpack_fractions(scale, [11, 10, 11])))
                .exp(),
            rotation,
            directional,
            seen: DVec3::ZERO,
        });
    }
    let n_coefficients = sh.map_or(0, |sh| sh.values.len() - N_DEGREE_1);
    if n_coefficients > 0 {
        notes.push(Note::ViewDependentColorIgnored { n_coefficients });
    }
    rows.finish(ModelKind::Splats, notes, header.comments)
}

struct ChunkBounds {
    position: Bounds,
    /// Bounds of the scales, as natural logarithms.
    scale: Bounds,
    color: Bounds,
}

#[derive(Clone, Copy)]
struct Bounds {
    min: DVec3,
    max: DVec3,
}

impl Bounds {
    fn at(&self, share: DVec3) -> DVec3 {
        self.min * (1.0 - share) + self.max * share
    }
}

fn read_chunks(
    mut body: Body,
    element: &PlyElement,
    max_splats: usize,
) -> Result<Vec<ChunkBounds>, Fault> {
    let between = |prefix: &str, axes: [&str; 3]| {
        let all = |end: &str| columns(element, axes.map(|axis| format!("{end}_{prefix}{axis}")));
        Ok::<[[usize; 3]; 2], Fault>([all("min")?, all("max")?])
    };
    let position = between("", ["x", "y", "z"])?;
    let scale = between("scale_", ["x", "y", "z"])?;
    // Early files have no colour bounds; colours are fractions of 1.
    let color = between("", ["r", "g", "b"]).ok();
    let n = body.n_rows(element)?;
    if n > max_splats.div_ceil(CHUNK_SPLATS) {
        let declared = (n as u64).saturating_mul(CHUNK_SPLATS as u64);
        return Err(Fault::TooMany { declared, cap: max_splats });
    }
    let mut rows = try_with_capacity(n)?;
    let mut values = vec![0.0; element.properties.len()];
    for row in 0..n {
        body.read_row(element, row, &mut values)?;
        let vector = |columns: [usize; 3]| DVec3::from_array(pick(&values, columns));
        let of = |[min, max]: [[usize; 3]; 2]| Bounds { min: vector(min), max: vector(max) };
        let unit = Bounds { min: DVec3::ZERO, max: DVec3::ONE };
        let color = color.map_or(unit, of);
        rows.push(ChunkBounds { position: of(position), scale: of(scale), color });
    }
    Ok(rows)
}

/// Chosen columns of an element, read row by row.
struct Table<'a, const N: usize> {
    body: Body<'a>,
    element: &'a PlyElement,
    n_rows: usize,
    columns: [usize; N],
    values: Vec<f64>,
}

impl<'a, const N: usize> Table<'a, N> {
    fn open(body: &Body<'a>, element: &'a PlyElement, columns: [usize; N]) -> Result<Self, Fault> {
        let n_rows = body.n_rows(element)?;
        let values = vec![0.0; element.properties.len()];
        Ok(Self { body: body.clone(), element, n_rows, columns, values })
    }

    fn row(&mut self, i: usize) -> Result<[f64; N], Fault> {
        self.body.read_row(self.element, i, &mut self.values)?;
        Ok(pick(&self.values, self.columns))
    }
}

fn open_words<'a>(
    body: &Body<'a>,
    element: &'a PlyElement,
    max_splats: usize,
) -> Result<Table<'a, 4>, Fault> {
    let names = ["packed_position", "packed_rotation", "packed_scale", "packed_color"];
    let words = Table::open(body, element, columns(element, names)?)?;
    match words.n_rows > max_splats {
        true => Err(Fault::TooMany { declared: element.count, cap: max_splats }),
        false => Ok(words),
    }
}

/// Opens the columns of the degree 1 harmonics, ordered by coefficient, then by channel.
fn open_harmonics<'a>(
    body: &Body<'a>,
    element: &'a PlyElement,
) -> Result<Table<'a, N_DEGREE_1>, Fault> {
    let n = element.properties.len();
    if !SH_COUNTS.contains(&n) {
        let expected = "9, 24 or 45 coefficients";
        return Err(Fault::malformed("element sh", expected, n.to_string()));
    }
    // In the file, channel by channel, each with a third of the coefficients.
    let names = std::array::from_fn(|i| format!("f_rest_{}", i % 3 * n / 3 + i / 3));
    Table::open(body, element, columns(element, names)?)
}

fn directional(bytes: [f64; N_DEGREE_1]) -> DMat3 {
    // The end codes are the exact limits, the others the middles of their intervals.
    let [a, b, c, d, e, f, g, h, i] = bytes.map(|byte| match byte {
        0.0 => -SH_RANGE,
        255.0 => SH_RANGE,
        byte => ((byte + 0.5) / 256.0 - 0.5) * 2.0 * SH_RANGE,
    });
    harmonics_to_directional([DVec3::new(a, b, c), DVec3::new(d, e, f), DVec3::new(g, h, i)])
}

fn columns<const N: usize>(
    element: &PlyElement,
    names: [impl AsRef<str>; N],
) -> Result<[usize; N], Fault> {
    let mut columns = [0; N];
    for (column, name) in columns.iter_mut().zip(&names) {
        let name = name.as_ref();
        *column = element.column(name).ok_or_else(|| {
            Fault::malformed(element.place(), format!("property {name}"), "none of that name")
        })?;
    }
    Ok(columns)
}

/// Splits a word into fields of the given numbers of bits, each as a fraction of its maximum. The first
/// field has the highest bits.
fn unpack_fractions<const N: usize>(word: u32, bits: [u32; N]) -> [f64; N] {
    let mut shift: u32 = bits.iter().sum();
    bits.map(|n| {
        shift -= n;
        let largest = (1u32 << n) - 1;
        f64::from(word >> shift & largest) / f64::from(largest)
    })
}

/// Unpacks a rotation to the quaternion `w x y z`. The upper two bits give the index of the largest
/// component. The other bits give the other three components as fractions of the range from −√½ to √½.
fn smallest_three(word: u32) -> [f64; 4] {
    let [a, b, c] = unpack_fractions(word & 0x3FFF_FFFF, [10, 10, 10]).map(|s| (s - 0.5) * SQRT_2);
    // The quantised components may be longer than 1 together.
    let largest = (1.0 - a * a - b * b - c * c).max(0.0).sqrt();
    match word >> 30 {
        0 => [largest, a, b, c],
        1 => [a, largest, b, c],
        2 => [a, b, largest, c],
        _ => [a, b, c, largest],
    }
}
