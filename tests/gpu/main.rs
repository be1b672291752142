//! The GPU renderers on a Vulkan driver (software drivers count) against f64 references.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod borders;
#[path = "../common/mod.rs"]
mod common;
mod compare;
mod composite;
mod device;
mod exactness;
mod faults;
mod fixture;
mod golden;
mod hostile;
mod images;
mod lego;
mod meshes;
mod mixture;
mod options;
mod photometric;
mod photometric_training;
mod points;
mod readback;
mod shaders;
mod streaming;
mod targets;
mod tiles;
