//! The presets, one file each: settings with their preparation and learner.

mod paper;
mod scene;
