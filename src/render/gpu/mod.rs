//! Splats to pixels on a GPU (`rendering.md`, GPU renderer): the only place that speaks wgpu.
//!
//! The window owns device and queue and hands them over. In the order of one frame:
//!
//! 1. [`scene::GpuScene::update`] uploads what the trainer changed, [`scene::GpuScene::set_order`]
//!    the order that [`sort::back_to_front`] found on another thread;
//! 2. [`renderer::SplatRenderer::render`] draws the splats into an offscreen
//!    [`target::SplatTarget`], as quads in that order or by [`tiles`], whichever is faster;
//! 3. [`composite::Compositor`] lays that over a background inside the window's own pass, beside
//!    another image or a photograph if two are compared.
//!
//! Where the adapter computes on the cores, [`meshes::MeshPainter`] draws the window itself.
//! [`photometric`], [`mixture`] and [`points`] do a learner's work on a device of their own.
//!
//! Nothing here survives a lost device and nothing has to: [`faults::GpuFaults`] reports the loss,
//! and everything is rebuilt from the splats on the CPU with `new`.

pub mod adapters;
mod allocation;
mod answer;
mod chooser;
pub mod composite;
pub mod constants;
pub mod context;
mod draw_pipeline;
mod error;
pub mod faults;
mod growing;
pub mod headless;
mod kernel;
pub mod layout;
pub mod meshes;
pub mod mixture;
mod parallel_copy;
mod path;
pub mod photo;
pub mod photometric;
pub mod points;
mod poll;
mod quads;
pub mod readback;
pub mod renderer;
mod ring;
mod scatter;
pub mod scene;
pub mod sort;
pub mod target;
pub mod tiles;
mod timer;

pub use error::GpuError;
pub use path::{DrawPath, GpuTimes};
