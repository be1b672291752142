//! Training engine: updates statistics from one frame at a time. Shared parts are here; each preset
//! has its own folder.
#![doc = include_str!("train.md")]

pub mod birth_log;
pub mod candidates;
pub mod comparer_use;
pub mod component_elbo;
pub mod device_trial;
pub mod estep;
pub mod learner;
pub mod memory;
pub mod outcome;
pub mod paper;
pub mod pass_use;
pub mod scene;
pub mod setting;
pub mod stages;
pub mod timing;
pub mod warnings;
