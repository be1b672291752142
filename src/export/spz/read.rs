//! Import of SPZ versions 1 to 4.

use super::container;
use super::container::{MAGIC, Unpacked};
use super::quantise::{coefficient, color, first_three, fixed, half, scale, smallest_three};
use crate::export::error::Fault;
use crate::export::gaussian::{AxisRotation, Gaussian, harmonics_to_directional};
use crate::export::imported::{Imported, ModelKind, Note, Rows};
use glam::{DMat3, DVec3};

pub(in crate::export) fn is_gzip(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x1F, 0x8B])
}

/// True for a file of version 4, or of an older version without its gzip compression.
pub(in crate::export) fn is_plain(bytes: &[u8]) -> bool {
    bytes.starts_with(MAGIC)
}

pub(in crate::export) fn spz(bytes: &[u8], max_splats: usize) -> Result<Imported, Fault> {
    let file = match is_gzip(bytes) {
        true => container::gzip(bytes, max_splats)?,
        false => container::plain(bytes, max_splats)?,
    };
    let header = file.header;
    let mut notes = Vec::new();
    let n_coefficients = 3 * header.n_coefficients().saturating_sub(N_DEGREE_1);
    if n_coefficients > 0 {
        notes.push(Note::ViewDependentColorIgnored { n_coefficients });
    }
    if header.has_extensions() {
        notes.push(Note::ExtensionsIgnored);
    }
    let mut rows = Rows::with_capacity(header.n_splats as usize)?;
    for i in 0..header.n_splats as usize {
        let splat = splat(&file, i, &mut rows);
        rows.push(splat.rotated(&AxisRotation::Y_UP_TO_Z_UP));
    }
    let imported = rows.finish(ModelKind::Splats, notes, Vec::new())?;
    Ok(Imported { is_z_up: true, ..imported })
}

const N_DEGREE_1: usize = 3;

fn splat(file: &Unpacked, i: usize, rows: &mut Rows) -> Gaussian {
    let header = &file.header;
    let [positions, opacities, colors, scales, rotations, harmonics] = &file.columns;
    let mean = match header.version {
        1 => {
            let [a, b, c, d, e, f] = row(positions, i);
            [[a, b], [c, d], [e, f]].map(half)
        }
        _ => {
            let [a, b, c, d, e, f, g, h, j] = row(positions, i);
            [[a, b, c], [d, e, f], [g, h, j]].map(|bytes| fixed(bytes, header.fraction_bits))
        }
    };
    let rotation = match header.version {
        1 | 2 => first_three(row(rotations, i)),
        _ => smallest_three(row(rotations, i)),
    };
    let directional = match header.n_coefficients() {
        0 => DMat3::ZERO,
        n => {
            let coefficients = harmonics.get(i * 3 * n..).unwrap_or_default();
            let of = |k: usize| DVec3::from_array(row(coefficients, k).map(coefficient));
            harmonics_to_directional([of(0), of(1), of(2)])
        }
    };
    let [opacity] = row(opacities, i);
    Gaussian {
        mean: DVec3::from_array(mean),
        opacity: f64::from(opacity) / 255.0,
        color: color(row(colors, i)),
        scale: scale(row(scales, i)),
        rotation: rows.rotation(rotation),
        directional,
    }
}

fn row<const N: usize>(column: &[u8], i: usize) -> [u8; N] {
    // Never missing: columns have the bytes of all splats.
    column.as_chunks().0.get(i).copied().unwrap_or([0; N])
}
