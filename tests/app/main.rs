//! The real window, driven without a display: every state, every button, both painters.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used)]

mod camera;
#[path = "../common/mod.rs"]
mod common;
mod files;
mod harness;
mod inspect;
mod opening;
mod scene;
mod states;
mod viewer;
mod window;
