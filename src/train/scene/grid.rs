//! Seeds by place: a hash grid with cells as wide as the structural scale.
//!
//! A scene has no bounds that are known beforehand, so cells are hashed instead of laid out.
//! Buckets are chains through an array of seeds: insertion moves nothing, growth relinks, and seeds
//! keep their numbers. Buckets may hold seeds of other cells as well; callers compare distances
//! anyway.

/// Stands for no seed, and for no component.
pub const NONE: u32 = u32::MAX;
/// Cells from the origin that can be told apart on every axis.
// At 2²⁰ cells an f32 still tells sixteenths of a cell apart.
const MAX_CELLS: f32 = (1 << 20) as f32;
/// Buckets of a grid without seeds.
const MIN_BUCKETS: usize = 1024;

/// Seeds of all components, found by place.
pub struct SeedGrid {
    cell: f32,
    per_cell: f32,
    positions: Vec<[f32; 3]>,
    /// By seed the next one of its bucket.
    next: Vec<u32>,
    /// First seed by bucket; a power of two of them.
    heads: Vec<u32>,
}

impl SeedGrid {
    /// No seeds yet; cells are `cell` world units wide.
    pub fn new(cell: f64) -> Self {
        Self {
            cell: cell as f32,
            per_cell: (1.0 / cell) as f32,
            positions: Vec::new(),
            next: Vec::new(),
            heads: vec![NONE; MIN_BUCKETS],
        }
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

    /// Bytes that the grid takes.
    pub fn bytes(&self) -> usize {
        self.len() * (size_of::<[f32; 3]>() + size_of::<u32>())
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
        position.map(|x| (x * self.per_cell).floor() as i32)
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
        // As many buckets as seeds at least keep chains short.
        if self.len() >= self.heads.len() {
            self.grow();
        }
        let id = self.len() as u32;
        self.positions.push(position);
        self.next.push(NONE);
        self.link(id);
        id
    }

    fn link(&mut self, id: u32) {
        let bucket = self.bucket(self.cell_of(self.positions[id as usize]));
        self.next[id as usize] = self.heads[bucket];
        self.heads[bucket] = id;
    }

    fn grow(&mut self) {
        let n = self.heads.len() * 2;
        self.heads.clear();
        self.heads.resize(n, NONE);
        for id in 0..self.len() as u32 {
            self.link(id);
        }
    }

    /// Every seed in the cells from `low` to `high`, and some from elsewhere, to `visit`.
    #[inline(always)]
    pub fn visit(&self, low: [i32; 3], high: [i32; 3], mut visit: impl FnMut(u32, [f32; 3])) {
        for z in low[2]..=high[2] {
            for y in low[1]..=high[1] {
                for x in low[0]..=high[0] {
                    let mut id = self.heads[self.bucket([x, y, z])];
                    while id != NONE {
                        visit(id, self.positions[id as usize]);
                        id = self.next[id as usize];
                    }
                }
            }
        }
    }

    /// The nearest seed within a cell's width of a place; of equals the oldest.
    pub fn nearest(&self, position: [f32; 3]) -> Option<u32> {
        if !self.reaches(position) {
            return None;
        }
        // `NONE` is above every id, so that a seed at exactly a cell's width counts.
        let (mut best, mut found) = (self.cell * self.cell, NONE);
        let cell = self.cell_of(position);
        self.visit(cell.map(|c| c - 1), cell.map(|c| c + 1), |id, seed| {
            let d2 = squared_distance(position, seed);
            // The order of buckets must not decide between equals.
            if d2 < best || (d2 == best && id < found) {
                (best, found) = (d2, id);
            }
        });
        (found != NONE).then_some(found)
    }

    /// The seed at exactly this place.
    pub fn at(&self, position: [f32; 3]) -> Option<u32> {
        if !self.reaches(position) {
            return None;
        }
        let cell = self.cell_of(position);
        let mut found = None;
        self.visit(cell, cell, |id, seed| {
            if seed == position {
                found = Some(id);
            }
        });
        found
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
    /// That of no place.
    pub const EMPTY: Self = Self { low: [i32::MAX; 3], high: [i32::MIN; 3] };

    /// Grows until it holds the cells from `low` to `high`.
    pub fn include(&mut self, low: [i32; 3], high: [i32; 3]) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(low[axis]);
            self.high[axis] = self.high[axis].max(high[axis]);
        }
    }

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
