//! The inner loops of the search, eight lanes at a time.
//!
//! Every squared distance is `(dx² + dy²) + dz²`, never fused: the same bits everywhere.

use super::columns::{Columns, STEP};
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
const SET_LANES: [[u8; LANES]; 256] = {
    let mut table = [[0; LANES]; 256];
    let mut mask = 0;
    while mask < 256 {
        let (mut lane, mut n) = (0, 0);
        while lane < LANES {
            if mask >> lane & 1 == 1 {
                table[mask][n] = lane as u8;
                n += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    table
};

/// Replaces `near` by the entries of `list` whose squared distance is at most `limit`.
#[inline(always)]
pub(super) fn select(list: &Columns, distance2: &[f32], limit: f32, near: &mut Columns) {
    near.len = 0;
    near.reserve(list.len);
    let limit = f32x8::splat(limit);
    for first in (0..list.len).step_by(LANES) {
        let mut mask = load(distance2, first).simd_le(limit).to_bitmask() as usize & 0xFF;
        if first + LANES > list.len {
            mask &= (1 << (list.len - first)) - 1;
        }
        let n = mask.count_ones() as usize;
        for (k, &lane) in SET_LANES[mask][..n].iter().enumerate() {
            let (from, to) = (first + lane as usize, near.len + k);
            near.x[to] = list.x[from];
            near.y[to] = list.y[from];
            near.z[to] = list.z[from];
            near.id[to] = list.id[from];
        }
        near.len += n;
    }
    near.pad();
}

/// Neighbours of eight points as sorted keys.
pub(super) struct Neighbours<const KEYS: usize> {
    /// Per rank the keys of the lanes: squared distance whose low bits are the entry.
    pub keys: [f32x8; KEYS],
    /// Lanes in which two keys are equal but for the entry: their order is not known.
    pub uncertain: u32,
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
    let mut equal = u32x8::splat(0);
    for pair in keys.windows(2) {
        let differing = cast::<f32x8, u32x8>(pair[0]) ^ cast::<f32x8, u32x8>(pair[1]);
        equal |= (differing & kept_bits).simd_eq(u32x8::splat(0));
    }
    Neighbours { keys, uncertain: cast::<u32x8, f32x8>(equal).to_bitmask() }
}
