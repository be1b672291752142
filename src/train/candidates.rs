//! Exact C-nearest search over the initial spatial means, by `kiddo`'s immutable KD-tree.

use crate::math::real::Real;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use std::num::NonZero;

/// The index could not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "building the candidate index over {components} components failed: {reason}; try fewer --components"
)]
pub struct IndexError {
    /// Number of means.
    pub components: usize,
    /// What the index said.
    pub reason: String,
}

/// A precision in which candidates can be searched.
pub trait Scalar: Real {
    /// The search tree over means of this precision.
    type Tree: Send + Sync;

    /// Builds the tree over finite means.
    fn build(means: &[[Self; 3]]) -> Result<Self::Tree, IndexError>;

    /// Appends the ids of the `n` nearest means in ascending distance; fewer if there are fewer.
    fn nearest(tree: &Self::Tree, query: &[Self; 3], n: NonZero<usize>, ids: &mut Vec<u32>);
}

macro_rules! impl_scalar {
    ($t:ty) => {
        impl Scalar for $t {
            type Tree = ImmutableKdTree<$t, 3>;

            fn build(means: &[[Self; 3]]) -> Result<Self::Tree, IndexError> {
                ImmutableKdTree::new_from_slice(means)
                    .map_err(|e| IndexError { components: means.len(), reason: e.to_string() })
            }

            fn nearest(
                tree: &Self::Tree,
                query: &[Self; 3],
                n: NonZero<usize>,
                ids: &mut Vec<u32>,
            ) {
                let found = tree.query(query).nearest_n::<SquaredEuclidean<$t>>(n).execute();
                ids.extend(found.iter().map(|item| item.item));
            }
        }
    };
}

impl_scalar!(f32);
impl_scalar!(f64);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    fn brute_force(means: &[[f32; 3]], q: [f32; 3], n: usize) -> Vec<f32> {
        let mut d: Vec<f32> =
            means.iter().map(|m| (0..3).map(|i| (m[i] - q[i]) * (m[i] - q[i])).sum()).collect();
        d.sort_by(f32::total_cmp);
        d.truncate(n);
        d
    }

    #[test]
    fn finds_the_nearest_on_random_planar_and_duplicated_means() {
        let mut rng = Rng::new(1, Purpose::Init, 0);
        let mut random: Vec<[f32; 3]> =
            (0..3000).map(|_| std::array::from_fn(|_| rng.range(-1.0, 1.0) as f32)).collect();
        let planar = random.iter().map(|m| [m[0], m[1], 0.25]).collect::<Vec<_>>();
        let duplicated = vec![[0.5f32; 3]; 500];
        random[7] = [1e6, 0.0, 0.0];
        for means in [random, planar, duplicated, vec![[0.0; 3]], vec![[0.0; 3], [1.0; 3]]] {
            let tree = f32::build(&means).unwrap();
            for _ in 0..200 {
                let q: [f32; 3] = std::array::from_fn(|_| rng.range(-1.2, 1.2) as f32);
                let mut ids = Vec::new();
                f32::nearest(&tree, &q, NonZero::new(4).unwrap(), &mut ids);
                let found: Vec<f32> = ids
                    .iter()
                    .map(|&id| (0..3).map(|i| (means[id as usize][i] - q[i]).powi(2)).sum())
                    .collect();
                let expected = brute_force(&means, q, 4);
                assert_eq!(found.len(), expected.len());
                for (a, b) in found.iter().zip(&expected) {
                    assert!((a - b).abs() <= 1e-5 * b.max(1e-6), "{found:?} {expected:?}");
                }
            }
        }
    }
}
