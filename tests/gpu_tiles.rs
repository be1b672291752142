//! The tile path of the GPU renderer on a real Vulkan driver (software ones count).
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod common;
mod gpu_tiles {
    pub mod device;
    mod limits;
    mod pictures;
    pub mod scenes;
    mod sorting;
}
