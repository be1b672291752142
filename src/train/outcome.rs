//! Result of training on one frame.

use super::learner::{Changed, Learner};
use super::scene::track::TrackingLoss;
use super::timing::StageMs;
use crate::model::scene::state::TrackedPose;
use serde::{Deserialize, Serialize};

/// Result of training on one frame. Numbers that a preset does not compute are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Number of points trained on.
    pub points: usize,
    /// Number of pixels that the trained points represent: the total added to the components' counts.
    pub evidence: u64,
    /// Mean ELBO of the points under the initial model, nats; 0 if there are no points.
    pub elbo_mean: f64,
    /// Number of new components.
    pub new_components: usize,
    /// Number of unused components moved to badly explained points.
    pub reassigned: usize,
    /// Number of components merged into others.
    pub merged: usize,
    /// Result of pose tracking, if enabled.
    pub tracking: Option<FrameTracking>,
    /// Wall time by stage, milliseconds.
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

/// Result of comparing a photograph with the scene before training on it, or of detecting an outlier
/// frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparedPhotograph {
    /// Number of frames trained on before this frame.
    pub frame: u64,
    /// Result of comparing the frame with the scene.
    pub outcome: PhotographOutcome,
}

/// Result of comparing a frame with the scene before training on it: a score on unseen data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographOutcome {
    /// Difference between frame and scene. Usually the RMS difference between photograph and rendering
    /// over the channels of covered pixels, colour units. If the frame is an outlier by
    /// [`OutlierReason::Colors`], the RMS colour difference of its points. If it is an outlier by
    /// [`OutlierReason::Depth`], the share of the scene's surfaces behind which the frame measured
    /// another surface.
    pub difference: f64,
    /// Usual value of `difference`: its running mean (root mean square for colours) over earlier
    /// frames.
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
    /// The points differ in colour from the scene's surfaces; the frame is not trained on.
    Colors,
    /// The frame measured farther surfaces behind those of the scene; it is not trained on.
    Depth,
}

const UNBORN: u32 = u32::MAX;
/// Marks a component that was in use before this session began.
const UNKNOWN: u32 = u32::MAX - 1;

/// Log of the frame in which each component first received points. A component has not moved since that
/// frame, because only unused components are reassigned.
#[derive(Clone, Debug)]
pub struct BirthLog(Vec<u32>);

impl BirthLog {
    /// Creates the log at the start of a session. The birth of components already in use is unknown.
    pub fn new(learner: &dyn Learner) -> Self {
        let birth = |id| if learner.evidence(id) > 0.0 { UNKNOWN } else { UNBORN };
        Self((0..learner.status().components).map(birth).collect())
    }

    /// Records `position` as the birth frame of each component that the learner's last frame created. It
    /// is the index of that frame in the run.
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

    /// Returns the index, within the run, of the frame in which a component first received points.
    /// `None` if it is unused or was in use before this session.
    pub fn first_frame_of(&self, component: usize) -> Option<u32> {
        self.0.get(component).copied().filter(|&birth| birth < UNKNOWN)
    }
}

/// Bytes per pixel of a frame's decoded images and unprojection buffers.
pub(super) const PIXEL_BYTES: usize = 24;
pub(super) const PROGRAM_BYTES: u64 = 30_000_000;

/// Upper estimate of the bytes used by a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MemoryEstimate {
    /// Bytes proportional to the number of components.
    pub model: u64,
    /// Bytes of the program, and those proportional to the size of a frame.
    pub frames: u64,
    /// Bytes of textures.
    pub textures: u64,
}

impl MemoryEstimate {
    /// Returns the total number of bytes.
    pub fn total(&self) -> u64 {
        self.model.saturating_add(self.frames).saturating_add(self.textures)
    }
}

/// A warning about a trained model.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TrainingWarning {
    /// Points without a component were dropped because the budget of components was exhausted.
    #[error(
        "{points} points were dropped because the budget was exhausted; raise the budget (`--budget`), or increase the structural scale (`--scale`) if depth is noisy"
    )]
    OverBudget {
        /// Number of points dropped since training began.
        points: u64,
    },
    /// The structural scale was increased because merging components could not meet the budget.
    #[error(
        "the budget is too small for a structural scale of {requested}, which was increased to {scale}; raise the budget (`--budget`), or start with that structural scale (`--scale {scale}`), which is faster"
    )]
    Coarsened {
        /// Requested structural scale, world units.
        requested: f64,
        /// Current structural scale, world units.
        scale: f64,
    },
    /// Points were dropped because they are too many structural scales from the origin to distinguish
    /// neighbours.
    #[error(
        "{points} points lie more than a million structural scales from the scene's origin and were dropped; correct outlier poses (listed by `info`) or the depth unit, or increase the structural scale (`--scale`)"
    )]
    TooFarFromOrigin {
        /// Number of points dropped since training began.
        points: u64,
    },
    /// A splat's photometric precision was not positive definite and was reset.
    #[error(
        "photometric precisions of {splats} splats were not positive definite and were reset; these splats again follow from points alone. `--photometric off` disables training on photographs"
    )]
    PrecisionReset {
        /// Number of splats reset since training began or resumed.
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
