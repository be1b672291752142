//! `kiddo`'s KD-tree: the reference implementation, used to verify the grid.

use super::error::IndexError;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// An index queried point by point, with distances in f64.
pub struct KdTree(ImmutableKdTree<f64, 3>);

impl KdTree {
    /// Builds a tree over finite means.
    pub fn new(means: &[[f64; 3]]) -> Result<Self, IndexError> {
        let refuse = |reason| Err(IndexError { components: means.len(), reason });
        if !means.iter().flatten().all(|v| v.is_finite()) {
            return refuse("an initial mean is not finite".to_owned());
        }
        ImmutableKdTree::new_from_slice(means).map(Self).or_else(|e| refuse(e.to_string()))
    }

    /// Appends the ids of the `n` nearest means (or all, if fewer) in order of (squared distance, id).
    pub fn nearest(&self, query: [f64; 3], n: NonZero<usize>, ids: &mut Vec<u32>) {
        // One more than requested shows whether the last one has a tie.
        let query = self.0.query(&query);
        let found = query.nearest_n::<SquaredEuclidean<f64>>(n.saturating_add(1)).execute();
        let mut found: Vec<(f64, u32)> = found.iter().map(|f| (f.distance, f.item)).collect();
        if let Some(&(beyond, _)) = found.get(n.get())
            && found[n.get() - 1].0 == beyond
        {
            // The tree returns ties in any order; a second query for all at that distance lets ids decide.
            let equals = query.within::<SquaredEuclidean<f64>>(beyond).execute();
            found = equals.iter().map(|f| (f.distance, f.item)).collect();
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        ids.extend(found.iter().take(n.get()).map(|&(_, id)| id));
    }
}
