//! Which seeds belong to which component: one to one, until a budget makes components share.
//!
//! Merging gives the seeds of one component to another instead of moving any: a seed decides which
//! points are assigned, and a seed that moved would leave sums behind that other points had formed.
//! Until something is merged there is no bookkeeping at all. Freed rows are taken again, the lowest
//! first.

use crate::model::scene::state::WHOLE;

/// Surface of a whole seed, as it is counted: in whole numbers, so that sums are exact.
const SURFACE: u32 = WHOLE as u32 * WHOLE as u32;

/// The components and their seeds.
#[derive(Clone, Debug, Default)]
pub struct Components {
    /// Rows of sums, in use or free.
    n_rows: usize,
    /// `None` while component `k` has seed `k` and no other.
    sharing: Option<Sharing>,
    /// By seed its share of the structural scale, in parts of [`WHOLE`]; empty while all have the whole.
    shares: Vec<u8>,
}

/// Seeds that share components.
#[derive(Clone, Debug, Default)]
struct Sharing {
    /// By seed its component.
    component: Vec<u32>,
    /// By component its oldest seed, which its sums are about.
    reference: Vec<u32>,
    /// By component the surface of its seeds, in parts of [`SURFACE`]; 0 without any.
    surface: Vec<u32>,
    /// Components without seeds, the last to be taken first.
    free: Vec<u32>,
}

impl Components {
    /// Components of a scene whose seed `i` belongs to component `component[i]`, of `n_rows`, and has the
    /// share `shares[i]`; `None` if a component is beyond them.
    pub fn restore(component: Vec<u32>, n_rows: usize, shares: Vec<u8>) -> Option<Self> {
        let mut sharing = Sharing {
            reference: vec![0; n_rows],
            surface: vec![0; n_rows],
            component,
            free: Vec::new(),
        };
        // From the last seed on, so that the oldest is the one that stays.
        for (seed, &component) in sharing.component.iter().enumerate().rev() {
            *sharing.reference.get_mut(component as usize)? = seed as u32;
            let surface = &mut sharing.surface[component as usize];
            *surface = surface.saturating_add(squared(share_of(&shares, seed)));
        }
        let is_free = |row: &u32| sharing.surface[*row as usize] == 0;
        sharing.free = (0..n_rows as u32).rev().filter(is_free).collect();
        Some(Self { n_rows, sharing: Some(sharing), shares })
    }

    /// Rows of sums, in use or free.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Components with seeds.
    pub fn used(&self) -> usize {
        self.n_rows - self.sharing.as_ref().map_or(0, |s| s.free.len())
    }

    /// By seed its component, if seeds share components.
    pub fn shared(&self) -> Option<&[u32]> {
        self.sharing.as_ref().map(|s| s.component.as_slice())
    }

    /// Bytes that the bookkeeping takes.
    pub fn bytes(&self) -> usize {
        self.sharing.as_ref().map_or(0, |s| {
            size_of_val(&s.component[..])
                + size_of_val(&s.reference[..])
                + size_of_val(&s.surface[..])
        }) + self.shares.len()
    }

    /// Component of a seed.
    #[inline(always)]
    pub fn of_seed(&self, seed: u32) -> u32 {
        self.sharing.as_ref().map_or(seed, |s| s.component[seed as usize])
    }

    /// The seed that a component's sums are about.
    #[inline(always)]
    pub fn reference(&self, component: usize) -> usize {
        self.sharing.as_ref().map_or(component, |s| s.reference[component] as usize)
    }

    /// Surface that a component's seeds stand for, in squares of the structural scale.
    #[inline(always)]
    pub fn surface(&self, component: usize) -> f64 {
        let parts = match &self.sharing {
            Some(sharing) => sharing.surface[component],
            None => squared(self.share(component)),
        };
        f64::from(parts) / f64::from(SURFACE)
    }

