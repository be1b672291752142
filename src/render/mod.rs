//! Splats to pixels, on the CPU and on the GPU.

#[cfg(feature = "gui")]
pub mod gpu;
