//! Tests of the application window without a display: every state, every button, CPU and GPU drawing.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used)]

mod abandoned;
mod background;
mod beside_training;
mod camera;
#[path = "../common/mod.rs"]
mod common;
mod compared;
mod contract;
mod crash;
mod detail;
mod device_loss;
mod dock;
mod drawn_by_cores;
mod editing;
mod export_preview;
mod files;
mod first_minute;
mod following;
mod fonts;
mod frames;
mod full_disk;
mod harness;
mod inspect;
#[cfg(feature = "cli")]
mod journey;
mod keyboard;
mod menus;
mod opening;
mod path;
mod poses;
mod quality;
mod random;
#[cfg(feature = "cli")]
mod real_window;
mod saving;
mod scene;
mod screenshots;
#[cfg(all(feature = "cli", unix))]
mod settings;
mod silent_drive;
mod states;
mod switching;
mod tools;
mod viewer;
mod waiting;
#[cfg(feature = "cli")]
mod window;

#[global_allocator]
static ALLOCATOR: common::live::Counted = common::live::Counted;
