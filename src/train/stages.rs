//! Stages of training a frame, by preset, in the order they run. Reports, spreadsheets and the latency
//! panel use these names.

/// A stage of training one frame, measured in milliseconds of wall time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainStage {
    /// Field name in reports and column name in spreadsheets. Renaming it loses the times in older reports.
    pub key: &'static str,
    /// Label in the latency panel.
    pub label: &'static str,
    /// Tooltip.
    pub tooltip: &'static str,
}

/// Stages of the `paper` preset; values are indices into [`PAPER_STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperStage {
    /// Candidate search, for scoring and for the fit.
    Candidates,
    /// Scores and responsibilities, for scoring and for the fit.
    EStep,
    /// Sums per tile, not yet added to the model.
    Stats,
    /// Adds the frame's sums to the model's totals; the only stage that changes them.
    Update,
    /// Selects and moves components, and rebuilds the index.
    Reassign,
}

/// Stages of the `scene` preset; values are indices into [`SCENE_STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStage {
    /// Correction of the frame's pose, unless recorded poses are treated as exact.
    Pose,
    /// Assignment of each point to the nearest seed within the structural scale.
    Assign,
    /// New components for unassigned points, sequentially on one thread.
    Births,
    /// Evidence of the points, refinement along their rays, and the frame's exposure.
    Refine,
    /// Sufficient statistics per component.
    Stats,
    /// Projection of every component into the frame, counting hits and misses.
    Visibility,
    /// Gauss-Newton step on the splats from the photograph, if enabled.
    Photometric,
    /// Merging down to the budget; rarely needed.
    Merge,
}

const fn stage(key: &'static str, label: &'static str, what: &'static str) -> TrainStage {
    TrainStage { key, label, tooltip: what }
}

/// Stages of the `paper` preset, indexed by [`PaperStage`].
pub const PAPER_STAGES: [TrainStage; 5] = [
    stage("candidates", "Candidate search", "Finds the nearest components of every point"),
    stage("e_step", "E-step", "Computes scores and responsibilities of the candidates"),
    stage("stats", "Statistics", "Computes responsibility-weighted sums, tile by tile"),
    stage("update", "Update", "Adds the frame's sums to the model's"),
    stage("reassign", "Reassignment", "Moves unused components to badly explained points"),
];

/// Stages of the `scene` preset, indexed by [`SceneStage`].
pub const SCENE_STAGES: [TrainStage; 8] = [
    stage("pose", "Pose correction", "Fits the frame's pose to the scene's planes and colours"),
    stage("assign", "Assignment", "Finds the component of every point"),
    stage("births", "Births", "Creates components for points without one nearby"),
    stage(
        "refine",
        "Refinement and gain",
        "Moves points along their rays to their component's plane and fits the frame's exposure",
    ),
    stage("stats", "Sums", "Sums every component's points about its seed"),
    stage("visibility", "Visibility", "Counts components that the frame saw or saw through"),
    stage(
        "photometric",
        "Photometric step",
        "Applies a Gauss-Newton step from the photograph, weighted by earlier photographs",
    ),
    stage("merge", "Merging", "Merges components down to the budget"),
];

/// Maximum number of stages in any preset; size of timing arrays.
pub const MAX_STAGES: usize = SCENE_STAGES.len();
const _: () = assert!(PAPER_STAGES.len() <= MAX_STAGES);
