//! Sections of a mixture. The model has rows of sums, the file has columns.

use super::super::error::try_with_capacity;
use super::container::{Container, Section};
use super::element::Stored;
use super::error::Defect;
use super::sections::{F32, F64, I64, I128, check_size, rows, wrong_type};
use super::{check, sections};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::model::conjugate::prior::Hyper;
use crate::model::conjugate::statistics::N_SUMS;
use crate::model::paper::state::{Carry, InitialMeans, ModelState, Totals};
use bytemuck::{Pod, pod_read_unaligned};

/// Number of first moments per component: three of space, then three of colour.
const N_FIRST: usize = 6;
const N_SECOND: usize = 6;

pub(super) fn sections<'a>(
    normalization: &'a Normalization,
    hyper: &Hyper,
    state: &'a ModelState,
) -> Vec<Section<'a>> {
    // In the order of the file format, which `hyper` below reads.
    let prior = vec![
        hyper.alpha0,
        hyper.kappa0_space,
        hyper.kappa_init_space,
        hyper.u0_space,
        hyper.nu0,
        hyper.kappa0_color,
        hyper.kappa_init_color,
        hyper.u0_color,
    ];
    let mut sections = vec![
        Section::new(sections::NORMALIZATION, &normalization.offset).extended(&normalization.scale),
        Section::owned::<f64>(sections::PRIOR, prior),
        Section::new(sections::ALPHA, &state.alpha_init),
        means_section(&state.means),
    ];
    sections.extend(totals_sections(&state.totals));
    sections
}

fn means_section(means: &InitialMeans) -> Section<'_> {
    match means {
        InitialMeans::F32 { space, color } => columns_of(space, color),
        InitialMeans::F64 { space, color } => columns_of(space, color),
    }
}

fn columns_of<'a, T: Stored>(space: &'a [[T; 3]], color: &'a [[T; 3]]) -> Section<'a> {
    Section::new(sections::MEANS, space.as_flattened()).extended(color.as_flattened())
}

fn totals_sections<'a>(totals: &Totals) -> Vec<Section<'a>> {
    match totals {
        Totals::Fixed64 { rows, carries } => {
            let mut sections = split_rows(rows);
            // Zero carries are left out, so that equal sums have equal bytes.
            let carries = carries.iter().filter(|carry| carry.limbs != [0; N_SUMS]);
            let ids: Vec<u32> = carries.clone().map(|carry| carry.id).collect();
            if !ids.is_empty() {
                let limbs = carries.flat_map(|carry| carry.limbs).collect();
                sections.push(Section::owned(sections::CARRY_IDS, ids));
                sections.push(Section::owned::<i32>(sections::CARRY_LIMBS, limbs));
            }
            sections
        }
        Totals::Fixed128(rows) => split_rows(rows),
    }
}

fn split_rows<'a, T: Stored>(rows: &[[T; N_SUMS]]) -> Vec<Section<'a>> {
    // Columns, not rows: a section holds numbers of one kind.
    let mut counts = Vec::with_capacity(rows.len());
    let mut first = Vec::with_capacity(rows.len() * N_FIRST);
    let mut second = Vec::with_capacity(rows.len() * N_SECOND);
    for &[n, ax, ay, az, xx, xy, xz, yy, yz, zz, r, g, b] in rows {
        counts.push(n);
        first.extend_from_slice(&[ax, ay, az, r, g, b]);
        second.extend_from_slice(&[xx, xy, xz, yy, yz, zz]);
    }
    vec![
        Section::owned(sections::COUNTS, counts),
        Section::owned(sections::FIRST, first),
        Section::owned(sections::SECOND, second),
    ]
}

pub(super) fn read(sections: &Container) -> Result<StoredModel, Defect> {
    let alpha_init: Vec<f64> = sections.elements(sections::ALPHA, None)?;
    let n = alpha_init.len();
    // This number of components determines the sizes of all other sections.
    check_size(sections::ALPHA, 1, n)?;
    let state = ModelState { alpha_init, means: means(sections, n)?, totals: totals(sections, n)? };
    check::check_mixture(&state)?;
    let (normalization, hyper) = (normalization(sections)?, hyper(sections, n)?);
    Ok(StoredModel::Mixture { normalization, hyper, state })
}

fn normalization(sections: &Container) -> Result<Normalization, Defect> {
    let [ox, oy, oz, sx, sy, sz] = sections.read_numbers(sections::NORMALIZATION)?;
    let normalization = Normalization { offset: [ox, oy, oz], scale: [sx, sy, sz] };
    check::check_normalization(&normalization)?;
    Ok(normalization)
}

