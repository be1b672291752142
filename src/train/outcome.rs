//! Result of training on one frame.

use super::learner::{Changed, Learner};
use super::scene::track::TrackingLoss;
use super::timing::StageMs;
use crate::model::scene::state::TrackedPose;
use serde::{Deserialize, Serialize};

/// Result of training on one frame. Fields that a preset does not use are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Number of points trained on.
    pub points: usize,
    /// Pixels represented by these points: total added to the components' counts.
    pub evidence: u64,
    /// Mean ELBO of the points under the initial model, nats; 0 without points.
    pub elbo_mean: f64,
    /// Number of new components.
    pub new_components: usize,
    /// Number of unused components moved to badly explained points.
    pub reassigned: usize,
    /// Number of components merged into others.
    pub merged: usize,
    /// Result of pose tracking, if enabled.
    pub tracking: Option<FrameTracking>,
    /// Milliseconds by stage.
    pub ms: StageMs,
}

/// Tracking result of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameTracking {
    /// The pose was found. The frame is trained on unless it is an outlier.
    Placed(TrackedPose),
    /// The pose was not found; the frame is not trained on.
    Lost(TrackingLoss),
}

/// A photograph compared with the scene before training on it, or an outlier frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparedPhotograph {
    /// Number of frames trained on before this one.
    pub frame: u64,
    /// Result of the comparison.
    pub outcome: PhotographOutcome,
}

/// Comparison of a frame with the scene before training on it: a score on unseen data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographOutcome {
    /// RMS difference from the rendering over the channels of covered pixels, colour units. For a frame
    /// rejected by its points: RMS difference of their colours, or share of surfaces measured through.
    pub difference: f64,
    /// Running average of `difference` over earlier frames.
    pub usual: f64,
    /// Kind of outlier; `None` for an inlier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradiction: Option<OutlierReason>,
}

/// Reason why a frame is an outlier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutlierReason {
    /// The photograph differs from the rendering; its pixels are not trained on.
    Picture,
    /// The points differ in colour from their surfaces; the frame is not trained on.
    Colors,
    /// The frame saw through surfaces; it is not trained on.
    Depth,
}

const UNBORN: u32 = u32::MAX;
/// In use before this session began.
const UNKNOWN: u32 = u32::MAX - 1;

/// Frame in which each component first received points. Reassignment moves only unused components,
/// so a component's age is the age at its present place.
#[derive(Clone, Debug)]
pub struct BirthLog(Vec<u32>);

impl BirthLog {
    /// Creates the log at the start of a session; components already in use have no known birth.
    pub fn new(learner: &dyn Learner) -> Self {
        let birth = |id| if learner.evidence(id) > 0.0 { UNKNOWN } else { UNBORN };
        Self((0..learner.status().components).map(birth).collect())
    }

    /// Records the components changed by the learner's last frame, which is at `position` of the run.
    pub fn record(&mut self, learner: &dyn Learner, position: usize) {
        let n_components = learner.status().components.max(self.0.len());
        self.0.resize(n_components, UNBORN);
        let mut note = |id: usize| {
            let birth = &mut self.0[id];
            if learner.evidence(id) == 0.0 {
                // Merging frees rows, which later components reuse.
                *birth = UNBORN;
            } else if *birth == UNBORN {
                *birth = position as u32;
            }
        };
        match learner.last_frame().changed {
            Changed::Listed(ids) => ids.iter().for_each(|&id| note(id as usize)),
            Changed::All => (0..n_components).for_each(note),
        }
    }

    /// Returns the position of a component's first frame; `None` if unused or born before this session.
    pub fn first_frame_of(&self, component: usize) -> Option<u32> {
        self.0.get(component).copied().filter(|&birth| birth < UNKNOWN)
    }
}

/// Decoded images of a frame and unprojection buffers, per pixel.
pub(super) const PIXEL_BYTES: usize = 24;
pub(super) const PROGRAM_BYTES: u64 = 30_000_000;

/// Upper estimate of the bytes used by a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Proportional to the number of components.
    pub model: u64,
    /// Remaining bytes, proportional to the size of a frame.
    pub frames: u64,
}

impl MemoryEstimate {
    /// Total bytes.
    pub fn total(&self) -> u64 {
        self.model.saturating_add(self.frames)
    }
}

/// A warning about a trained model.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TrainingWarning {
    /// Points without a component were dropped because the budget was exhausted.
    #[error(
        "{points} points were dropped because the budget was exhausted; raise the budget (`--budget`), or increase the structural scale (`--scale`) if depth is noisy"
    )]
    OverBudget {
        /// Number of points since training began.
        points: u64,
    },
    /// The structural scale grew because merging could not meet the budget.
    #[error(
        "the budget is too small for a structural scale of {requested}, which was increased to {scale}; raise the budget (`--budget`), or start with that structural scale (`--scale {scale}`), which is faster"
    )]
    Coarsened {
        /// Requested structural scale, world units.
        requested: f64,
        /// Current structural scale, world units.
        scale: f64,
    },
    /// Points were dropped: too many structural scales from the origin to distinguish neighbours.
    #[error(
        "{points} points lie more than a million structural scales from the scene's origin and were dropped; correct outlier poses (listed by `info`) or the depth unit, or increase the structural scale (`--scale`)"
    )]
    TooFarFromOrigin {
        /// Number of points since training began.
        points: u64,
    },
    /// A splat's photometric precision was not positive definite and was reset.
    #[error(
        "photometric precisions of {splats} splats were not positive definite and were reset; these splats again follow from points alone. `--photometric off` disables training on photographs"
    )]
    PrecisionReset {
        /// Number of resets since training began or resumed.
        splats: u64,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_name_settings_with_their_options() {
        let text = TrainingWarning::OverBudget { points: 3 }.to_string();
        assert!(text.starts_with("3 points") && text.contains("budget (`--budget`)"), "{text}");
        let text = TrainingWarning::Coarsened { requested: 0.01, scale: 0.0141421 }.to_string();
        assert!(text.contains("scale of 0.01,") && text.contains("`--scale 0.0141421`"), "{text}");
        let text = TrainingWarning::TooFarFromOrigin { points: 4 }.to_string();
        assert!(text.contains("listed by `info`") && text.contains("(`--scale`)"), "{text}");
    }
}
