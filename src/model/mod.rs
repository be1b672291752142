//! The mixture itself: laws, hyper-parameters, statistics, posterior, and the splats it becomes.
//!
//! Three models are kept apart (`model.md`, Three models). The *prior* never changes
//! ([`prior::Hyper`]). The
//! *initial model* supplies every E-step and changes by reassignment only
//! ([`mixture::InitialModel`]). The *posterior* is the prior plus all statistics so far; it is what
//! is rendered and never feeds back ([`posterior`]).
#![doc = include_str!("model.md")]

pub mod appearance;
pub mod attributes;
pub mod dirichlet;
pub mod merging;
pub mod mixture;
pub mod niw;
pub mod posterior;
pub mod prior;
pub mod scene;
pub mod splats;
pub mod state;
pub mod statistics;
pub mod totals;
