//! Seeds by place: a hash grid with cells as wide as the structural scale, some of which to every side are a
//! block.
//!
//! A scene has no bounds that are known beforehand, so blocks are hashed instead of laid out. Points lie on
//! surfaces: most cells of a box around some of them hold no seed, and looking these up one by one took
//! half the time of finding components; a block of four to a side has seeds of a dozen cells together. Larger
//! ones hold more seeds that are too far away, smaller ones are mostly empty again. Buckets are chains of
//! nodes with room for a few seeds each: insertion moves nothing, growth relinks, and seeds keep their
//! numbers. Nodes hold places beside numbers, so that a box takes eight seeds at a time.

use crate::math::simd::{EVERY_BIT, Isa, Kernel, LANES, Vector};
use crate::model::scene::points_device::{NO_SEED, Seeds};

/// Stands for no seed, and for no component.
pub const NONE: u32 = NO_SEED;
/// Cells from the origin that can be told apart on every axis.
// At 2²⁰ cells an f32 still tells sixteenths of a cell apart.
const MAX_CELLS: f32 = (1 << 20) as f32;
/// Buckets of a grid without seeds.
const MIN_BUCKETS: usize = 256;
/// Cells along a side of a block, as a power of two, where seeds near a place are looked for.
const WIDE_BLOCK: u32 = 2;
/// The same where seeds are looked up by their own place: few others come along then.
const NARROW_BLOCK: u32 = 1;
/// Seeds of a node.
const NODE: usize = LANES;

/// Seeds of all components, found by place.
pub struct SeedGrid {
    cell: f32,
    per_cell: f32,
    /// Cells along a side of a block, as a power of two.
    block_bits: u32,
    positions: Vec<[f32; 3]>,
    nodes: Vec<Node>,
    /// First node by bucket; a power of two of them.
    heads: Vec<u32>,
}

/// Some seeds of a bucket, in ascending order.
#[derive(Clone, Copy)]
struct Node {
    /// Where they are, axis by axis; nowhere behind the last.
    along: [[f32; NODE]; 3],
    /// [`NONE`] behind the last.
    ids: [u32; NODE],
    /// The next node of the bucket.
    next: u32,
}

impl SeedGrid {
    /// No seeds yet; cells are `cell` world units wide.
    pub fn new(cell: f64) -> Self {
        Self {
            cell: cell as f32,
            per_cell: (1.0 / cell) as f32,
            block_bits: WIDE_BLOCK,
            positions: Vec::new(),
            nodes: Vec::new(),
            heads: vec![NONE; MIN_BUCKETS],
        }
    }

    /// The same for seeds that are looked up by their exact place, [`Self::at`].
    pub fn of_lattice(cell: f64) -> Self {
        Self { block_bits: NARROW_BLOCK, ..Self::new(cell) }
    }

    /// Number of seeds.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// Where a seed is.
    #[inline(always)]
    pub fn position(&self, id: usize) -> [f32; 3] {
        self.positions[id]
    }

    /// Whether a seed is within reach of a place.
    #[inline(always)]
    pub fn is_within(&self, seed: u32, place: [f32; 3], reach: f32) -> bool {
        squared_distance(self.position(seed as usize), place) <= reach * reach
    }

