//! The GPU renderers on a real Vulkan driver (software ones count) against f64 references.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used, clippy::print_stdout)]

mod common;
mod gpu {
    mod borders;
    mod compare;
    mod device;
    mod exactness;
    mod faults;
    mod golden;
    mod hostile;
    mod images;
    mod lego;
    mod options;
    mod streaming;
    mod targets;
}
