//! Inner loops of the search, eight lanes at a time.
//!
//! Every squared distance is computed as `(dx² + dy²) + dz²`, without fused multiply-add, so results
//! are bit-identical on all machines. Closures over vectors are avoided: a closure that is not inlined
//! is compiled for the baseline instruction set.
//!
//! A key is a squared distance whose low bits hold the entry's index. So a sorting network of `min` and
//! `max` sorts distances and indices together, without branches or index registers. Distances that
//! differ only in the index bits are flagged as uncertain and ranked again in full precision.

use crate::math::simd::{LANES, Vector};
use crate::train::estep::squared_distance;
use std::ops::Range;

#[inline(always)]
fn load_position<V: Vector>(columns: &Columns, from: usize) -> [V; 3] {
    [V::load(&columns.x[from..]), V::load(&columns.y[from..]), V::load(&columns.z[from..])]
}

#[inline(always)]
fn splat_position<V: Vector>([x, y, z]: [f32; 3]) -> [V; 3] {
    [V::splat(x), V::splat(y), V::splat(z)]
}

#[inline(always)]
fn distance2<V: Vector>(a: [V; 3], b: [V; 3]) -> V {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    (x * x + y * y) + z * z
}

/// Returns the start of the last full vector in a range of at least eight entries. This vector may
/// overlap the previous one.
#[inline(always)]
fn last_vector(range: &Range<usize>) -> usize {
    range.end - LANES
}

/// Returns the lower and the upper corner of the bounding box of the given points.
#[inline(always)]
pub(super) fn bounding_box<V: Vector>(points: &Columns, range: Range<usize>) -> [[f32; 3]; 2] {
    let [mut lo, mut hi] = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    for (axis, column) in [&points.x, &points.y, &points.z].into_iter().enumerate() {
        if range.len() < LANES {
            for &v in &column[range.clone()] {
                (lo[axis], hi[axis]) = (lo[axis].min(v), hi[axis].max(v));
            }
            continue;
        }
        let last = last_vector(&range);
        let mut low = V::load(&column[last..]);
        let mut high = low;
        let mut at = range.start;
        while at < last {
            let v = V::load(&column[at..]);
            (low, high) = (v.min(low), v.max(high));
            at += LANES;
        }
        (lo[axis], hi[axis]) = (lane_min(low.to_array()), lane_max(high.to_array()));
    }
    [lo, hi]
}

/// Returns the largest squared distance of the given points from `centre`; infinity or NaN if any of
/// these distances is.
#[inline(always)]
pub(super) fn reach2<V: Vector>(points: &Columns, range: Range<usize>, centre: [f32; 3]) -> f32 {
    if range.len() < LANES {
        let d2 = range.map(|i| points.distance2(i, centre));
        let (reach, sum) = d2.fold((0f32, 0f32), |(reach, sum), d2| (reach.max(d2), sum + d2));
        return if sum.is_finite() { reach } else { sum };
    }
    let centre = splat_position::<V>(centre);
    let last = last_vector(&range);
    // Entries of overlapping vectors count twice, which changes neither maximum nor finiteness.
    let mut reach = distance2(load_position(points, last), centre);
    let mut sum = reach;
    let mut at = range.start;
    while at < last {
        let d2 = distance2(load_position(points, at), centre);
        (reach, sum) = (d2.max(reach), sum + d2);
        at += LANES;
    }
    // The maximum may drop a NaN; the sum does not.
    let sum: f32 = sum.to_array().into_iter().sum();
    if sum.is_finite() { lane_max(reach.to_array()) } else { sum }
}

