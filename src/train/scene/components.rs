//! Which seeds belong to which component: one to one, until a budget makes components share.
//!
//! Merging gives the seeds of one component to another instead of moving any: a seed decides which
//! points are assigned, and a seed that moved would leave sums behind that other points had formed.
//! Until something is merged there is no bookkeeping at all. Freed rows are taken again, the lowest
//! first.

/// The components and their seeds.
#[derive(Clone, Debug, Default)]
pub struct Components {
    /// Rows of sums, in use or free.
    n_rows: usize,
    /// `None` while component `k` has seed `k` and no other.
    sharing: Option<Sharing>,
}

/// Seeds that share components.
#[derive(Clone, Debug, Default)]
struct Sharing {
    /// By seed its component.
    component: Vec<u32>,
    /// By component its oldest seed, which its sums are about.
    reference: Vec<u32>,
    /// By component how many seeds it has.
    seeds: Vec<u16>,
    /// Components without seeds, the last to be taken first.
    free: Vec<u32>,
}

impl Components {
    /// Components of a scene whose seed `i` belongs to component `component[i]`, of `n_rows`;
    /// `None` if a component is beyond them.
    pub fn restore(component: Vec<u32>, n_rows: usize) -> Option<Self> {
        let mut sharing = Sharing {
            reference: vec![0; n_rows],
            seeds: vec![0; n_rows],
            component,
            free: Vec::new(),
        };
        // From the last seed on, so that the oldest is the one that stays.
        for (seed, &component) in sharing.component.iter().enumerate().rev() {
            *sharing.reference.get_mut(component as usize)? = seed as u32;
            let seeds = &mut sharing.seeds[component as usize];
            *seeds = seeds.saturating_add(1);
        }
        let is_free = |row: &u32| sharing.seeds[*row as usize] == 0;
        sharing.free = (0..n_rows as u32).rev().filter(is_free).collect();
        Some(Self { n_rows, sharing: Some(sharing) })
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
                + size_of_val(&s.seeds[..])
        })
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

    /// How many seeds a component has.
    #[inline(always)]
    pub fn n_seeds(&self, component: usize) -> f64 {
        self.sharing.as_ref().map_or(1.0, |s| f64::from(s.seeds[component]))
    }

    /// The component of a new seed, the one after all others.
    pub fn born(&mut self, seed: u32) -> u32 {
        let Some(sharing) = &mut self.sharing else {
            self.n_rows += 1;
            return seed;
        };
        let component = sharing.free.pop().unwrap_or_else(|| {
            self.n_rows += 1;
            sharing.reference.push(0);
            sharing.seeds.push(0);
            self.n_rows as u32 - 1
        });
        sharing.component.push(component);
        sharing.reference[component as usize] = seed;
        sharing.seeds[component as usize] = 1;
        component
    }

    /// Gives the seeds of the second component of every pair to the first, whose reference must be
    /// the older. No component may be in two pairs.
    pub fn merge(&mut self, pairs: &[(u32, u32)]) {
        let n = self.n_rows as u32;
        let sharing = self.sharing.get_or_insert_with(|| Sharing {
            component: (0..n).collect(),
            reference: (0..n).collect(),
            seeds: vec![1; n as usize],
            free: Vec::new(),
        });
        // One walk over the seeds for all pairs: they share no component, so no chain is followed.
        let mut into: Vec<u32> = (0..n).collect();
        for &(kept, dropped) in pairs {
            into[dropped as usize] = kept;
            let seeds = std::mem::take(&mut sharing.seeds[dropped as usize]);
            let all = &mut sharing.seeds[kept as usize];
            *all = all.saturating_add(seeds);
            sharing.free.push(dropped);
        }
        for component in &mut sharing.component {
            *component = into[*component as usize];
        }
        // The lowest row is popped first.
        sharing.free.sort_unstable_by(|a, b| b.cmp(a));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_components_give_their_rows_to_new_seeds() {
        let mut components = Components::default();
        for seed in 0..5 {
            assert_eq!(components.born(seed), seed);
        }
        assert_eq!(components.bytes(), 0, "one to one needs no bookkeeping");
        components.merge(&[(0, 3), (1, 2)]);
        assert_eq!((components.used(), components.n_rows()), (3, 5));
        assert_eq!([0, 1, 2, 3, 4].map(|seed| components.of_seed(seed)), [0, 1, 1, 0, 4]);
        assert_eq!((components.reference(0), components.n_seeds(0)), (0, 2.0));
        assert_eq!(components.born(5), 2);
        assert_eq!(components.born(6), 3);
        assert_eq!(components.born(7), 5);
        assert_eq!((components.reference(2), components.reference(5)), (5, 7));
        let shared = components.shared().unwrap().to_vec();
        let again = Components::restore(shared.clone(), components.n_rows()).unwrap();
        assert_eq!(again.shared().unwrap(), shared);
        assert_eq!((again.reference(0), again.reference(2), again.used()), (0, 5, 6));
        assert!(Components::restore(vec![0, 9], 2).is_none());
    }
}
