//! Spatial index of seeds: a hash grid with cells as wide as the structural scale, grouped into blocks.
//!
//! The bounds of a scene are not known in advance, so blocks are hashed. Points lie on surfaces, so
//! most cells of a box around a few points are empty. Separate lookups of these cells took half the
//! time of the assignment. A block of 4×4×4 cells returns the seeds of a dozen occupied cells at once.
//! In larger blocks, more seeds are too far away; smaller blocks are again mostly empty. Buckets are
//! chains of nodes, each with room for a few seeds. So insertion moves no seed, growth only relinks
//! nodes, and seeds keep their numbers. Nodes store positions beside numbers, so that eight seeds at a
//! time are tested against a box.

use crate::math::simd::{Isa, Kernel, LANES, SET_LANE, Vector};
use crate::model::scene::points_device::{NO_SEED, Seeds};

/// Value that marks the absence of a seed or component.
pub const NONE: u32 = NO_SEED;
/// Maximum distance of a seed from the origin along each axis, in cells.
// At 2²⁰ cells an f32 still resolves a sixteenth of a cell.
const MAX_CELLS: f32 = (1 << 20) as f32;
const MIN_BUCKETS: usize = 256;
/// Binary logarithm of a block's edge in cells.
const BLOCK_BITS: u32 = 2;
const NODE: usize = LANES;

/// Seeds of all components (points at which the components were created), indexed by position.
pub struct SeedGrid {
    cell: f32,
    per_cell: f32,
    positions: Vec<[f32; 3]>,
    nodes: Vec<Node>,
    /// First node of each bucket; the length is a power of two.
    heads: Vec<u32>,
}

/// Node in the chain of a bucket: up to eight seeds, in ascending order.
#[derive(Clone, Copy)]
struct Node {
    /// Positions, axis by axis; NaN in free slots.
    along: [[f32; NODE]; 3],
    /// Seed numbers; [`NONE`] in free slots.
    ids: [u32; NODE],
    next: u32,
}

impl SeedGrid {
    pub fn new(cell: f64) -> Self {
        Self {
            cell: cell as f32,
            per_cell: (1.0 / cell) as f32,
            positions: Vec::new(),
            nodes: Vec::new(),
            heads: vec![NONE; MIN_BUCKETS],
        }
    }

    pub fn len(&self) -> usize {
        self.positions.len()
    }

    #[inline(always)]
    pub fn position(&self, id: usize) -> [f32; 3] {
        self.positions[id]
    }

