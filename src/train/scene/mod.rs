//! Engine of the scene preset (`scene.md`, Stages of a frame). A component is created at a point that
//! has no component within the structural scale. This point is its seed, about which additive
//! statistics are summed.
//!
//! The E-step is that of the `paper` preset with one candidate. The initial model of every component is
//! isotropic about its seed, with a common precision. So the nearest seed has the largest
//! responsibility.
#![doc = include_str!("../../../docs/design/scene.md")]

pub mod config;
pub mod fusion;
pub mod photometric;
mod textures;
pub mod track;
pub mod units;

mod accumulate;
mod align;
#[cfg(test)]
mod align_tests;
mod assign;
mod births;
mod component_sums;
mod components;
mod explain;
mod gain;
mod gauge;
mod grid;
pub mod merge;
mod observe;
mod point_fits;
mod rigid_equations;
mod seed_groups;
pub mod trainer;
#[cfg(test)]
mod wall_tests;
