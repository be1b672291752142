//! What is searched, and how thoroughly.

use crate::bench::findings::BenchOptions;
use crate::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use crate::train::setting::ConfigError;
use crate::train::setting::table::SettingLayer;

/// What is searched, and how thoroughly.
#[derive(Clone, Debug)]
pub struct SearchPlan {
    /// Components of every combination, the paper's N.
    pub components: usize,
    /// Sampled frames at most.
    pub frames: usize,
    /// Runs of every combination.
    pub repeats: usize,
    /// Largest [`p99`](crate::bench::paper::oracle::PosteriorErrors::p99) that is accepted.
    pub bound: f64,
    /// What was asked for.
    pub options: BenchOptions,
}

impl SearchPlan {
    /// At the paper's N, or a fifth of it. The bound must be positive.
    pub fn new(options: BenchOptions, bound: f64) -> Result<Self, ConfigError> {
        if !(bound.is_finite() && bound > 0.0) {
            return Err(ConfigError {
                setting: "bound",
                expected: "a positive relative error, such as 1e-4".to_owned(),
                found: bound.to_string(),
            });
        }
        let (components, frames, repeats) =
            // More runs than elsewhere: verdicts compare quartiles, which few runs do not have.
            if options.quick { (20_000, 6, 9) } else { (100_000, 12, 15) };
        Ok(Self {
            components,
            frames: options.max_frames.unwrap_or(frames),
            repeats: options.repeats.unwrap_or(repeats),
            bound,
            options,
        })
    }

    /// The settings that every combination shares, with a change of its own; nothing is reassigned,
    /// so that all of them learn about the same means.
    pub fn config(&self, change: PaperOverrides) -> Result<PaperConfig, ConfigError> {
        let base = PaperOverrides {
            components: Some(self.components),
            seed: Some(self.options.seed),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        PaperConfig::paper().with(&change.or(base))
    }
}
