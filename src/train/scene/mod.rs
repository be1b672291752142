//! Engine of the scene preset (`scene.md`, Stages of a frame): components are born at points without a
//! component within the structural scale, and hold additive statistics about a fixed seed.
//!
//! The E-step is the mixture's with one candidate: the initial model of every component is isotropic about
//! its seed with one common precision, so the largest responsibility belongs to the nearest seed.
#![doc = include_str!("scene.md")]

pub mod config;
pub mod engine;
pub mod learner;
pub mod memory;
pub mod partition;
pub mod photometric;
pub mod sum_form;
pub mod track;
pub mod trainer;
pub mod units;

mod accumulate;
mod align;
#[cfg(test)]
mod align_tests;
mod assign;
mod births;
mod coarsening;
mod component_sums;
mod components;
mod explain;
mod fusion;
mod gain;
mod gauge;
mod grid;
mod known_planes;
mod lattice;
mod merge;
#[cfg(test)]
mod merged_moments_tests;
mod near_seeds;
mod observe;
mod point_fits;
mod point_parts;
mod point_slots;
mod ray_search;
mod refine;
mod rigid_equations;
#[cfg(test)]
mod second_look_tests;
mod seed_groups;
mod seed_positions;
pub mod spacing;
mod sum_scalar;
#[cfg(test)]
mod wall_tests;
mod wide_sums;