    /// Returns the positions of all seeds, world units from the scene's origin, in the order of
    /// creation.
    pub fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    /// Returns all seeds for upload to a device. `are_new` is true if they differ from the seeds that
    /// the device has.
    pub fn seeds(&self, are_new: bool) -> Seeds<'_> {
        let Self { cell: h, per_cell, positions, .. } = self;
        let (h, per_cell) = (*h, *per_cell);
        Seeds { h, per_cell, max_cells: MAX_CELLS, positions, are_new }
    }

    pub fn bytes(&self) -> usize {
        self.len() * size_of::<[f32; 3]>()
            + self.nodes.len() * size_of::<Node>()
            + self.heads.len() * size_of::<u32>()
    }

    /// True if a position is close enough to the origin to have a cell.
    #[inline(always)]
    pub fn has_cell(&self, position: [f32; 3]) -> bool {
        // False for NaN.
        position.iter().all(|x| (x * self.per_cell).abs() < MAX_CELLS)
    }

    #[inline(always)]
    pub fn cell_of(&self, position: [f32; 3]) -> [i32; 3] {
        let mut cell = [0; 3];
        for axis in 0..3 {
            cell[axis] = (position[axis] * self.per_cell).floor() as i32;
        }
        cell
    }

    /// True if a position may be within `radius` world units of a seed. This can also hold for
    /// positions just outside the grid.
    #[inline(always)]
    pub fn may_reach_seed(&self, position: [f32; 3], radius: f32) -> bool {
        position.iter().all(|x| (x.abs() - radius) * self.per_cell < MAX_CELLS)
    }

    #[inline(always)]
    fn bucket(&self, [x, y, z]: [i32; 3]) -> usize {
        // The multipliers are primes of xxHash32.
        let mixed = (x as u32).wrapping_mul(0x9E37_79B1)
            ^ (y as u32).wrapping_mul(0x85EB_CA77).rotate_left(11)
            ^ (z as u32).wrapping_mul(0xC2B2_AE3D).rotate_left(21);
        let mixed = mixed ^ (mixed >> 15);
        // The lowest bits of a product depend only on the lowest bits of its factors.
        mixed.wrapping_mul(0x2C1B_3C6D) as usize >> 4 & (self.heads.len() - 1)
    }

    /// Adds a seed and returns its number. The position must satisfy [`Self::has_cell`].
    pub fn insert(&mut self, position: [f32; 3]) -> u32 {
        // At least as many buckets as nodes, so that chains stay short.
        if self.nodes.len() >= self.heads.len() {
            self.grow();
        }
        let id = self.len() as u32;
        self.positions.push(position);
        self.link(id);
        id
    }

    /// Returns a copy of the grid in which every seed is moved to the position that `place` returns for
    /// it. `None` if a seed leaves the range of the grid.
    pub fn moved(&self, place: impl Fn([f32; 3]) -> [f32; 3]) -> Option<Self> {
        let Self { cell, per_cell, .. } = *self;
        // Both are copied: recomputed from the rounded cell, the reciprocal could differ.
        let mut moved = Self { cell, per_cell, ..Self::new(1.0) };
        for position in self.positions.iter().map(|&position| place(position)) {
            if !moved.has_cell(position) {
                return None;
            }
            moved.insert(position);
        }
        Some(moved)
    }

    fn link(&mut self, id: u32) {
        let position = self.positions[id as usize];
        // An arithmetic shift rounds down for negative cells too.
        let bucket = self.bucket(self.cell_of(position).map(|c| c >> BLOCK_BITS));
        let head = self.heads[bucket];
        // The `NONE` of an empty bucket lies beyond all nodes.
        let has_room = self.nodes.get(head as usize).is_some_and(|node| node.ids[NODE - 1] == NONE);
        if !has_room {
            self.heads[bucket] = self.nodes.len() as u32;
            self.nodes.push(Node { next: head, ..Node::EMPTY });
        }
        self.nodes[self.heads[bucket] as usize].add(id, position);
    }

    fn grow(&mut self) {
        let n = self.heads.len() * 2;
        self.heads.clear();
        self.heads.resize(n, NONE);
        self.nodes.clear();
        for id in 0..self.len() as u32 {
            self.link(id);
        }
    }

    /// Returns the first nodes of the blocks that overlap a box of cells.
    #[inline(always)]
    fn heads_of(&self, cells: CellBox) -> Heads<'_> {
        // Explicit loops: array `map` is not inlined, so it would be compiled for the baseline instruction
        // set.
        let (mut low, mut high) = (cells.low, cells.high);
        for axis in 0..3 {
            low[axis] >>= BLOCK_BITS;
            high[axis] >>= BLOCK_BITS;
        }
        Heads { grid: self, low, high, next: low }
    }

    /// Calls `visit` for every seed in the cells from `low` to `high`.
    #[inline(always)]
    pub fn visit(&self, low: [i32; 3], high: [i32; 3], mut visit: impl FnMut(u32, [f32; 3])) {
        for mut next in self.heads_of(CellBox { low, high }) {
            while let Some(node) = self.nodes.get(next as usize) {
                for (i, &id) in node.ids.iter().take_while(|id| **id != NONE).enumerate() {
                    let seed = node.position(i);
                    // Buckets also hold seeds of other cells.
                    let cell = self.cell_of(seed);
                    if (0..3).all(|i| cell[i] >= low[i] && cell[i] <= high[i]) {
                        visit(id, seed);
                    }
                }
                next = node.next;
            }
        }
    }

    /// Returns the grid cells that a box with the given corners overlaps.
    pub fn cells_between(&self, [low, high]: [[f32; 3]; 2]) -> CellBox {
        CellBox { low: self.cell_of(low), high: self.cell_of(high) }
    }

    /// Appends to `found` the numbers and positions of all seeds in a box with the given corners.
    pub fn gather(&self, corners: [[f32; 3]; 2], found: &mut Vec<(u32, [f32; 3])>) {
        Isa::best().run(Gather { grid: self, corners, found });
    }

    /// Returns the nearest seed within one cell width of a position; among equally near seeds, the
    /// oldest.
    pub fn nearest(&self, position: [f32; 3]) -> Option<u32> {
        let found = Isa::best().run(Nearest { grid: self, position });
        (found != NONE).then_some(found)
    }

    /// Returns the nearest seed within `reach` of a position; among equally near seeds, the oldest.
    /// [`NONE`] if there is no seed. `reach` is in world units, at most one cell width.
    #[inline(always)]
    pub fn nearest_within<V: Vector>(&self, position: [f32; 3], reach: f32) -> u32 {
        if !self.has_cell(position) {
            return NONE;
        }
        let [x, y, z] = position;
        let place = [V::splat(x), V::splat(y), V::splat(z)];
        // `NONE` exceeds every id, so that a seed at exactly this distance is accepted.
        let (mut best, mut found) = (reach * reach, NONE);
        // Slightly larger, since distances are rounded.
        let radius = reach * (1.0 + 1e-5);
        let corners = [[x - radius, y - radius, z - radius], [x + radius, y + radius, z + radius]];
        for mut next in self.heads_of(self.cells_between(corners)) {
            while let Some(node) = self.nodes.get(next as usize) {
                let squared = node.squared_distances(place);
                let mut near = squared.at_most(V::splat(best));
                let squared = squared.to_array();
                while near != 0 {
                    let i = near.trailing_zeros() as usize % NODE;
                    near &= near - 1;
                    // Ties must not depend on the order of buckets.
                    let is_older = squared[i] == best && node.ids[i] < found;
                    if squared[i] < best || is_older {
                        (best, found) = (squared[i], node.ids[i]);
                    }
                }
                next = node.next;
            }
        }
        found
    }
}

