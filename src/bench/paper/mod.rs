//! Benches of the published algorithm: ablation, speed against error, scaling, and the search for the
//! fastest precision.

pub mod ablation;
pub mod oracle;
pub mod pareto;
pub mod precision_search;
mod runs;
pub mod sample;
pub mod scaling;
