//! Why there is no index over the initial means.

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
