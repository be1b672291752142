//! Positions in columns, the layout of the candidate search.

use crate::math::simd::LANES;
use std::ops::Range;

// Entries per step of the search. Two vectors, because the minima of sixteen lanes bound up to sixteen
// neighbours without a selection.
pub(super) const STEP: usize = 2 * LANES;

/// Number of points that share a candidate list.
pub(in crate::train) const CHUNK: usize = 16;

/// Positions in columns, with a tag each. Every column has at least [`STEP`] entries of padding behind
/// `len`, so that whole vectors can be read and written at any entry.
#[derive(Clone, Debug, Default)]
pub(in crate::train) struct Columns {
    pub x: Vec<f32>,
    pub y: Vec<f32>,
    pub z: Vec<f32>,
    /// Meaning by use: component id in the grid, grid entry in a candidate list, index in the tile for
    /// points.
    pub tag: Vec<u32>,
    /// Number of valid entries.
    pub len: usize,
}

impl Columns {
    /// Makes room for `len` entries; never shrinks.
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

    /// Replaces all entries by positions in columns of equal length; tags are indices.
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

    /// Appends entries `span` of `other`, tagged with their indices there.
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

    /// Moves the padding to infinity.
    #[inline(always)]
    pub fn pad(&mut self) {
        self.reserve(self.len);
        // One axis suffices: the distance is infinite for any finite values of the others.
        self.x[self.len..self.len + STEP].fill(f32::INFINITY);
    }

    /// Squared distance of an entry to a point, rounded as everywhere in the search.
    #[inline(always)]
    pub fn distance2(&self, i: usize, point: [f32; 3]) -> f32 {
        let p = self.position(i);
        let d: [f32; 3] = std::array::from_fn(|axis| p[axis] - point[axis]);
        (d[0] * d[0] + d[1] * d[1]) + d[2] * d[2]
    }

    #[inline(always)]
    pub fn position(&self, i: usize) -> [f32; 3] {
        [self.x[i], self.y[i], self.z[i]]
    }
}
