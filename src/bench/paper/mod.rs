//! Benches of the published algorithm: its ablation, speed against error, cost against size,
//! stability on hard cases, and the search for its fastest arithmetic.

pub mod ablation;
pub mod oracle;
pub mod pareto;
pub mod precision_search;
mod runs;
pub mod sample;
pub mod scaling;
pub mod stability;
