//! The tile path of the GPU renderer on a Vulkan driver (software drivers count).

mod limits;
mod pictures;
pub mod scenes;
mod sorting;
