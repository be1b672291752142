//! Conversion between the model's rows of sums and the file's columns.

use super::container::Section;
use super::element::Stored;
use super::sections;
use crate::model::conjugate::statistics::N_SUMS;
use crate::model::paper::state::{Carry, InitialMeans, Totals};
use bytemuck::{Pod, pod_read_unaligned};

/// Number of first moments per component: three of space, then three of colour.
pub(super) const N_FIRST: usize = 6;
pub(super) const N_SECOND: usize = 6;

pub(super) fn means(means: &InitialMeans) -> Section<'_> {
    match means {
        InitialMeans::F32 { space, color } => columns_of(space, color),
        InitialMeans::F64 { space, color } => columns_of(space, color),
    }
}

fn columns_of<'a, T: Stored>(space: &'a [[T; 3]], color: &'a [[T; 3]]) -> Section<'a> {
    Section::new(sections::MEANS, space.as_flattened()).extended(color.as_flattened())
}

pub(super) fn totals<'a>(totals: &Totals) -> Vec<Section<'a>> {
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

pub(super) fn join_rows<T: Pod>(
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

pub(super) fn carries(ids: &[u8], limbs: &[u8], mut carries: Vec<Carry>) -> Vec<Carry> {
    let limbs = limbs.chunks_exact(N_SUMS * size_of::<i32>()).map(pod_read_unaligned);
    let ids = ids.chunks_exact(size_of::<u32>()).map(pod_read_unaligned);
    carries.extend(ids.zip(limbs).map(|(id, limbs)| Carry { id, limbs }));
    carries
}
