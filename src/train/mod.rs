//! The training engine: one frame in, updated statistics out. What both presets share lies here;
//! each has a folder of its own.

pub mod candidates;
pub mod estep;
pub mod outcome;
mod ownership;
pub mod paper;
pub mod scene;
pub mod setting;
pub mod timing;
