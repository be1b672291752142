//! How well the points of a frame are explained, by the component that has the largest share in
//! each: what colours a scene by the ELBO of the current frame. Both presets keep one; while nobody
//! asks for it, it costs neither time nor memory.

use super::estep::Scoring;

/// The owner of a point that is left out: its score is no number.
pub(super) const NOBODY: u32 = u32::MAX;

/// The component of largest responsibility, the first of equals; [`NOBODY`] where none has any.
#[inline(always)]
pub(super) fn largest(shares: impl Iterator<Item = (u32, f64)>) -> u32 {
    let first = (NOBODY, 0.0);
    shares.fold(first, |best, share| if share.1 > best.1 { share } else { best }).0
}

/// Mean ELBO of every component's points in the last frame.
pub struct ComponentElbo {
    scoring: Scoring,
    ownership: Option<Ownership>,
}

impl ComponentElbo {
    /// Asked for by nobody yet; `scoring` turns effective distances into nats.
    pub fn new(scoring: Scoring) -> Self {
        Self { scoring, ownership: None }
    }

    /// Turns effective distances into nats otherwise from now on.
    pub(super) fn score_by(&mut self, scoring: Scoring) {
        self.scoring = scoring;
    }

    /// Sums the ELBO of the points of every frame to come by the component with the largest share
    /// in each.
    pub fn start(&mut self) {
        self.ownership.get_or_insert_default();
    }

    /// Ends what [`Self::start`] began and frees its memory.
    pub fn stop(&mut self) {
        self.ownership = None;
    }

    /// Mean ELBO (nats) and number of the points of the last frame that a component has the largest
    /// share in; `None` if it has none, or if nobody asked before that frame.
    pub fn of(&self, component: usize) -> Option<(f64, u32)> {
        let (q, n) = self.ownership.as_ref()?.of(component)?;
        Some((self.scoring.elbo(q), n))
    }

    /// Components that [`Self::of`] knows of, each once, by their first point.
    pub fn components(&self) -> &[u32] {
        self.ownership.as_ref().map_or(&[], |ownership| &ownership.ids)
    }

    /// Where a pass writes the component of largest responsibility of every point; `None` while
    /// nobody asks.
    pub(super) fn owners(&mut self) -> Option<&mut Vec<u32>> {
        self.ownership.as_mut().map(|ownership| &mut ownership.owners)
    }

    /// Replaces the sums by those of the points whose effective distances are `q`, one for each of
    /// [`Self::owners`], in their order, of `n_components`.
    pub(super) fn count(&mut self, q: &[f64], n_components: usize) {
        if let Some(ownership) = &mut self.ownership {
            ownership.count(q, n_components);
        }
    }
}

/// Sums over the points that each component owns. Memory is kept from frame to frame.
#[derive(Default)]
struct Ownership {
    /// Per point of the last frame its component.
    owners: Vec<u32>,
    /// Per component the sum of effective distances and the number of its points.
    rows: Vec<(f64, u32)>,
    /// Components with points in the last frame, each once.
    ids: Vec<u32>,
}

impl Ownership {
    fn count(&mut self, q: &[f64], n_components: usize) {
        self.rows.resize(n_components.max(self.rows.len()), (0.0, 0));
        // Only rows of the last frame: a frame reaches few of the components.
        for id in self.ids.drain(..) {
            self.rows[id as usize] = (0.0, 0);
        }
        // A frame without new owners allocates nothing: there are never more of them than
        // components.
        self.ids.reserve(n_components);
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

    fn of(&self, component: usize) -> Option<(f64, u32)> {
        let &(sum, n) = self.rows.get(component)?;
        (n > 0).then(|| (sum / f64::from(n), n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_replaces_the_one_before() {
        let owners = vec![2, 0, NOBODY, 2];
        let mut ownership = Ownership { owners, ..Ownership::default() };
        ownership.count(&[1.0, 5.0, f64::NAN, 2.0], 4);
        assert_eq!((ownership.of(2), ownership.of(0)), (Some((1.5, 2)), Some((5.0, 1))));
        assert_eq!((ownership.of(1), &ownership.ids[..]), (None, &[2, 0][..]));
        ownership.owners = vec![3];
        ownership.count(&[7.0], 4);
        assert_eq!((ownership.of(2), ownership.of(3)), (None, Some((7.0, 1))));
    }

    #[test]
    fn the_first_of_equals_owns_a_point_and_nobody_one_without_shares() {
        assert_eq!(largest([(4, 0.2), (1, 0.4), (9, 0.4)].into_iter()), 1);
        assert_eq!(largest([(4, 0.0)].into_iter()), NOBODY);
    }
}
