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
//! Nothing here survives a lost device and nothing has to: [`faults::GpuFaults`] reports the loss,
//! and everything is rebuilt from the splats on the CPU with `new`.

pub mod adapters;
mod allocation;
mod chooser;
pub mod composite;
pub mod constants;
pub mod context;
pub mod faults;
pub mod headless;
pub mod layout;
pub mod photo;
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

/// Why the GPU could not do what was asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// The adapter cannot run the shaders at all.
    #[error(
        "{adapter}: expected {missing}, which this adapter does not offer; the CPU renderer draws instead"
    )]
    Unsupported {
        /// Name of the adapter.
        adapter: String,
        /// What it lacks.
        missing: &'static str,
    },
    /// More splats than one buffer of this adapter holds.
    #[error(
        "{n_splats} splats need {needed_mib} MiB, this adapter binds at most {limit_mib} MiB: keep to {max_splats} splats or draw with the CPU renderer"
    )]
    TooManySplats {
        /// Asked for.
        n_splats: usize,
        /// Their size.
        needed_mib: u64,
        /// Largest buffer.
        limit_mib: u64,
        /// What fits in it.
        max_splats: usize,
    },
    /// The driver refused an allocation that is within its limits.
    #[error(
        "{n_splats} splats: the GPU is out of memory ({mib} MiB asked for); the splats uploaded before are still drawn, close other GPU programs or train fewer components"
    )]
    OutOfMemory {
        /// Asked for.
        n_splats: usize,
        /// Their size.
        mib: u64,
    },
    /// An image needs more pairs of splat and tile than the GPU has room for.
    #[error(
        "{needed} pairs of splat and tile, this GPU has room for {capacity}: the farthest splats are left out; make the window smaller or come no closer"
    )]
    TooManyEntries {
        /// Pairs of splat and tile in the image.
        needed: u64,
        /// Of these are drawn.
        capacity: u64,
    },
    /// A setting for comparisons that the shaders do not have.
    #[error(
        "{found}: the GPU follows rays, up to where alpha ends; draw with the CPU renderer, which has this too"
    )]
    CpuOnly {
        /// What was asked for.
        found: &'static str,
    },
    /// An order names a splat that is not there: it belongs to another scene.
    #[error(
        "draw order names splat {index}, the scene holds {n_splats}: sort the current splats again"
    )]
    StaleOrder {
        /// Largest index in the order.
        index: u32,
        /// Splats in the scene.
        n_splats: usize,
    },
    /// The viewport is larger than a texture may be.
    #[error(
        "viewport {width}x{height}: this adapter draws at most {limit} pixels a side; make the window smaller"
    )]
    ViewportTooLarge {
        /// Columns asked for.
        width: u32,
        /// Rows asked for.
        height: u32,
        /// Largest side.
        limit: u32,
    },
    /// The photograph is larger than a texture may be.
    #[error(
        "photograph {width}x{height}: this adapter shows at most {limit} pixels a side; compare with smaller images"
    )]
    PhotoTooLarge {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// Largest side.
        limit: u32,
    },
    /// An image did not come back from the GPU.
    #[error("image of {width}x{height} did not come back from the GPU: {reason}")]
    Readback {
        /// Columns.
        width: u32,
        /// Rows.
        height: u32,
        /// What wgpu said.
        reason: String,
    },
}
