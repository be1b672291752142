//! Mapping from seeds to components: one to one, until a budget makes seeds share components.
//!
//! Merging reassigns the seeds of one component to another and moves none: a seed decides which points are
//! assigned, so moving it would separate it from the sums of its former points. Until the first merge nothing
//! is stored. Freed rows are reused, lowest first.

use super::gauge::moved_seed;
use super::grid::SeedGrid;
use crate::math::pose::Pose;
use crate::model::scene::state::WHOLE;
use glam::DVec3;

// Surface of a whole seed: integers make sums exact.
const SURFACE: u32 = WHOLE as u32 * WHOLE as u32;

#[derive(Clone, Debug, Default)]
pub struct Components {
    /// Number of rows of sums, used or free.
    n_rows: usize,
    /// Assignment of seeds to components; `None` while component `k` has seed `k` and no other seed.
    sharing: Option<Sharing>,
    /// For each seed, the maximum distance of its points, in units of 1/[`WHOLE`] of the structural
    /// scale. It is less than [`WHOLE`] for seeds created before the scale grew. Empty while it is
    /// [`WHOLE`] for all seeds.
    shares: Vec<u8>,
}

#[derive(Clone, Debug, Default)]
struct Sharing {
    component: Vec<u32>,
    /// Oldest seed of each component, from which the component's sums measure offsets.
    reference: Vec<u32>,
    /// Surface area that each component's seeds represent, in units of 1/[`SURFACE`] of the squared
    /// structural scale. 0 if the component has no seeds.
    surface: Vec<u32>,
    /// Components without seeds. The last one in the list is reused first.
    free: Vec<u32>,
}

impl Components {
    /// Restores the components of a scene in which every seed has its own component.
    pub fn of_seeds(n_seeds: usize, shares: Vec<u8>) -> Self {
        Self { n_rows: n_seeds, sharing: None, shares }
    }

    /// Restores `n_rows` components of a scene. Seed `i` belongs to `component[i]` and has the share
    /// `shares[i]` of the structural scale. `None` if a component number is out of range.
    pub fn restore(component: Vec<u32>, n_rows: usize, shares: Vec<u8>) -> Option<Self> {
        let mut sharing = Sharing {
            reference: vec![0; n_rows],
            surface: vec![0; n_rows],
            component,
            free: Vec::new(),
        };
        // In reverse, so that the oldest seed becomes the reference.
        for (seed, &component) in sharing.component.iter().enumerate().rev() {
            *sharing.reference.get_mut(component as usize)? = seed as u32;
            let surface = &mut sharing.surface[component as usize];
            // A file may list any number of seeds of one component.
            *surface = surface.saturating_add(squared(share_of(&shares, seed)));
        }
        let is_free = |row: &u32| sharing.surface[*row as usize] == 0;
        // Descending, so that the lowest row is popped first.
        sharing.free = (0..n_rows as u32).rev().filter(is_free).collect();
        Some(Self { n_rows, sharing: Some(sharing), shares })
    }

    /// Returns the number of rows of sums, used or free.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Returns the number of components with seeds.
    pub fn used(&self) -> usize {
        self.n_rows - self.sharing.as_ref().map_or(0, |s| s.free.len())
    }

    /// Returns the component of each seed, if seeds share components.
    pub fn shared(&self) -> Option<&[u32]> {
        self.sharing.as_ref().map(|s| s.component.as_slice())
    }

    pub fn bytes(&self) -> usize {
        self.sharing.as_ref().map_or(0, |s| {
            size_of_val(&s.component[..])
                + size_of_val(&s.reference[..])
                + size_of_val(&s.surface[..])
        }) + self.shares.len()
    }

    #[inline(always)]
    pub fn of_seed(&self, seed: u32) -> u32 {
        self.sharing.as_ref().map_or(seed, |s| s.component[seed as usize])
    }

    /// Returns the seed from which a component's sums measure offsets.
    #[inline(always)]
    pub fn reference_seed(&self, component: usize) -> usize {
        self.sharing.as_ref().map_or(component, |s| s.reference[component] as usize)
    }

    /// Returns the surface area that a component's seeds represent, in units of the squared structural
    /// scale.
    #[inline(always)]
    pub fn surface(&self, component: usize) -> f64 {
        let parts = match &self.sharing {
            Some(sharing) => sharing.surface[component],
            None => squared(self.share(component)),
        };
        f64::from(parts) / f64::from(SURFACE)
    }

    /// Returns the maximum distance of points from a seed, in units of 1/[`WHOLE`] of the structural scale.
    #[inline(always)]
    pub fn share(&self, seed: usize) -> u8 {
        share_of(&self.shares, seed)
    }

    /// Returns [`Self::share`] of every seed; `None` if all seeds have [`WHOLE`].
    pub fn shares(&self) -> Option<&[u8]> {
        (!self.shares.is_empty()).then_some(&self.shares)
    }

    /// Adds a seed, whose number must be the next one, and returns its new component.
    pub fn add_seed(&mut self, seed: u32) -> u32 {
        // Seeds have the whole until the scale grows, which needs no list.
        if !self.shares.is_empty() {
            self.shares.push(WHOLE);
        }
        let Some(sharing) = &mut self.sharing else {
            self.n_rows += 1;
            return seed;
        };
        let component = sharing.free.pop().unwrap_or_else(|| {
            self.n_rows += 1;
            sharing.reference.push(0);
            sharing.surface.push(0);
            self.n_rows as u32 - 1
        });
        sharing.component.push(component);
        sharing.reference[component as usize] = seed;
        sharing.surface[component as usize] = SURFACE;
        component
    }

