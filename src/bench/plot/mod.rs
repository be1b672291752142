//! Plots of benches.

pub mod axis;
pub mod draw;
mod labels;
