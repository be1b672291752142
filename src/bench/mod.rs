//! Benches measure speed, error and size. Each yields a table, JSON, CSV and a plot.
#![allow(missing_docs, reason = "no other crate uses this module")]

pub mod findings;
mod frames;
pub mod paper;
mod plot;
pub mod protocol;
pub mod render;
pub mod scene;
