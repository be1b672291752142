//! Mixture of the published algorithm: a fixed number of components, their initial model and totals.

pub mod merging;
pub mod mixture_device;
pub mod state;
mod total_scalar;
pub mod totals;
