//! The tile path of the GPU renderer on a real Vulkan driver (software ones count).

pub mod device;
mod limits;
mod pictures;
pub mod scenes;
mod sorting;
