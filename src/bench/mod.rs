//! Benches: speed against error, each as a table, JSON, CSV and a plot.

pub mod findings;
mod folder;
pub mod paper;
pub mod peers;
mod plot;
pub mod protocol;
pub mod render;
pub mod scene;