fn hyper(sections: &Container, components: usize) -> Result<Hyper, Defect> {
    let numbers = sections.read_numbers::<8>(sections::PRIOR)?;
    check::check_prior(&numbers)?;
    let [alpha0, kappa0_space, kappa_init_space, u0_space, nu0, rest @ ..] = numbers;
    let [kappa0_color, kappa_init_color, u0_color] = rest;
    Ok(Hyper {
        components,
        alpha0,
        kappa0_space,
        kappa_init_space,
        u0_space,
        nu0,
        kappa0_color,
        kappa_init_color,
        u0_color,
    })
}

fn means(sections: &Container, n: usize) -> Result<InitialMeans, Defect> {
    match sections.find(sections::MEANS)?.1 {
        F32 => {
            let [space, color] = means_of(sections, n)?;
            Ok(InitialMeans::F32 { space, color })
        }
        F64 => {
            let [space, color] = means_of(sections, n)?;
            Ok(InitialMeans::F64 { space, color })
        }
        code => Err(wrong_type(sections::MEANS, "F32 or F64", code)),
    }
}

fn means_of<T: Stored>(sections: &Container, n: usize) -> Result<[Vec<[T; 3]>; 2], Defect> {
    let bytes = sections.bytes::<T>(sections::MEANS, Some(6 * n))?;
    // All of space precedes all of colour.
    let (space, color) = bytes.split_at(bytes.len() / 2);
    Ok([rows(space)?, rows(color)?])
}

fn totals(sections: &Container, n: usize) -> Result<Totals, Defect> {
    let (_, form) = sections.find(sections::COUNTS)?;
    // Carries extend 64-bit sums; with wider sums they have no meaning.
    if form != I64 && sections.has(sections::CARRY_IDS) {
        let expected = "I64 sums beside carries";
        return Err(wrong_type(sections::COUNTS, expected, form));
    }
    match form {
        I64 => {
            let rows = sums(sections, n)?;
            let mut carries = Vec::new();
            if sections.has(sections::CARRY_IDS) {
                let ids = sections.bytes::<u32>(sections::CARRY_IDS, None)?;
                let n = ids.len() / size_of::<u32>();
                let limbs = sections.bytes::<i32>(sections::CARRY_LIMBS, Some(N_SUMS * n))?;
                carries = join_carries(ids, limbs, try_with_capacity(n).map_err(Defect::Memory)?);
            }
            Ok(Totals::Fixed64 { rows, carries })
        }
        I128 => Ok(Totals::Fixed128(sums(sections, n)?)),
        code => Err(wrong_type(sections::COUNTS, "I64 or I128", code)),
    }
}

fn sums<T: Stored>(sections: &Container, n: usize) -> Result<Vec<[T; N_SUMS]>, Defect> {
    let columns = [
        sections.bytes::<T>(sections::COUNTS, Some(n))?,
        sections.bytes::<T>(sections::FIRST, Some(N_FIRST * n))?,
        sections.bytes::<T>(sections::SECOND, Some(N_SECOND * n))?,
    ];
    Ok(join_rows(columns, try_with_capacity(n).map_err(Defect::Memory)?))
}

fn join_rows<T: Pod>(
    [counts, first, second]: [&[u8]; 3],
    mut rows: Vec<[T; N_SUMS]>,
) -> Vec<[T; N_SUMS]> {
    let size = size_of::<T>();
    // Unaligned reads: the file's bytes may start at any address, and an `i128` needs 16-byte alignment.
    let counts = counts.chunks_exact(size);
    let first = first.chunks_exact(N_FIRST * size);
    let second = second.chunks_exact(N_SECOND * size);
    rows.extend(counts.zip(first).zip(second).map(|((n, first), second)| {
        let n = pod_read_unaligned(n);
        let [ax, ay, az, r, g, b]: [T; N_FIRST] = pod_read_unaligned(first);
        let [xx, xy, xz, yy, yz, zz]: [T; N_SECOND] = pod_read_unaligned(second);
        [n, ax, ay, az, xx, xy, xz, yy, yz, zz, r, g, b]
    }));
    rows
}

fn join_carries(ids: &[u8], limbs: &[u8], mut carries: Vec<Carry>) -> Vec<Carry> {
    let limbs = limbs.chunks_exact(N_SUMS * size_of::<i32>()).map(pod_read_unaligned);
    let ids = ids.chunks_exact(size_of::<u32>()).map(pod_read_unaligned);
    carries.extend(ids.zip(limbs).map(|(id, limbs)| Carry { id, limbs }));
    carries
}
