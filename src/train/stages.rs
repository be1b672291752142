//! What a frame's time is spent on, preset by preset. Each preset names its own stages, in the
//! order they run: reports, spreadsheets and the latency panel show these names and no others.

/// A stage of training one frame. Its time is wall time, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TrainStage {
    /// Name of its field in reports and its column in spreadsheets. Files keep it: older reports
    /// lose the times of one that is renamed.
    pub key: &'static str,
    /// Name on screen, in the latency panel.
    pub label: &'static str,
    /// What is done in it, for a tooltip.
    pub what: &'static str,
}

/// Stages of the published algorithm; numbers are positions in [`PAPER_STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PaperStage {
    /// Candidate search, before the fit and in it.
    Candidates,
    /// Scores and responsibilities, before the fit and in it.
    EStep,
    /// Sums per tile, which are not the model's yet.
    Stats,
    /// Addition of the frame's sums to the model's, the one step that changes totals.
    Update,
    /// Choosing and moving components, and rebuilding the index.
    Reassign,
}

/// Stages of the scene preset; numbers are positions in [`SCENE_STAGES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SceneStage {
    /// Correction of the frame's pose, where recorded poses are not taken for exact.
    Pose,
    /// Search of each point's component: the nearest seed within the structural scale.
    Assign,
    /// New components for points that found none, one after the other on one thread.
    Births,
    /// Evidence of the points, their refinement along the ray, and the frame's exposure.
    Refine,
    /// Sums per component.
    Stats,
    /// Projection of every component into the frame, which counts hits and misses.
    Visibility,
    /// The step that the photograph asks of the splats; nothing where they do not learn from it.
    Photometric,
    /// Merging down to the budget; in most frames nothing.
    Merge,
}

const fn stage(key: &'static str, label: &'static str, what: &'static str) -> TrainStage {
    TrainStage { key, label, what }
}

/// Stages of the published algorithm, by [`PaperStage`].
pub const PAPER_STAGES: [TrainStage; 5] = [
    stage("candidates", "Candidate search", "The nearest components of every point"),
    stage("e_step", "E-step", "Scores and responsibilities of the candidates"),
    stage("stats", "Statistics", "Responsibility-weighted sums, tile by tile"),
    stage("update", "Update", "Addition of the frame's sums to the model's"),
    stage("reassign", "Reassignment", "Unused components move to badly explained points"),
];

/// Stages of the scene preset, by [`SceneStage`].
pub const SCENE_STAGES: [TrainStage; 8] = [
    stage(
        "pose",
        "Pose correction",
        "The frame's pose is fitted to the scene's planes and colours",
    ),
    stage("assign", "Assignment", "The component of every point"),
    stage("births", "Births", "Components for points that no component is near"),
    stage(
        "refine",
        "Refinement and gain",
        "Points move along their rays to their component's plane; the frame's exposure is fitted",
    ),
    stage("stats", "Sums", "Sums of every component's points about its seed"),
    stage("visibility", "Visibility", "Which components the frame saw or saw through"),
    stage(
        "photometric",
        "Photometric step",
        "Splats take the step that the photograph asks for, held by what earlier ones taught them",
    ),
    stage("merge", "Merging", "Components are merged down to the budget"),
];

/// Stages of a frame at most, of any preset: times are kept in an array of so many.
pub const MAX_STAGES: usize = SCENE_STAGES.len();
const _: () = assert!(PAPER_STAGES.len() <= MAX_STAGES);
