//! Benches: speed against error, each as a table, JSON, CSV and a plot.
#![allow(missing_docs, reason = "no other crate uses this room")]

pub mod findings;
mod folder;
pub mod paper;
pub mod peers;
mod plot;
pub mod protocol;
pub mod render;
pub mod scene;
