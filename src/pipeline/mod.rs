//! The one training loop. The window and the command line both drive [`session::Session`]: frames
//! are decoded and unprojected ahead on their own thread, trained one by one, and reported.
#![doc = include_str!("pipeline.md")]

pub mod bench;
mod births;
pub mod calibrate;
pub mod checkpoint;
pub mod demo;
pub mod inspection;
pub mod learner;
pub mod machine;
pub mod memory;
pub mod method;
pub mod plan;
pub mod precision_search;
pub mod prefetch;
pub mod prepared;
pub mod run;
pub mod scene;
pub mod session;
