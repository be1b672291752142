//! Mean ELBO per component over the points of the current frame, for colouring a scene by ELBO. Each
//! point belongs to the component with the largest responsibility for it. While disabled, this takes
//! neither time nor memory.

use super::estep::Scoring;

/// Marks a point that no component owns, because its score is NaN. The owner of a point is the
/// component with the largest responsibility for it.
pub(super) const NO_OWNER: u32 = u32::MAX;

/// Returns the component with the largest responsibility, the first if several are equal. [`NO_OWNER`]
/// if all responsibilities are zero.
#[inline(always)]
pub(super) fn owner_of_shares(shares: impl Iterator<Item = (u32, f64)>) -> u32 {
    let first = (NO_OWNER, 0.0);
    shares.fold(first, |best, share| if share.1 > best.1 { share } else { best }).0
}

/// Mean ELBO per component over the points of the last frame.
pub struct ComponentElbo {
    scoring: Scoring,
    ownership: Option<Ownership>,
}

impl ComponentElbo {
    /// Creates a disabled accumulator; `scoring` converts effective distances to nats.
    pub fn new(scoring: Scoring) -> Self {
        Self { scoring, ownership: None }
    }

    /// Replaces the conversion from effective distances to nats.
    pub(super) fn set_scoring(&mut self, scoring: Scoring) {
        self.scoring = scoring;
    }

    /// Enables the per-component sums, beginning with the next frame.
    pub fn start(&mut self) {
        self.ownership.get_or_insert_default();
    }

    /// Disables the per-component sums and frees their memory.
    pub fn stop(&mut self) {
        self.ownership = None;
    }

    /// Returns the mean ELBO (nats) over the points of the last frame that a component owns, and the
    /// number of these points. `None` if the component owns no point or the sums were disabled.
    pub fn mean_elbo_of(&self, component: usize) -> Option<(f64, u32)> {
        let (q, n) = self.ownership.as_ref()?.of(component)?;
        Some((self.scoring.elbo(q), n))
    }

    /// Returns the components that own points of the last frame, in the order of each component's first
    /// point.
    pub fn components(&self) -> &[u32] {
        self.ownership.as_ref().map_or(&[], |ownership| &ownership.ids)
    }

    /// Returns the buffer to which a pass writes the owner of every point; `None` while the sums are
    /// disabled.
    pub(super) fn owners(&mut self) -> Option<&mut Vec<u32>> {
        self.ownership.as_mut().map(|ownership| &mut ownership.owners)
    }

    /// Recomputes the sums from the effective distances `q` of the points whose owners are in
    /// [`Self::owners`].
    pub(super) fn accumulate(&mut self, q: &[f64], n_components: usize) {
        if let Some(ownership) = &mut self.ownership {
            ownership.count(q, n_components);
        }
    }
}

/// Sums over the points owned by each component (those for which it has the largest responsibility).
/// Buffers are reused from frame to frame.
#[derive(Default)]
struct Ownership {
    /// Owner of each point of the last frame.
    owners: Vec<u32>,
    /// Sum of effective distances and number of points, by component.
    rows: Vec<(f64, u32)>,
    /// Components that own points of the last frame.
    ids: Vec<u32>,
}

impl Ownership {
    fn count(&mut self, q: &[f64], n_components: usize) {
        // Never shorter: the rows of the last frame are cleared below.
        self.rows.resize(n_components.max(self.rows.len()), (0.0, 0));
        // Clears only the rows of the last frame: a frame reaches few components.
        for id in self.ids.drain(..) {
            self.rows[id as usize] = (0.0, 0);
        }
        // Reserves the maximum, so that later frames allocate nothing.
        self.ids.reserve(n_components);
        for (&owner, &q) in self.owners.iter().zip(q) {
            if owner == NO_OWNER {
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

    fn of(&self, component: usize) -> Option<(f64, u32)> {
        let &(sum, n) = self.rows.get(component)?;
        (n > 0).then(|| (sum / f64::from(n), n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_equals_owns_a_point_and_none_one_without_shares() {
        assert_eq!(owner_of_shares([(4, 0.2), (1, 0.4), (9, 0.4)].into_iter()), 1);
        assert_eq!(owner_of_shares([(4, 0.0)].into_iter()), NO_OWNER);
    }
}