/// Writes the squared distances of all entries to `centre` into `out`, padding included. Returns
/// sixteen minima, one for each index modulo 16. They belong to different entries; a minimum over no
/// entries is infinity.
#[inline(always)]
pub(super) fn distances<V: Vector>(
    list: &Columns,
    centre: [f32; 3],
    out: &mut Vec<f32>,
) -> [f32; STEP] {
    // Padding is infinitely far away, so it never is a minimum.
    let size = list.len.next_multiple_of(STEP);
    if out.len() < size {
        out.resize(size.next_power_of_two(), 0.0);
    }
    let centre = splat_position::<V>(centre);
    let (mut least, mut least_odd) = (V::splat(f32::INFINITY), V::splat(f32::INFINITY));
    let columns = list.x[..size].chunks_exact(STEP).zip(list.y[..size].chunks_exact(STEP));
    let columns = columns.zip(list.z[..size].chunks_exact(STEP));
    for (((x, y), z), out) in columns.zip(out[..size].chunks_exact_mut(STEP)) {
        let even = distance2([V::load(x), V::load(y), V::load(z)], centre);
        let odd = [V::load(&x[LANES..]), V::load(&y[LANES..]), V::load(&z[LANES..])];
        let odd = distance2(odd, centre);
        (least, least_odd) = (even.min(least), odd.min(least_odd));
        even.store(out);
        odd.store(&mut out[LANES..]);
    }
    let mut all = [0.0; STEP];
    least.store(&mut all);
    least_odd.store(&mut all[LANES..]);
    all
}

/// Returns the `rank`-th smallest (1 to 16) of sixteen values.
#[inline(always)]
pub(super) fn nth_smallest(values: [f32; STEP], rank: usize) -> f32 {
    let mut sorted = [f32::INFINITY; STEP];
    let sorted = &mut sorted[..rank];
    for mut value in values {
        for kept in sorted.iter_mut() {
            let low = if value < *kept { value } else { *kept };
            value = if value < *kept { *kept } else { value };
            *kept = low;
        }
    }
    sorted[rank - 1]
}

/// Fills `near` with the entries of `list` whose squared distance is at most `limit`, in order. `limit`
/// must be finite, which excludes the padding.
#[inline(always)]
pub(super) fn select<V: Vector>(list: &Columns, distance2: &[f32], limit: f32, near: &mut Columns) {
    let size = list.len.next_multiple_of(LANES);
    // `reserve` adds padding of one step, so a whole vector also fits behind the last entry.
    near.reserve(size);
    // Slices of equal length, so that one bounds check covers all.
    let (x, y, z) = (&list.x[..size], &list.y[..size], &list.z[..size]);
    let tag: &[f32] = bytemuck::cast_slice(&list.tag[..size]);
    let room = size + STEP;
    let (near_x, near_y) = (&mut near.x[..room], &mut near.y[..room]);
    let (near_z, near_tag) = (&mut near.z[..room], &mut near.tag[..room]);
    let near_tag: &mut [f32] = bytemuck::cast_slice_mut(near_tag);
    // Whole vectors without branches: writes beyond the end are overwritten by later ones.
    let mut n = 0;
    let limit = V::splat(limit);
    for (at, d2) in (0..size).step_by(LANES).zip(distance2[..size].chunks_exact(LANES)) {
        let inside = V::load(d2).at_most(limit);
        V::load(&x[at..]).compress(inside).store(&mut near_x[n..]);
        V::load(&y[at..]).compress(inside).store(&mut near_y[n..]);
        V::load(&z[at..]).compress(inside).store(&mut near_z[n..]);
        V::load(&tag[at..]).compress(inside).store(&mut near_tag[n..]);
        n += inside.count_ones() as usize;
    }
    near.len = n;
    near.pad();
}

#[inline(always)]
fn lane_min(v: [f32; LANES]) -> f32 {
    let min = |a: f32, b: f32| if a < b { a } else { b };
    min(min(min(v[0], v[1]), min(v[2], v[3])), min(min(v[4], v[5]), min(v[6], v[7])))
}

