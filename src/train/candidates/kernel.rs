//! The inner loops of the search, eight lanes at a time.
//!
//! Every squared distance is `(dx² + dy²) + dz²`, never fused: the same bits everywhere.

use super::columns::{Columns, STEP};
use std::ops::Range;
use wide::bytemuck::cast;
use wide::{f32x8, u32x8};

/// Lanes of a vector.
pub(super) const LANES: usize = 8;

/// The eight values from `from` on.
#[inline(always)]
pub(super) fn load(values: &[f32], from: usize) -> f32x8 {
    let mut lanes = [0.0; LANES];
    lanes.copy_from_slice(&values[from..from + LANES]);
    f32x8::new(lanes)
}

#[inline(always)]
fn distance2(a: [f32x8; 3], b: [f32x8; 3]) -> f32x8 {
    let d: [f32x8; 3] = std::array::from_fn(|i| a[i] - b[i]);
    (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
}

/// Where to load vectors from so that they cover a range of at least eight; the last ones overlap.
#[inline(always)]
fn cover(range: Range<usize>) -> impl Iterator<Item = usize> {
    let last = range.end - LANES;
    (range.start..last).step_by(LANES).chain([last])
}

/// Lower and upper corner of the box of some points.
#[inline(always)]
pub(super) fn bounding_box(points: &Columns, range: Range<usize>) -> [[f32; 3]; 2] {
    let [mut lo, mut hi] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for (axis, column) in [&points.x, &points.y, &points.z].into_iter().enumerate() {
        if range.len() < LANES {
            for &v in &column[range.clone()] {
                (lo[axis], hi[axis]) = (lo[axis].min(v), hi[axis].max(v));
            }
            continue;
        }
        let (mut low, mut high) = (f32x8::splat(lo[axis]), f32x8::splat(hi[axis]));
        for at in cover(range.clone()) {
            let v = load(column, at);
            (low, high) = (v.fast_min(low), v.fast_max(high));
        }
        lo[axis] = low.to_array().into_iter().fold(lo[axis], f32::min);
        hi[axis] = high.to_array().into_iter().fold(hi[axis], f32::max);
    }
    [lo, hi]
}

/// Largest squared distance of some points to `centre`; infinity or NaN if one of them is.
#[inline(always)]
pub(super) fn reach2(points: &Columns, range: Range<usize>, centre: [f32; 3]) -> f32 {
    if range.len() < LANES {
        let d2 = range.map(|i| points.distance2(i, centre));
        let (reach, sum) = d2.fold((0f32, 0f32), |(reach, sum), d2| (reach.max(d2), sum + d2));
        return if sum.is_finite() { reach } else { sum };
    }
    let centre = centre.map(f32x8::splat);
    let (mut reach, mut sum) = (f32x8::splat(0.0), f32x8::splat(0.0));
    for at in cover(range) {
        let p = [load(&points.x, at), load(&points.y, at), load(&points.z, at)];
        let d2 = distance2(p, centre);
        (reach, sum) = (d2.fast_max(reach), sum + d2);
    }
    // The maximum may lose a NaN, the sum does not.
    let sum: f32 = sum.to_array().into_iter().sum();
    if sum.is_finite() { reach.to_array().into_iter().fold(0.0, f32::max) } else { sum }
}

/// Writes the squared distances of all entries to `centre`, padding included, and returns the
/// least of every sixteenth entry: distances of sixteen different ones, or infinity.
#[inline(always)]
pub(super) fn distances(list: &Columns, centre: [f32; 3], out: &mut Vec<f32>) -> [f32x8; 2] {
    let size = list.len.next_multiple_of(STEP);
    if out.len() < size {
        out.resize(size.next_power_of_two(), 0.0);
    }
    let centre = centre.map(f32x8::splat);
    let mut least = [f32x8::splat(f32::INFINITY); 2];
    let columns = list.x[..size].chunks_exact(STEP).zip(list.y[..size].chunks_exact(STEP));
    let columns = columns.zip(list.z[..size].chunks_exact(STEP));
    for (((x, y), z), out) in columns.zip(out[..size].chunks_exact_mut(STEP)) {
        for (half, least) in least.iter_mut().enumerate() {
            let at = half * LANES;
            let d2 = distance2([load(x, at), load(y, at), load(z, at)], centre);
            *least = d2.fast_min(*least);
            out[at..at + LANES].copy_from_slice(d2.as_array());
        }
    }
    least
}

/// The `rank`-th smallest (from 1 to 16) of sixteen values.
#[inline(always)]
pub(super) fn ranked(values: [f32x8; 2], rank: usize) -> f32 {
    let mut sorted = [f32::INFINITY; STEP];
    let sorted = &mut sorted[..rank];
    for mut value in values.iter().flat_map(|v| v.to_array()) {
        for kept in sorted.iter_mut() {
            let low = if value < *kept { value } else { *kept };
            value = if value < *kept { *kept } else { value };
            *kept = low;
        }
    }
    sorted[rank - 1]
}

/// For every mask of eight lanes the set ones, ascending.
const SET_LANES: [[u32; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                table[mask][n] = lane as u32;
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// The entries, ascending, of `list` whose squared distance is at most `limit`, which must be finite:
/// that of the padding is not. `entries` is memory.
#[inline(always)]
pub(super) fn within<'a>(
    list: &Columns,
    distance2: &[f32],
    limit: f32,
    entries: &'a mut Vec<u32>,
) -> &'a [u32] {
    if entries.len() < list.len + STEP {
        entries.resize((list.len + STEP).next_power_of_two(), 0);
    }
    // Whole vectors without a branch: what is written beyond the end is overwritten.
    let mut n = 0;
    let limit = f32x8::splat(limit);
    let size = list.len.next_multiple_of(LANES);
    for (first, d2) in (0..).step_by(LANES).zip(distance2[..size].chunks_exact(LANES)) {
        let inside = load(d2, 0).simd_le(limit).to_bitmask() as usize & 0xFF;
        let lanes = u32x8::new(SET_LANES[inside]) + u32x8::splat(first);
        entries[n..n + LANES].copy_from_slice(lanes.as_array());
        n += inside.count_ones() as usize;
    }
    &entries[..n]
}

/// Neighbours of eight points as sorted keys.
pub(super) struct Neighbours<const KEYS: usize> {
    /// Per rank the keys of the lanes: squared distance whose low bits are the entry.
    pub keys: [f32x8; KEYS],
    /// Lanes in which the last key and the one before are equal but for the entry: which of them
    /// is nearer is not known.
    pub set_uncertain: u32,
    /// The same for any two neighbouring keys.
    pub order_uncertain: u32,
}

/// The `KEYS` nearest entries of `near` for eight points. `entry_bits` is a mask of low bits that
/// holds every entry. All squared distances must be finite.
#[inline(always)]
pub(super) fn neighbours<const KEYS: usize>(
    near: &Columns,
    points: [f32x8; 3],
    entry_bits: u32,
) -> Neighbours<KEYS> {
    let kept_bits = u32x8::splat(!entry_bits);
    let mut keys = [f32x8::splat(f32::INFINITY); KEYS];
    let n = near.len;
    let columns = near.x[..n].iter().zip(&near.y[..n]).zip(&near.z[..n]);
    for (entry, ((&x, &y), &z)) in columns.enumerate() {
        let d2 = distance2([x, y, z].map(f32x8::splat), points);
        let bits = cast::<f32x8, u32x8>(d2) & kept_bits | u32x8::splat(entry as u32);
        let mut key: f32x8 = cast(bits);
        for kept in &mut keys {
            let low = kept.fast_min(key);
            key = kept.fast_max(key);
            *kept = low;
        }
    }
    let mut any_equal = u32x8::splat(0);
    let mut equal = any_equal;
    for pair in keys.windows(2) {
        let differing = cast::<f32x8, u32x8>(pair[0]) ^ cast::<f32x8, u32x8>(pair[1]);
        equal = (differing & kept_bits).simd_eq(u32x8::splat(0));
        any_equal |= equal;
    }
    let lanes = |mask| cast::<u32x8, f32x8>(mask).to_bitmask();
    Neighbours { keys, set_uncertain: lanes(equal), order_uncertain: lanes(any_equal) }
}
