//! Positions and ids side by side, as the search reads them.

use std::ops::Range;

/// Elements handled by one step of the search: two vectors of eight lanes.
pub(super) const STEP: usize = 16;

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

    /// Makes the padding infinitely far away.
    pub fn pad(&mut self) {
        self.reserve(self.len);
        self.x[self.len..self.len + STEP].fill(f32::INFINITY);
    }

    /// Position of an entry.
    #[inline(always)]
    pub fn position(&self, i: usize) -> [f32; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }
}