#[inline(always)]
fn lane_max(v: [f32; LANES]) -> f32 {
    let max = |a: f32, b: f32| if a > b { a } else { b };
    max(max(max(v[0], v[1]), max(v[2], v[3])), max(max(v[4], v[5]), max(v[6], v[7])))
}

/// Nearest neighbours of the points of a chunk, as sorted keys. Keys in lanes beyond the last point are
/// undefined.
pub(super) struct Neighbours<const KEYS: usize> {
    /// Keys by rank, then by point. A key is the squared distance, with the index of the entry in the
    /// low bits.
    pub keys: [[f32; CHUNK]; KEYS],
    /// Bit `i` is set if the last two keys of point `i` differ only in the index bits or not at all.
    /// Either entry may then be the nearer one.
    pub set_uncertain: u32,
    /// Bit `i` is set if any two adjacent keys of point `i` differ only in the index bits or not at
    /// all.
    pub order_uncertain: u32,
}

/// Finds the `KEYS` nearest entries of `near` for each point of a chunk. `entry_bits` masks enough low
/// bits for the index of every entry. All squared distances must be finite.
#[inline(always)]
pub(super) fn neighbours<V: Vector, const KEYS: usize>(
    near: &Columns,
    points: &Columns,
    chunk: Range<usize>,
    entry_bits: u32,
) -> Neighbours<KEYS> {
    let mut found = Neighbours { keys: [[0.0; CHUNK]; KEYS], set_uncertain: 0, order_uncertain: 0 };
    let first = load_position::<V>(points, chunk.start);
    if chunk.len() > LANES {
        let both = [first, load_position(points, chunk.start + LANES)];
        let keys = sorted_keys::<V, 2, KEYS>(near, both, entry_bits);
        found.store_keys(&keys[0], 0, entry_bits);
        found.store_keys(&keys[1], LANES, entry_bits);
    } else {
        found.store_keys(&sorted_keys::<V, 1, KEYS>(near, [first], entry_bits)[0], 0, entry_bits);
    }
    found
}

impl<const KEYS: usize> Neighbours<KEYS> {
    /// Stores the keys of the eight points that start at index `first` of the chunk.
    #[inline(always)]
    fn store_keys<V: Vector>(&mut self, keys: &[V; KEYS], first: usize, entry_bits: u32) {
        let (mut set_uncertain, mut order_uncertain) = (0, 0);
        // The last pair decides which entries are found, the others only their order.
        for pair in keys.windows(2) {
            set_uncertain = pair[0].bits_equal(pair[1], !entry_bits);
            order_uncertain |= set_uncertain;
        }
        self.set_uncertain |= set_uncertain << first;
        self.order_uncertain |= order_uncertain << first;
        for (lanes, key) in self.keys.iter_mut().zip(keys) {
            key.store(&mut lanes[first..]);
        }
    }
}

/// Finds the `KEYS` smallest keys, sorted, for each of `N` × 8 points. Interleaving the points hides the
/// latency of insertions.
#[inline(always)]
fn sorted_keys<V: Vector, const N: usize, const KEYS: usize>(
    near: &Columns,
    points: [[V; 3]; N],
    entry_bits: u32,
) -> [[V; KEYS]; N] {
    let mut keys = [[V::splat(f32::INFINITY); KEYS]; N];
    let n = near.len;
    let columns = near.x[..n].iter().zip(&near.y[..n]).zip(&near.z[..n]);
    for (entry, ((&x, &y), &z)) in (0u32..).zip(columns) {
        let position = splat_position([x, y, z]);
        for i in 0..N {
            let mut key = distance2(position, points[i]).replace_low_bits(!entry_bits, entry);
            for kept in &mut keys[i] {
                // Both use the old value: with the new one, ties would evict the wrong id (`training.md`,
                // Pitfalls).
                let low = kept.min(key);
                key = kept.max(key);
                *kept = low;
            }
        }
    }
    keys
}

