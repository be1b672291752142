//! One file a preset: what ties its settings to its preparation and its learner.

mod paper;
mod scene;