    /// Reassigns the seeds of the second component of every pair to the first, which must have the older
    /// reference seed. No component may occur in two pairs.
    pub fn merge(&mut self, pairs: &[(u32, u32)]) {
        let n = self.n_rows as u32;
        let sharing = self.sharing.get_or_insert_with(|| Sharing {
            component: (0..n).collect(),
            reference: (0..n).collect(),
            surface: (0..n as usize).map(|seed| squared(share_of(&self.shares, seed))).collect(),
            free: Vec::new(),
        });
        // One pass over the seeds suffices: pairs are disjoint, so there are no chains.
        let mut into: Vec<u32> = (0..n).collect();
        for &(kept, dropped) in pairs {
            into[dropped as usize] = kept;
            let surface = std::mem::take(&mut sharing.surface[dropped as usize]);
            let all = &mut sharing.surface[kept as usize];
            *all = all.saturating_add(surface);
            sharing.free.push(dropped);
        }
        for component in &mut sharing.component {
            *component = into[*component as usize];
        }
        // Descending, so that the lowest row is popped first.
        sharing.free.sort_unstable_by(|a, b| b.cmp(a));
    }
}

fn share_of(shares: &[u8], seed: usize) -> u8 {
    shares.get(seed).copied().unwrap_or(WHOLE)
}

fn squared(share: u8) -> u32 {
    u32::from(share) * u32::from(share)
}

/// Seeds (points at which components were created) and the components to which they belong.
pub struct Seeds {
    pub grid: SeedGrid,
    pub components: Components,
}

impl Seeds {
    pub fn new(h: f64) -> Self {
        Self { grid: SeedGrid::new(h), components: Components::default() }
    }

    /// Restores the seeds of a scene with `n_rows` rows of sums and the structural scale `h` (world
    /// units). `None` if a seed is too far from the origin or a component number is out of range.
    pub fn restore(
        h: f64,
        places: &[[f32; 3]],
        components: Option<Vec<u32>>,
        shares: Vec<u8>,
        n_rows: usize,
    ) -> Option<Self> {
        let mut grid = SeedGrid::new(h);
        for &place in places {
            if !grid.has_cell(place) {
                return None;
            }
            grid.insert(place);
        }
        let components = match components {
            Some(of_seeds) => Components::restore(of_seeds, n_rows, shares)?,
            None => Components::of_seeds(grid.len(), shares),
        };
        Some(Self { grid, components })
    }

    /// Adds a seed and returns its new component. The position must have a cell in the grid.
    pub fn add(&mut self, place: [f32; 3]) -> u32 {
        self.components.add_seed(self.grid.insert(place))
    }

    /// Returns the seed from which a component's sums measure offsets, world units from the scene's
    /// origin.
    #[inline(always)]
    pub fn of(&self, component: usize) -> [f32; 3] {
        self.grid.position(self.components.reference_seed(component))
    }

    /// Returns the maximum distance of a component's points from its seed, in units of the structural
    /// scale.
    pub fn share(&self, component: usize) -> f64 {
        let share = self.components.share(self.components.reference_seed(component));
        f64::from(share) / f64::from(WHOLE)
    }

    /// Applies a rigid motion of the world to all seeds, which are relative to `origin`. Returns false,
    /// without any change, if a seed would leave the range of the grid.
    pub fn move_by(&mut self, motion: &Pose, origin: DVec3) -> bool {
        let Some(moved) = self.grid.moved(|seed| moved_seed(seed, origin, motion)) else {
            return false;
        };
        self.grid = moved;
        true
    }

    pub fn bytes(&self) -> usize {
        self.grid.bytes() + self.components.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_components_give_their_rows_to_new_seeds() {
        let mut components = Components::default();
        for seed in 0..5 {
            assert_eq!(components.add_seed(seed), seed);
        }
        assert_eq!(components.bytes(), 0, "one to one needs no bookkeeping");
        components.merge(&[(0, 3), (1, 2)]);
        assert_eq!((components.used(), components.n_rows()), (3, 5));
        assert_eq!([0, 1, 2, 3, 4].map(|seed| components.of_seed(seed)), [0, 1, 1, 0, 4]);
        assert_eq!((components.reference_seed(0), components.surface(0)), (0, 2.0));
        assert_eq!(components.add_seed(5), 2);
        assert_eq!(components.add_seed(6), 3);
        assert_eq!(components.add_seed(7), 5);
        assert_eq!((components.reference_seed(2), components.reference_seed(5)), (5, 7));
        let shared = components.shared().unwrap().to_vec();
        let again = Components::restore(shared.clone(), components.n_rows(), Vec::new()).unwrap();
        assert_eq!(again.shared().unwrap(), shared);
        assert_eq!((again.reference_seed(0), again.reference_seed(2), again.used()), (0, 5, 6));
        assert!(Components::restore(vec![0, 9], 2, Vec::new()).is_none());
    }

    #[test]
    fn surfaces_are_those_of_the_seeds_that_were_joined() {
        let mut components = Components::of_seeds(4, vec![WHOLE, 32, 16, WHOLE]);
        assert_eq!([0, 1, 2, 3].map(|id| components.surface(id)), [1.0, 0.25, 0.0625, 1.0]);
        components.merge(&[(1, 2), (0, 3)]);
        components.add_seed(4);
        assert_eq!([0, 1, 2].map(|id| components.surface(id)), [2.0, 0.3125, 1.0]);
        let shared = components.shared().unwrap().to_vec();
        let shares = components.shares().unwrap().to_vec();
        let again = Components::restore(shared, 4, shares).unwrap();
        assert_eq!([0, 1, 2, 3].map(|id| again.surface(id)), [2.0, 0.3125, 1.0, 0.0]);
        assert_eq!((again.share(1), again.share(4), again.share(0)), (32, WHOLE, WHOLE));
    }
}
