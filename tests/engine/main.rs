//! The engine: the model against golden vectors, its variants against each other, runs that stop and
//! resume, and the benches.
#![allow(clippy::unwrap_used)]

mod allocations;
mod attributes;
#[cfg(feature = "bench")]
mod benches;
mod budget;
mod candidates;
mod checkpoint;
#[path = "../common/mod.rs"]
mod common;
mod devices;
#[path = "../../fuzz/entries/mod.rs"]
mod entries;
mod fuzz;
mod inference;
mod kinect;
mod lego;
mod mishaps;
mod photometric;
mod point_devices;
mod properties;
mod published;
mod ray_search;
mod side;
#[cfg(feature = "bench")]
mod stability;
mod tracking;
mod variants;
