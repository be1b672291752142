//! The command line through the real binary, in a temporary folder.
#![cfg(all(feature = "cli", feature = "bench"))]
#![allow(clippy::unwrap_used)]

mod align_poses;
mod bad_input;
mod bench;
mod bounded;
mod calibrate;
mod capture;
mod checkpoint;
mod commands;
#[path = "../common/mod.rs"]
mod common;
mod determinism;
mod devices;
mod distributed;
mod eval_scale;
mod failing_disk;
mod follow;
mod headless;
mod hostile;
mod images;
#[cfg(unix)]
mod interrupt;
mod kept;
mod killed;
mod lost;
mod models;

mod real;
mod reference;
mod register;
mod report;
mod runner;
mod scenes;
mod sector;
mod settings;
mod side;
mod usage;
mod versions;
mod world;
