//! Loaders, unprojection and the synthetic scene against golden vectors, real recordings, ground
//! truth and damaged files.
#![allow(clippy::unwrap_used)]

mod bad_input;
mod cases_apps;
mod cases_camera;
mod cases_colmap;
mod cases_lists;
mod cases_mcap;
mod cases_poses;
#[path = "../common/mod.rs"]
mod common;
mod fuzz;
mod golden;
mod growing;
mod keys;
mod layout_bad_input;
mod layouts;
mod memory;
mod odd_ones;
mod phone;
mod pose_faults;
mod real;
mod rolling_shutter;
mod sequences;
mod surface;
mod synthetic;