    /// All seeds, for a device that searches; whether they are others than it has.
    pub fn seeds(&self, are_new: bool) -> Seeds<'_> {
        let Self { cell: h, per_cell, positions, .. } = self;
        let (h, per_cell) = (*h, *per_cell);
        Seeds { h, per_cell, max_cells: MAX_CELLS, positions, are_new }
    }

    /// Bytes that the grid takes.
    pub fn bytes(&self) -> usize {
        self.len() * size_of::<[f32; 3]>()
            + self.nodes.len() * size_of::<Node>()
            + self.heads.len() * size_of::<u32>()
    }

    /// Whether a place can be told from its neighbours.
    #[inline(always)]
    pub fn reaches(&self, position: [f32; 3]) -> bool {
        position.iter().all(|x| (x * self.per_cell).abs() < MAX_CELLS)
    }

    /// The cell of a place within reach.
    #[inline(always)]
    pub fn cell_of(&self, position: [f32; 3]) -> [i32; 3] {
        let mut cell = [0; 3];
        for axis in 0..3 {
            cell[axis] = (position[axis] * self.per_cell).floor() as i32;
        }
        cell
    }

    /// Whether a place may lie within `radius` world units of a seed: beyond the rim, too.
    #[inline(always)]
    pub fn comes_near(&self, position: [f32; 3], radius: f32) -> bool {
        position.iter().all(|x| (x.abs() - radius) * self.per_cell < MAX_CELLS)
    }

    #[inline(always)]
    fn bucket(&self, [x, y, z]: [i32; 3]) -> usize {
        let mixed = (x as u32).wrapping_mul(0x9E37_79B1)
            ^ (y as u32).wrapping_mul(0x85EB_CA77).rotate_left(11)
            ^ (z as u32).wrapping_mul(0xC2B2_AE3D).rotate_left(21);
        let mixed = mixed ^ (mixed >> 15);
        mixed.wrapping_mul(0x2C1B_3C6D) as usize >> 4 & (self.heads.len() - 1)
    }

    /// Adds a seed at a place within reach.
    pub fn insert(&mut self, position: [f32; 3]) -> u32 {
        // As many buckets as nodes at least keep chains short.
        if self.nodes.len() >= self.heads.len() {
            self.grow();
        }
        let id = self.len() as u32;
        self.positions.push(position);
        self.link(id);
        id
    }

    /// The same seeds, each at another place; `None` if one of these is out of reach.
    pub fn moved(&self, place: impl Fn([f32; 3]) -> [f32; 3]) -> Option<Self> {
        let Self { cell, per_cell, block_bits, .. } = *self;
        let mut moved = Self { cell, per_cell, block_bits, ..Self::new(1.0) };
        for position in self.positions.iter().map(|&position| place(position)) {
            if !moved.reaches(position) {
                return None;
            }
            moved.insert(position);
        }
        Some(moved)
    }

    fn link(&mut self, id: u32) {
        let position = self.positions[id as usize];
        let bucket = self.bucket(self.cell_of(position).map(|c| c >> self.block_bits));
        let head = self.heads[bucket];
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

    /// First nodes of the blocks that some cells lie in.
    #[inline(always)]
    fn heads_of(&self, cells: CellBox) -> Heads<'_> {
        // In loops: what arrays are mapped by is compiled for the baseline.
        let (mut low, mut high) = (cells.low, cells.high);
        for axis in 0..3 {
            low[axis] >>= self.block_bits;
            high[axis] >>= self.block_bits;
        }
        Heads { grid: self, low, high, next: low }
    }

    /// Every seed in the blocks that some cells lie in, and some from elsewhere, to `visit`.
    #[inline(always)]
    fn visit_blocks(&self, cells: CellBox, mut visit: impl FnMut(u32, [f32; 3])) {
        for mut next in self.heads_of(cells) {
            while let Some(node) = self.nodes.get(next as usize) {
                for (i, &id) in node.ids.iter().take_while(|id| **id != NONE).enumerate() {
                    visit(id, node.position(i));
                }
                next = node.next;
            }
        }
    }

    /// Every seed in the cells from `low` to `high` to `visit`.
    #[inline(always)]
    pub fn visit(&self, low: [i32; 3], high: [i32; 3], mut visit: impl FnMut(u32, [f32; 3])) {
        self.visit_blocks(CellBox { low, high }, |id, seed| {
            let cell = self.cell_of(seed);
            if (0..3).all(|i| cell[i] >= low[i] && cell[i] <= high[i]) {
                visit(id, seed);
            }
        });
    }

    /// The cells of a box between two corners.
    pub fn cells_between(&self, [low, high]: [[f32; 3]; 2]) -> CellBox {
        CellBox { low: self.cell_of(low), high: self.cell_of(high) }
    }

    /// Adds to `found` the seeds of a box between two corners.
    pub fn gather(&self, corners: [[f32; 3]; 2], found: &mut Vec<(u32, [f32; 3])>) {
        Isa::best().run(Gather { grid: self, corners, found });
    }

    /// The nearest seed within a cell's width of a place; of equals the oldest.
    pub fn nearest(&self, position: [f32; 3]) -> Option<u32> {
        let found = Isa::best().run(Nearest { grid: self, position });
        (found != NONE).then_some(found)
    }

    /// The nearest seed no farther than `reach`, a cell's width at most, from a place; of equals the oldest;
    /// [`NONE`] without one.
    #[inline(always)]
    pub fn nearest_within<V: Vector>(&self, position: [f32; 3], reach: f32) -> u32 {
        if !self.reaches(position) {
            return NONE;
        }
        let [x, y, z] = position;
        let place = [V::splat(x), V::splat(y), V::splat(z)];
        // `NONE` is above every id, so that a seed at exactly this distance counts.
        let (mut best, mut found) = (reach * reach, NONE);
        // A little more, as distances are rounded.
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
                    // The order of buckets must not decide between equals.
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

    /// The seed at exactly this place.
    pub fn at(&self, position: [f32; 3]) -> Option<u32> {
        if !self.reaches(position) {
            return None;
        }
        let cell = self.cell_of(position);
        let mut found = None;
        self.visit_blocks(CellBox { low: cell, high: cell }, |id, seed| {
            if seed == position {
                found = Some(id);
            }
        });
        found
    }
}