impl Node {
    const EMPTY: Self = Self { along: [[f32::NAN; NODE]; 3], ids: [NONE; NODE], next: NONE };

    fn add(&mut self, id: u32, position: [f32; 3]) {
        if let Some(free) = self.ids.iter().position(|id| *id == NONE) {
            self.ids[free] = id;
            (0..3).for_each(|axis| self.along[axis][free] = position[axis]);
        }
    }

    /// Returns the squared distances from a position to the node's seeds, NaN for free slots. Squares
    /// are added in the order x, y, z.
    #[inline(always)]
    fn squared_distances<V: Vector>(&self, [x, y, z]: [V; 3]) -> V {
        let [u, v, w] = &self.along;
        let (dx, dy, dz) = (x - V::load(u), y - V::load(v), z - V::load(w));
        dx * dx + dy * dy + dz * dz
    }

    #[inline(always)]
    fn position(&self, i: usize) -> [f32; 3] {
        [self.along[0][i], self.along[1][i], self.along[2][i]]
    }
}

/// Iterator over the first nodes of all blocks in a box. It is hand-written, since iterator adapters are
/// not compiled for a kernel's instruction set.
struct Heads<'a> {
    grid: &'a SeedGrid,
    low: [i32; 3],
    high: [i32; 3],
    next: [i32; 3],
}

impl Iterator for Heads<'_> {
    type Item = u32;

    #[inline(always)]
    fn next(&mut self) -> Option<u32> {
        let Self { grid, low, high, next } = self;
        if next[2] > high[2] || low[1] > high[1] || low[0] > high[0] {
            return None;
        }
        let head = grid.heads[grid.bucket(*next)];
        next[0] += 1;
        for axis in 0..2 {
            if next[axis] > high[axis] {
                next[axis] = low[axis];
                next[axis + 1] += 1;
            }
        }
        Some(head)
    }
}

struct Nearest<'a> {
    grid: &'a SeedGrid,
    position: [f32; 3],
}

impl Kernel for Nearest<'_> {
    type Output = u32;

    #[inline(always)]
    fn run<V: Vector>(self) -> u32 {
        self.grid.nearest_within::<V>(self.position, self.grid.cell)
    }
}

struct Gather<'a> {
    grid: &'a SeedGrid,
    corners: [[f32; 3]; 2],
    found: &'a mut Vec<(u32, [f32; 3])>,
}

impl Kernel for Gather<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { grid, corners, found } = self;
        let [low, high] = corners;
        for mut next in grid.heads_of(grid.cells_between(corners)) {
            while let Some(node) = grid.nodes.get(next as usize) {
                let mut inside = V::splat(SET_LANE);
                for axis in 0..3 {
                    let at = V::load(&node.along[axis]);
                    let above = V::splat(low[axis]).mask_at_most(at);
                    inside = inside.and(above).and(at.mask_at_most(V::splat(high[axis])));
                }
                let mut inside = inside.sign_bits();
                while inside != 0 {
                    // The remainder shows the compiler that the index is in bounds.
                    let i = inside.trailing_zeros() as usize % NODE;
                    found.push((node.ids[i], node.position(i)));
                    inside &= inside - 1;
                }
                next = node.next;
            }
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub struct CellBox {
    pub low: [i32; 3],
    /// Largest cell index along each axis, inclusive.
    pub high: [i32; 3],
}

impl CellBox {
    pub fn n_cells(&self) -> f64 {
        // In f64, as the product may exceed 64 bits.
        let along = |i: usize| f64::from(self.high[i]) - f64::from(self.low[i]) + 1.0;
        (0..3).map(|i| along(i).max(0.0)).product()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use crate::train::estep::squared_distance;

    #[test]
    fn nearest_is_what_a_search_of_all_seeds_finds() {
        let mut grid = SeedGrid::new(0.1);
        let stream = Rng::new(1, Purpose::Init, 0);
        let place =
            |i: u64| [0, 1, 2].map(|axis| stream.uniform_at(3 * i + axis) as f32 * 2.0 - 1.0);
        for i in 0..5000 {
            grid.insert(place(i));
        }
        for i in 5000..7000 {
            let p = place(i);
            let all = (0..5000usize)
                .map(|id| (squared_distance(p, grid.position(id)), id as u32))
                .min_by(|a, b| a.partial_cmp(b).unwrap());
            let expected = all.filter(|(d2, _)| *d2 <= grid.cell * grid.cell).map(|(_, id)| id);
            assert_eq!(grid.nearest(p), expected);
        }
    }
}