// Entries per step of the search. Two vectors, because the minima of sixteen lanes bound up to sixteen
// neighbours without a selection.
pub(super) const STEP: usize = 2 * LANES;

/// Maximum number of points that share a near list, a short list of candidates.
pub(in crate::train) const CHUNK: usize = 16;

/// Positions stored as one column per coordinate, with one tag per position. Each column ends with at
/// least [`STEP`] entries of padding, so that a full vector can start at any entry.
#[derive(Clone, Debug, Default)]
pub(in crate::train) struct Columns {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
    /// Tag of each position: component id in the grid, grid entry in a candidate list, index in the tile
    /// for points.
    pub tag: Vec<u32>,
    /// Number of valid entries.
    pub len: usize,
}

impl Columns {
    /// Ensures capacity for `len` entries and the padding; never shrinks.
    #[inline(always)]
    pub fn reserve(&mut self, len: usize) {
        if self.x.len() < len + STEP {
            self.grow(len + STEP);
        }
    }

    #[cold]
    fn grow(&mut self, needed: usize) {
        // Powers of two, so that a warm search allocates nothing.
        let size = needed.next_power_of_two();
        for column in [&mut self.x, &mut self.y, &mut self.z] {
            column.resize(size, 0.0);
        }
        self.tag.resize(size, 0);
    }

    /// Replaces all entries by positions in columns of equal length. Each tag is the index of its
    /// position.
    #[inline(always)]
    pub fn load(&mut self, [x, y, z]: [&[f32]; 3]) {
        let n = x.len();
        self.reserve(n);
        self.len = n;
        self.x[..n].copy_from_slice(x);
        self.y[..n].copy_from_slice(y);
        self.z[..n].copy_from_slice(z);
        self.tag[..n].iter_mut().zip(0..).for_each(|(tag, place)| *tag = place);
    }

    /// Appends the entries `span` of `other`. Each is tagged with its index in `other`.
    #[inline(always)]
    pub fn append(&mut self, other: &Columns, span: Range<usize>) {
        let n = span.len();
        self.reserve(self.len + n);
        // Whole vectors: writes beyond the end go to padding. Slices of equal length need only one bounds
        // check.
        let whole = n.next_multiple_of(LANES);
        let (to, from) = (self.len..self.len + whole, span.start..span.start + whole);
        let (x, y, z) = (&other.x[from.clone()], &other.y[from.clone()], &other.z[from]);
        let (to_x, to_y) = (&mut self.x[to.clone()], &mut self.y[to.clone()]);
        let (to_z, to_tag) = (&mut self.z[to.clone()], &mut self.tag[to]);
        for at in (0..whole).step_by(LANES) {
            to_x[at..at + LANES].copy_from_slice(&x[at..at + LANES]);
            to_y[at..at + LANES].copy_from_slice(&y[at..at + LANES]);
            to_z[at..at + LANES].copy_from_slice(&z[at..at + LANES]);
            let tags = to_tag[at..at + LANES].iter_mut();
            tags.zip((span.start + at) as u32..).for_each(|(tag, entry)| *tag = entry);
        }
        self.len += n;
    }

    pub fn set(&mut self, i: usize, position: [f32; 3], tag: u32) {
        [self.x[i], self.y[i], self.z[i]] = position;
        self.tag[i] = tag;
    }

    /// Moves the padding to infinity, so that it is never a neighbour of any point.
    #[inline(always)]
    pub fn pad(&mut self) {
        self.reserve(self.len);
        // One axis suffices: the distance is infinite for any finite values of the others.
        self.x[self.len..self.len + STEP].fill(f32::INFINITY);
    }

    /// Returns the squared distance from an entry to a point, rounded as in all other code of the
    /// search.
    #[inline(always)]
    pub fn distance2(&self, i: usize, point: [f32; 3]) -> f32 {
        squared_distance(self.position(i), point)
    }

    #[inline(always)]
    pub fn position(&self, i: usize) -> [f32; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }
}
