//! GPU renderer (`rendering.md`, GPU renderer): the only module that calls wgpu.
//!
//! The window owns device and queue and passes them in. Order of one frame:
//!
//! 1. [`scene::GpuScene::update`] uploads the splats changed by training.
//! 2. [`renderer::SplatRenderer::render`] sorts and draws the splats into an offscreen
//!    [`renderer::SplatTarget`] by [`tiles`].
//! 3. [`composite::Compositor`] composites the image over a background inside the window's own pass,
//!    optionally combined with another image or a photograph.
//!
//! On software adapters, [`meshes::MeshPainter`] draws the window itself.
//! [`photometric`], [`mixture`] and [`points`] run parts of training on a separate device.
//!
//! Resources do not survive a lost device. [`error::GpuFaults`] reports the loss, and `new` rebuilds
//! everything from the splats on the CPU.

pub mod adapters;
pub mod composite;
pub mod constants;
pub mod error;
mod growing;
pub mod headless;
pub mod layout;
pub mod meshes;
pub mod mixture;
pub mod photometric;
mod pipeline;
pub mod points;
pub mod renderer;
pub mod scene;
mod task;
mod textures;
pub mod tiles;
mod timer;

pub use error::GpuError;
pub use timer::GpuTimes;