impl Node {
    /// No seeds, and no next node.
    const EMPTY: Self = Self { along: [[f32::NAN; NODE]; 3], ids: [NONE; NODE], next: NONE };

    /// Adds a seed where there is room.
    fn add(&mut self, id: u32, position: [f32; 3]) {
        if let Some(free) = self.ids.iter().position(|id| *id == NONE) {
            self.ids[free] = id;
            (0..3).for_each(|axis| self.along[axis][free] = position[axis]);
        }
    }

    /// Squared distances of its seeds from a place, summed x, y, z; NaN behind the last.
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

/// First nodes of blocks between two corners. By hand: what iterators are put together of is not compiled for a
/// kernel's instructions.
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

/// The nearest seed within a cell's width.
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

/// Adds the seeds of a box to those found.
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
                let mut inside = V::splat(EVERY_BIT);
                for axis in 0..3 {
                    let at = V::load(&node.along[axis]);
                    let above = V::splat(low[axis]).mask_at_most(at);
                    inside = inside.and(above).and(at.mask_at_most(V::splat(high[axis])));
                }
                let mut inside = inside.signs();
                while inside != 0 {
                    let i = inside.trailing_zeros() as usize % NODE;
                    found.push((node.ids[i], node.position(i)));
                    inside &= inside - 1;
                }
                next = node.next;
            }
        }
    }
}

/// Cells around some places, all that lie between the outermost.
#[derive(Clone, Copy, Debug)]
pub struct CellBox {
    /// The first along each axis.
    pub low: [i32; 3],
    /// The last along each axis.
    pub high: [i32; 3],
}

impl CellBox {
    /// How many cells it holds.
    pub fn n_cells(&self) -> f64 {
        // More, it may be, than 64 bits hold.
        let along = |i: usize| f64::from(self.high[i]) - f64::from(self.low[i]) + 1.0;
        (0..3).map(|i| along(i).max(0.0)).product()
    }
}

/// Squared distance of two places, summed x, y, z.
#[inline(always)]
pub fn squared_distance(a: [f32; 3], b: [f32; 3]) -> f32 {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

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
        assert_eq!(grid.at(grid.position(77)), Some(77));
        assert_eq!(grid.at([0.123, 0.0, 0.0]), None);
    }
}