    /// Share of the structural scale that points may be from a seed, in parts of [`WHOLE`].
    #[inline(always)]
    pub fn share(&self, seed: usize) -> u8 {
        share_of(&self.shares, seed)
    }

    /// Those of all seeds, unless all have the whole.
    pub fn shares(&self) -> Option<&[u8]> {
        (!self.shares.is_empty()).then_some(&self.shares)
    }

    /// The component of a new seed, the one after all others, and its share.
    pub fn born(&mut self, seed: u32, share: u8) -> u32 {
        if share != WHOLE || !self.shares.is_empty() {
            self.shares.resize(seed as usize, WHOLE);
            self.shares.push(share);
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
        sharing.surface[component as usize] = squared(share);
        component
    }

    /// Gives the seeds of the second component of every pair to the first, whose reference must be
    /// the older. No component may be in two pairs.
    pub fn merge(&mut self, pairs: &[(u32, u32)]) {
        let n = self.n_rows as u32;
        let sharing = self.sharing.get_or_insert_with(|| Sharing {
            component: (0..n).collect(),
            reference: (0..n).collect(),
            surface: (0..n as usize).map(|seed| squared(share_of(&self.shares, seed))).collect(),
            free: Vec::new(),
        });
        // One walk over the seeds for all pairs: they share no component, so no chain is followed.
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
        // The lowest row is popped first.
        sharing.free.sort_unstable_by(|a, b| b.cmp(a));
    }
}

fn share_of(shares: &[u8], seed: usize) -> u8 {
    shares.get(seed).copied().unwrap_or(WHOLE)
}

fn squared(share: u8) -> u32 {
    u32::from(share) * u32::from(share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_components_give_their_rows_to_new_seeds() {
        let mut components = Components::default();
        for seed in 0..5 {
            assert_eq!(components.born(seed, WHOLE), seed);
        }
        assert_eq!(components.bytes(), 0, "one to one needs no bookkeeping");
        components.merge(&[(0, 3), (1, 2)]);
        assert_eq!((components.used(), components.n_rows()), (3, 5));
        assert_eq!([0, 1, 2, 3, 4].map(|seed| components.of_seed(seed)), [0, 1, 1, 0, 4]);
        assert_eq!((components.reference(0), components.surface(0)), (0, 2.0));
        assert_eq!(components.born(5, WHOLE), 2);
        assert_eq!(components.born(6, WHOLE), 3);
        assert_eq!(components.born(7, WHOLE), 5);
        assert_eq!((components.reference(2), components.reference(5)), (5, 7));
        let shared = components.shared().unwrap().to_vec();
        let again = Components::restore(shared.clone(), components.n_rows(), Vec::new()).unwrap();
        assert_eq!(again.shared().unwrap(), shared);
        assert_eq!((again.reference(0), again.reference(2), again.used()), (0, 5, 6));
        assert!(Components::restore(vec![0, 9], 2, Vec::new()).is_none());
    }

    #[test]
    fn surfaces_are_those_of_the_seeds_that_were_joined() {
        let mut components = Components::default();
        for share in [WHOLE, 32, 16, WHOLE] {
            components.born(components.n_rows() as u32, share);
        }
        assert_eq!([0, 1, 2, 3].map(|id| components.surface(id)), [1.0, 0.25, 0.0625, 1.0]);
        components.merge(&[(1, 2), (0, 3)]);
        components.born(4, 48);
        assert_eq!([0, 1, 2].map(|id| components.surface(id)), [2.0, 0.3125, 0.5625]);
        let shared = components.shared().unwrap().to_vec();
        let shares = components.shares().unwrap().to_vec();
        let again = Components::restore(shared, 4, shares).unwrap();
        assert_eq!([0, 1, 2, 3].map(|id| again.surface(id)), [2.0, 0.3125, 0.5625, 0.0]);
        assert_eq!((again.share(1), again.share(4), again.share(0)), (32, 48, WHOLE));
    }
}
