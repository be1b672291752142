//! Training engine: updates statistics from one frame at a time. Shared parts are here; each preset
//! has its own folder.
#![doc = include_str!("../../docs/design/training.md")]

pub mod candidates;
pub mod component_elbo;
pub mod device_trial;
pub mod estep;
pub mod learner;
pub mod outcome;
pub mod paper;
pub mod scene;
pub mod setting;
pub mod timing;
