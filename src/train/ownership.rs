//! How well the points of a frame are explained, by the component that has the largest share in
//! each: what colours a scene by the ELBO of the current frame.

/// The owner of a point that is left out: its score is no number.
pub(super) const NOBODY: u32 = u32::MAX;

/// The component of largest responsibility, the first of equals; [`NOBODY`] where none has any.
#[inline(always)]
pub(super) fn largest(shares: impl Iterator<Item = (u32, f64)>) -> u32 {
    let first = (NOBODY, 0.0);
    shares.fold(first, |best, share| if share.1 > best.1 { share } else { best }).0
}

/// Sums over the points that each component owns. Memory is kept from frame to frame.
#[derive(Default)]
pub(super) struct Ownership {
    /// Per point of the last frame its component.
    pub owners: Vec<u32>,
    /// Per component the sum of effective distances and the number of its points.
    rows: Vec<(f64, u32)>,
    /// Components with points in the last frame, each once.
    ids: Vec<u32>,
}

impl Ownership {
    /// For so many components, none of which owns a point.
    pub fn new(components: usize) -> Self {
        let rows = vec![(0.0, 0); components];
        Self { owners: Vec::new(), rows, ids: Vec::with_capacity(components) }
    }

    /// Makes room for components up to `n`.
    pub fn grow(&mut self, n: usize) {
        self.rows.resize(n.max(self.rows.len()), (0.0, 0));
    }

    /// Replaces the sums by those of the points whose effective distances are `q`, one for each of
    /// `owners`, in their order.
    pub fn count(&mut self, q: &[f64]) {
        // Only rows that hold something: a frame touches far fewer components than there are.
        for id in self.ids.drain(..) {
            self.rows[id as usize] = (0.0, 0);
        }
        for (&owner, &q) in self.owners.iter().zip(q) {
            if owner == NOBODY {
                continue;
            }
            let (sum, n) = &mut self.rows[owner as usize];
            if *n == 0 {
                self.ids.push(owner);
            }
            *sum += q;
            *n += 1;
        }
    }

    /// Mean effective distance and number of a component's points; `None` if it owns none.
    pub fn of(&self, component: usize) -> Option<(f64, u32)> {
        let &(sum, n) = self.rows.get(component)?;
        (n > 0).then(|| (sum / f64::from(n), n))
    }

    /// Components that own points of the last frame, each once, by their first point.
    pub fn ids(&self) -> &[u32] {
        &self.ids
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_replaces_the_one_before() {
        let mut ownership = Ownership::new(4);
        ownership.owners = vec![2, 0, NOBODY, 2];
        ownership.count(&[1.0, 5.0, f64::NAN, 2.0]);
        assert_eq!((ownership.of(2), ownership.of(0)), (Some((1.5, 2)), Some((5.0, 1))));
        assert_eq!((ownership.of(1), ownership.ids()), (None, &[2, 0][..]));
        ownership.owners = vec![3];
        ownership.count(&[7.0]);
        assert_eq!((ownership.of(2), ownership.of(3)), (None, Some((7.0, 1))));
    }

    #[test]
    fn the_first_of_equals_owns_a_point_and_nobody_one_without_shares() {
        assert_eq!(largest([(4, 0.2), (1, 0.4), (9, 0.4)].into_iter()), 1);
        assert_eq!(largest([(4, 0.0)].into_iter()), NOBODY);
    }
}
