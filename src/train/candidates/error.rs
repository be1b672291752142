//! Error of building the candidate index.

/// The candidate index could not be built.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "building the candidate index over {components} components failed: {reason}; try fewer components"
)]
pub struct IndexError {
    /// Number of means.
    pub components: usize,
    /// Message of the index library.
    pub reason: String,
}
