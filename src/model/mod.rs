//! The mixture: distributions, hyper-parameters, statistics, posterior, and the resulting splats.
//!
//! Three models are separate (`model.md`, Three models). The *prior* never changes
//! ([`conjugate::prior::Hyper`]). The *initial model* is used in every E-step and changes only by
//! reassignment ([`paper::state::InitialModel`]). The *posterior* is the prior plus all statistics so
//! far; it is rendered and never feeds back ([`conjugate::posterior`]).
#![doc = include_str!("../../docs/design/model.md")]

pub mod attributes;
pub mod conjugate;
pub mod inspection;
pub mod paper;
pub mod scene;
pub mod splat;
