//! Loaders, unprojection and the synthetic scene against golden vectors, real recordings, known
//! truth and damaged files.
#![allow(clippy::unwrap_used)]

mod common;

#[path = "datasets/bad_input.rs"]
mod bad_input;
#[path = "datasets/fuzz.rs"]
mod fuzz;
#[path = "datasets/golden.rs"]
mod golden;
#[path = "datasets/layouts.rs"]
mod layouts;
#[path = "datasets/memory.rs"]
mod memory;
#[path = "datasets/real.rs"]
mod real;
#[path = "datasets/synthetic.rs"]
mod synthetic;
