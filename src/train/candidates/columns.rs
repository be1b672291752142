//! Positions and ids side by side, as the search reads them.

use std::ops::Range;

/// Elements handled by one step of the search: two vectors of eight lanes.
pub(super) const STEP: usize = 16;

/// Ranks by squared distance, then by id.
pub(super) fn key(distance2: f32, id: u32) -> u64 {
    u64::from(distance2.to_bits()) << 32 | u64::from(id)
}

/// Positions and ids as columns. Behind the `len` entries every column has at least [`STEP`]
/// more, so that whole vectors can be read and written at any entry.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    /// Positions, first axis.
    pub x: Vec<f32>,
    /// Positions, second axis.
    pub y: Vec<f32>,
    /// Positions, third axis.
    pub z: Vec<f32>,
    /// Component ids.
    pub id: Vec<u32>,
    /// Entries that mean something.
    pub len: usize,
}

impl Columns {
    /// Makes room for `len` entries. Never shrinks, never loses an entry.
    pub fn reserve(&mut self, len: usize) {
        let needed = len + STEP;
        if self.x.len() < needed {
            let size = needed.next_power_of_two();
            for column in [&mut self.x, &mut self.y, &mut self.z] {
                column.resize(size, 0.0);
            }
            self.id.resize(size, 0);
        }
    }

    /// Appends the entries `span` of `other`.
    #[inline(always)]
    pub fn append(&mut self, other: &Columns, span: Range<usize>) {
        const W: usize = 8;
        let n = span.len();
        self.reserve(self.len + n);
        // Whole vectors: what is written beyond the end is overwritten or padding.
        for k in (0..n).step_by(W) {
            let (to, from) = (self.len + k, span.start + k);
            self.x[to..to + W].copy_from_slice(&other.x[from..from + W]);
            self.y[to..to + W].copy_from_slice(&other.y[from..from + W]);
            self.z[to..to + W].copy_from_slice(&other.z[from..from + W]);
            self.id[to..to + W].copy_from_slice(&other.id[from..from + W]);
        }
        self.len += n;
    }

    /// Replaces all entries by the given ones of `other`.
    #[inline(always)]
    pub fn copy(&mut self, other: &Columns, entries: &[u32]) {
        let n = entries.len();
        self.reserve(n);
        self.len = n;
        let columns = self.x[..n].iter_mut().zip(&mut self.y[..n]).zip(&mut self.z[..n]);
        let (xs, ys) = (&other.x[..other.len], &other.y[..other.len]);
        let (zs, ids) = (&other.z[..other.len], &other.id[..other.len]);
        for ((((x, y), z), id), &entry) in columns.zip(&mut self.id[..n]).zip(entries) {
            let entry = entry as usize;
            (*x, *y, *z, *id) = (xs[entry], ys[entry], zs[entry], ids[entry]);
        }
        self.pad();
    }

    /// Makes the padding infinitely far away.
    pub fn pad(&mut self) {
        self.reserve(self.len);
        self.x[self.len..self.len + STEP].fill(f32::INFINITY);
    }

    /// What an entry is ranked by, seen from a point.
    pub fn key(&self, i: usize, point: [f32; 3]) -> u64 {
        key(self.distance2(i, point), self.id[i])
    }

    /// Squared distance of an entry to a point, by the formula of the whole search.
    #[inline(always)]
    pub fn distance2(&self, i: usize, point: [f32; 3]) -> f32 {
        let p = self.position(i);
        let d: [f32; 3] = std::array::from_fn(|axis| p[axis] - point[axis]);
        (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
    }

    /// Position of an entry.
    #[inline(always)]
    pub fn position(&self, i: usize) -> [f32; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }
}
