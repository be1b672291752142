//! Import of SPZ versions 1 to 4.

use super::container;
use super::container::{MAGIC, Unpacked};
use super::quantise::{coefficient, color, first_three, fixed, half, scale, smallest_three};
use crate::export::error::Fault;
use crate::export::gaussian::{AxisRotation, Gaussian, harmonics_to_directional};
use crate::export::imported::{Imported, Intake, ModelKind, Note, Rows};
use glam::{DMat3, DVec3};

pub(in crate::export) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x1F, 0x8B])
}

/// True for a file of version 4, or of an older version without its gzip compression.
pub(in crate::export) fn is_plain(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

pub(in crate::export) fn spz(bytes: &[u8], intake: Intake) -> Result<Imported, Fault> {
    let mut file = match is_gzip(bytes) {
        true => container::gzip(bytes, intake.max_splats)?,
        false => container::plain(bytes, intake.max_splats)?,
    };
    let header = file.header;
    let mut notes = Vec::new();
    let n_coefficients = 3 * header.n_coefficients().saturating_sub(N_DEGREE_1);
    if n_coefficients > 0 {
        notes.push(Note::ViewDependentColorIgnored { n_coefficients });
    }
    if header.unknown_flags() != 0 {
        notes.push(Note::NotUsed { what: format!("flags {:#04x}", header.unknown_flags()) });
    }
    let turn = axes(&file.records, &mut notes).then(AxisRotation::Y_UP_TO_Z_UP);
    let is_directional = header.n_coefficients() > 0;
    let size = (bytes.len() as u64).saturating_mul(USUAL_FACTOR);
    let mut rows = Rows::with_capacity(header.n_splats as usize, is_directional, size, intake)?;
    for _ in 0..header.n_splats {
        let splat = splat(&mut file, &mut rows)?;
        rows.push(splat.rotated(&turn));
    }
    let imported = rows.finish(ModelKind::Splats, notes, Vec::new())?;
    let imported = if header.is_antialiased() { imported.antialiased() } else { imported };
    Ok(Imported { is_z_up: true, ..imported })
}

/// Type of the record `SPZ_ADOBE_coordinate_system`, which holds a number of a system of axes.
const AXES_RECORD: u32 = 0xADBE_0003;
/// Systems of axes by their numbers, 1 and up: the directions of x, y and z, left or right, down or up, back or
/// front.
const SYSTEMS: [&[u8; 3]; 16] = [
    b"LDB", b"RDB", b"LUB", b"RUB", b"LDF", b"RDF", b"LUF", b"RUF", b"LFD", b"RFD", b"LFU", b"RFU",
    b"LBD", b"RBD", b"LBU", b"RBU",
];

/// Returns the rotation or mirroring of the axes stated by the file to x right, y up and z back. Adds notes about
/// records that are not used.
fn axes(records: &[(u32, Vec<u8>)], notes: &mut Vec<Note>) -> AxisRotation {
    let number = |(kind, content): &(u32, Vec<u8>)| {
        let number = content.as_slice().try_into().ok().map(u32::from_le_bytes);
        number.filter(|_| *kind == AXES_RECORD)
    };
    // The last record applies, as in the reference reader.
    let used = records.iter().rposition(|record| number(record).is_some());
    let others = records.iter().enumerate().filter(|(i, _)| Some(*i) != used);
    let names =
        others.map(|(_, (kind, content))| format!("{kind:#010x} ({} bytes)", content.len()));
    let names: Vec<String> = names.take(MAX_NAMED_RECORDS).collect();
    notes.extend(Note::not_used("extension record", names.iter().map(String::as_str)));
    let Some(number) = used.and_then(|i| number(records.get(i)?)) else {
        return AxisRotation::IDENTITY;
    };
    let system = (number as usize).checked_sub(1).and_then(|i| SYSTEMS.get(i));
    let Some(system) = system else {
        let (name, used) = ("axis system", "right, up, back");
        notes.push(Note::Unsupported { name, value: number.to_string(), used });
        return AxisRotation::IDENTITY;
    };
    AxisRotation::from_axes(system.map(|letter| match letter {
        b'L' => DVec3::NEG_X,
        b'R' => DVec3::X,
        b'D' => DVec3::NEG_Y,
        b'U' => DVec3::Y,
        b'F' => DVec3::NEG_Z,
        _ => DVec3::Z,
    }))
}

const MAX_NAMED_RECORDS: usize = 8;
/// Largest factor by which columns of recorded scenes are compressed.
const USUAL_FACTOR: u64 = 5;

const N_DEGREE_1: usize = 3;
/// Largest number of harmonic coefficients per channel, of degree 4.
const MAX_COEFFICIENTS: usize = 24;

/// Reads the next splat.
fn splat(file: &mut Unpacked, rows: &mut Rows) -> Result<Gaussian, Fault> {
    let header = &file.header;
    let [positions, opacities, colors, scales, rotations, harmonics] = &mut file.columns;
    let mean = match header.version {
        1 => {
            let [a, b, c, d, e, f] = positions.next()?;
            [[a, b], [c, d], [e, f]].map(half)
        }
        _ => {
            let [a, b, c, d, e, f, g, h, j] = positions.next()?;
            [[a, b, c], [d, e, f], [g, h, j]].map(|bytes| fixed(bytes, header.fraction_bits))
        }
    };
    let rotation = match header.version {
        1 | 2 => first_three(rotations.next()?),
        _ => smallest_three(rotations.next()?),
    };
    let directional = match header.n_coefficients() {
        0 => DMat3::ZERO,
        n => {
            let mut bytes = [[0; 3]; MAX_COEFFICIENTS];
            harmonics.read(bytes.as_flattened_mut().get_mut(..3 * n).unwrap_or_default())?;
            let [first, second, third, ..] = bytes;
            let vector = |bytes: [u8; 3]| DVec3::from_array(bytes.map(coefficient));
            harmonics_to_directional([first, second, third].map(vector))
        }
    };
    let [opacity] = opacities.next()?;
    Ok(Gaussian {
        mean: DVec3::from_array(mean),
        opacity: f64::from(opacity) / 255.0,
        color: color(colors.next()?),
        scale: scale(scales.next()?),
        rotation: rows.rotation(rotation),
        directional,
    })
}
