//! Training session: a dataset, its settings and a model trained frame by frame; and the demo, a session on
//! the built-in synthetic room.

use super::error::SessionError;
use super::follow::{Follow, ScanFindings};
use super::frame_loop::{FrameLoop, FrameStatus, InitialState, SteppedFrame, frame_loop};
use super::plan::{Plan, Selection};
use super::prefetch::{FrameWatcher, Next, PlannedFrame};
use super::run::{RunConfig, RunProgress};
use super::settings::method::MethodRequest;
use crate::dataset::synthetic::ParamsError;
use crate::dataset::{Dataset, FrameMarks, range, synthetic};
use crate::eval::report::{FrameMs, FrameReport, QualityCurves, SkippedFrame};
use crate::export::registration::Registration;
use crate::math::measured_pixel::Normalization;
use crate::model::inspection::DeviceError;
use crate::model::splat::appearance::SplatSet;
use crate::train::device_trial::DevicePolicy;
use crate::train::learner::{Learner, Status, TrainingDevice};
use crate::train::outcome::{BirthLog, FrameOutcome, FrameTracking, MemoryEstimate};
use glam::DVec3;
use std::sync::Arc;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Result of a training step.
#[derive(Clone, Debug)]
pub enum Step {
    /// A frame was trained on.
    Trained(Box<FrameReport>),
    /// A frame could not be read or prepared, and was skipped.
    Skipped(SkippedFrame),
    /// The pose of a frame was not found, so the frame was skipped.
    Lost(SkippedFrame),
    /// All complete frames of a followed recording were visited. Further frames may follow after
    /// [`Follow::time_to_next_scan`].
    Waiting,
    /// There are no more frames.
    Finished,
}

/// A dataset, its settings and a model trained frame by frame.
///
/// ```
/// use std::sync::Arc;
/// use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
/// use vbgs_studio::pipeline::plan::Selection;
/// use vbgs_studio::pipeline::settings::scene::SceneOverrides;
/// use vbgs_studio::pipeline::session::{Session, Step};
///
/// let small = SyntheticParams { width: 32, height: 24, n_train: 6, n_eval: 1, ..SyntheticParams::demo() };
/// let room = synthetic::dataset(&small)?;
/// let selection = Selection { max_frames: Some(2), ..Selection::all_frames() };
/// let mut session = Session::new(Arc::new(room), SceneOverrides::default(), selection)?;
/// while !matches!(session.step()?, Step::Finished) {}
/// assert_eq!((session.frames().len(), session.skipped().len()), (2, 0));
/// assert!(session.splats().iter().any(|splat| splat.is_drawable()));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Session {
    dataset: Arc<Dataset>,
    config: RunConfig,
    plan: Plan,
    normalization: Normalization,
    frames: Box<dyn FrameLoop>,
    follow: Option<Follow>,
    /// True if the recording is or was followed.
    is_followed: bool,
    births: BirthLog,
    past: RunProgress,
    /// Warnings about outlier frames that [`Self::take_outlier_warnings`] has not returned yet.
    outlier_warnings: Vec<String>,
    started: Instant,
    /// Training time before `started`, in seconds.
    wall_before_s: f64,
}

impl Session {
    /// Prepares a session and starts decoding. Frames rejected when the dataset was opened count as
    /// skipped.
    pub fn new(
        dataset: Arc<Dataset>,
        asked: impl Into<MethodRequest>,
        selection: Selection,
    ) -> Result<Self, SessionError> {
        let asked = asked.into();
        let seed = asked.seed();
        let plan = Plan::new(&dataset, &selection, seed)?;
        // First, because a scene reports problems with depth best.
        let method = asked.fit_to_dataset(&dataset, &selection, plan.pixels(&dataset))?;
        let range = range::estimate(&dataset, plan.split)?;
        let config = RunConfig::new(&dataset, method, selection, &range);
        let past = RunProgress::at_start(&dataset, plan.split);
        Self::begin(dataset, config, plan, &InitialState::Fresh(&range), past)
    }

    /// Starts a session that continues after the frames already visited in `past`.
    pub(super) fn begin(
        dataset: Arc<Dataset>,
        config: RunConfig,
        plan: Plan,
        origin: &InitialState,
        past: RunProgress,
    ) -> Result<Self, SessionError> {
        let (frames, normalization) = frame_loop(&dataset, &config, &plan, past.visited, origin)?;
        let passes = config.selection.passes;
        // Points count once, so further passes only have an effect on photographs.
        if passes > 1 && frames.learner().device_use().photographs.is_none() {
            return Err(SessionError::Passes(passes));
        }
        let (started, wall_before_s) = (Instant::now(), past.wall_s);
        Ok(Self {
            dataset,
            config,
            plan,
            normalization,
            births: BirthLog::new(frames.learner()),
            frames,
            follow: None,
            is_followed: false,
            past,
            outlier_warnings: Vec::new(),
            started,
            wall_before_s,
        })
    }

    /// Follows a recording while it grows. `follow` is the [`Follow`] that found the present frames, or
    /// `None` if the dataset was opened normally. Returns false if there is nothing to follow.
    pub fn follow(&mut self, follow: Option<Follow>) -> bool {
        let split = self.plan.split;
        let follow = follow.or_else(|| Follow::of(&self.dataset, split, &self.config.selection));
        self.follow = follow.map(Follow::without_dataset);
        self.is_followed |= self.follow.is_some();
        self.config.selection.follow |= self.is_followed;
        if self.follow.is_some() && self.config.selection.split.is_none() {
            let name = self.dataset.splits.get(split).map(|split| split.name.clone());
            self.config.selection.followed_split = name;
        }
        self.follow.is_some()
    }

    /// Stops following the recording; only frames found so far are used.
    pub fn stop_following(&mut self) {
        self.follow = None;
    }

    /// Recording that is followed, if any.
    pub fn followed(&self) -> Option<&Follow> {
        self.follow.as_ref()
    }

    /// True if all frames found so far were visited. A followed recording may get further frames.
    pub fn is_caught_up(&self) -> bool {
        self.past.visited >= self.plan.frames.len()
    }

    /// Polls a followed recording for new frames if all known frames were visited. Returns false if the
    /// next step has to wait for further frames.
    fn poll_new_frames(&mut self) -> Result<bool, SessionError> {
        let n_planned = self.plan.frames.len();
        if !self.is_caught_up() {
            return Ok(true);
        }
        let Some(follow) = &mut self.follow else { return Ok(true) };
        // The limit is reached, so further frames would be ignored.
        if self.config.selection.max_frames.is_some_and(|most| most <= n_planned) {
            self.follow = None;
            return Ok(true);
        }
        let (found, is_end) = match follow.poll()? {
            ScanFindings::Nothing => return Ok(false),
            ScanFindings::Frames(found) => (Some(found), false),
            ScanFindings::End(found) => (found, true),
        };
        if is_end {
            self.follow = None;
        }
        if let Some(found) = found {
            self.grow(found);
        }
        Ok(is_end || !self.is_caught_up())
    }

    fn grow(&mut self, found: Dataset) {
        let (split, n_planned) = (self.plan.split, self.plan.frames.len());
        let name = &self.dataset.splits[split].name;
        let refused = found.warnings.iter().filter(|warning| warning.split == *name);
        self.past.skipped.extend(refused.map(|warning| SkippedFrame::from(&*warning.error)));
        // Copies the dataset only while something else, such as a window, still holds it.
        let dataset = Arc::make_mut(&mut self.dataset);
        let known = dataset.splits[split].frames.len();
        dataset.append_polled(split, found);
        let n_frames = dataset.splits[split].frames.len();
        self.plan.extend(&self.config.selection, known, n_frames);
        self.frames.append(&mut PlannedFrame::of(&self.dataset, &self.plan, n_planned));
    }

    /// Calls `watcher` with every frame that is decoded from now on, on a decoding thread. Only the first
    /// watcher counts.
    pub fn watch_frames(&self, watcher: FrameWatcher) {
        self.frames.watch(watcher);
    }

    /// Trains on the next frame, after waiting for it to be decoded.
    ///
    /// # Errors
    /// [`SessionError::Index`] as in [`Learns::learn`](crate::train::learner::Learns::learn), or
    /// [`SessionError::NoUsableFrame`] if every frame was skipped.
    pub fn step(&mut self) -> Result<Step, SessionError> {
        self.step_within(Duration::MAX).map(|step| step.unwrap_or(Step::Waiting))
    }

    /// Trains as [`Self::step`] does, but waits at most `patience`. `None` if the frame is not decoded
    /// yet, so that a slow drive does not block saving.
    pub fn step_within(&mut self, patience: Duration) -> Result<Option<Step>, SessionError> {
        if !self.poll_new_frames()? {
            return Ok(Some(Step::Waiting));
        }
        let SteppedFrame { position, name, marks, status } = match self.frames.step(patience) {
            Next::Ready(frame) => frame,
            Next::Unread => return Ok(None),
            Next::End => return self.finish().map(Some),
        };
        // Set before the result is handled: no resumed run may train on this frame twice.
        self.past.visited = position + 1;
        let step = match status {
            FrameStatus::Learned { outcome, dropped, load_ms, prepare_ms } => {
                let ms = FrameMs { load: load_ms, prepare: prepare_ms, stages: outcome.ms };
                Step::Trained(Box::new(
                    self.record_trained(position, name, &marks, &outcome, dropped, ms),
                ))
            }
            FrameStatus::Skipped(message) => {
                // The recorder may still be writing the frame's files.
                if let Some(follow) = &mut self.follow {
                    follow.give_back(name.clone(), marks);
                }
                self.forget_skipped(&name);
                Step::Skipped(self.skipped_frame(name, message))
            }
            FrameStatus::Lost(loss) => {
                let message = format!("{name}: pose not found, frame skipped: {loss}");
                Step::Lost(self.skipped_frame(name, message))
            }
            FrameStatus::Failed(error) => return Err(error.into()),
        };
        self.update_wall_time();
        Ok(Some(step))
    }

    fn update_wall_time(&mut self) {
        self.past.wall_s = self.wall_before_s + self.started.elapsed().as_secs_f64();
    }

    fn skipped_frame(&mut self, frame: String, message: String) -> SkippedFrame {
        let skipped = SkippedFrame { frame, message };
        self.past.skipped.push(skipped.clone());
        skipped
    }

    fn finish(&mut self) -> Result<Step, SessionError> {
        if self.learner().status().frames > 0 {
            // The final scene includes photographs that are still buffered.
            self.settle();
            return Ok(Step::Finished);
        }
        Err(SessionError::NoUsableFrame {
            dataset: self.dataset.name.clone(),
            skipped: self.past.skipped.len(),
            first: self
                .past
                .skipped
                .first()
                .map_or_else(|| "no frame is selected".into(), |s| s.message.clone()),
        })
    }

    fn record_trained(
        &mut self,
        position: usize,
        frame: String,
        marks: &FrameMarks,
        outcome: &FrameOutcome,
        points_dropped: usize,
        ms: FrameMs,
    ) -> FrameReport {
        // Files of other recordings may be years old.
        let behind_ms = self.is_followed.then(|| latency_ms(marks)).flatten();
        self.forget_skipped(&frame);
        let learner = self.frames.learner();
        let Status { components, used, .. } = learner.status();
        self.births.record(learner, position);
        let report = FrameReport {
            index: position,
            frame,
            points: outcome.points,
            points_dropped,
            components,
            used,
            born: outcome.new_components,
            reassigned: outcome.reassigned,
            merged: outcome.merged,
            elbo_mean: outcome.elbo_mean,
            photograph: None,
            tracked: match outcome.tracking {
                Some(FrameTracking::Placed(pose)) => Some(pose),
                _ => None,
            },
            behind_ms,
            ms,
        };
        self.past.points += outcome.evidence;
        self.past.frames.push(report.clone());
        self.record_comparisons();
        // `record_comparisons` may have added the photograph to the stored report.
        self.past.frames.last().cloned().unwrap_or(report)
    }

    fn record_comparisons(&mut self) {
        let learner = self.frames.learner();
        let n_learned = learner.status().frames;
        for compared in learner.last_frame().compared_photographs {
            self.outlier_warnings.extend(self.past.record_comparison(n_learned, compared));
        }
    }

    /// Returns the warnings about outlier frames that were not returned before.
    pub fn take_outlier_warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.outlier_warnings)
    }

    /// True if the rendered scene already includes all buffered photographs, so that [`Self::settle`]
    /// would not change it.
    pub fn is_settled(&self) -> bool {
        self.learner().status().is_settled
    }

    /// Makes the scene render as if all buffered photographs had been trained on, until the next frame.
    /// Returns true if that changes anything.
    pub fn settle(&mut self) -> bool {
        let changes = self.learner_mut().settle();
        if changes {
            self.record_comparisons();
            self.update_wall_time();
        }
        changes
    }

    fn forget_skipped(&mut self, frame: &str) {
        // A followed recording may return a frame that was incomplete before.
        if self.is_followed {
            self.past.skipped.retain(|skipped| skipped.frame != frame);
        }
    }

    /// Dataset of the session.
    pub fn dataset(&self) -> &Arc<Dataset> {
        &self.dataset
    }

    /// Plan of the frames.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Settings of the run.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// Learner with its model.
    pub fn learner(&self) -> &dyn Learner {
        self.frames.learner()
    }

    pub(super) fn learner_mut(&mut self) -> &mut dyn Learner {
        self.frames.learner_mut()
    }

    /// Starts to accumulate the ELBO (evidence lower bound) of each component, for
    /// [`Self::attributes_of`].
    pub fn start_component_elbo(&mut self) {
        self.learner_mut().component_elbo_mut().start();
    }

    /// Stops accumulating the ELBO of each component (see [`Self::start_component_elbo`]).
    pub fn stop_component_elbo(&mut self) {
        self.learner_mut().component_elbo_mut().stop();
    }

    /// Returns the plan position of the frame in which a component first received points. `None` if that
    /// was before this session.
    pub(super) fn birth_of(&self, component: usize) -> Option<u32> {
        self.births.first_frame_of(component)
    }

    /// Number of pixels represented by the points trained on.
    pub fn points(&self) -> u64 {
        self.past.points
    }

    /// Transformation from world to model coordinates.
    pub fn normalization(&self) -> &Normalization {
        &self.normalization
    }

    pub(super) fn past(&self) -> &RunProgress {
        &self.past
    }

    /// Upper bound on the memory of the run, in bytes.
    pub fn memory(&self) -> MemoryEstimate {
        self.config.method.as_any().memory(self.plan.pixels(&self.dataset))
    }

    /// Number of visited plan positions, trained on or skipped.
    pub fn visited(&self) -> usize {
        self.past.visited
    }

    /// Up direction in the world, estimated from the cameras if necessary.
    pub fn up(&self) -> DVec3 {
        self.dataset.up(self.plan.split)
    }

    /// Registration of the world, which exports apply.
    pub fn registration(&self) -> Option<&Registration> {
        self.past.registration.as_ref()
    }

    /// Sets the registration of the world, which checkpoints hold.
    pub fn register(&mut self, registration: Option<Registration>) {
        self.past.registration = registration;
    }

    /// Reports of the trained frames, in order.
    pub fn frames(&self) -> &[FrameReport] {
        &self.past.frames
    }

    /// Quality measured during the run, by this session or before.
    pub fn curves(&self) -> &QualityCurves {
        &self.past.curves
    }

    /// Sets the quality measured during the run, which checkpoints hold.
    pub fn set_curves(&mut self, curves: QualityCurves) {
        self.past.curves = curves;
    }

    /// Skipped frames.
    pub fn skipped(&self) -> &[SkippedFrame] {
        &self.past.skipped
    }

    /// Splats of all components, in world units. Entry `k` is component `k`, with opacity 0 if it is not
    /// drawn. Equal models give equal files.
    pub fn splats(&self) -> SplatSet {
        self.learner().splats()
    }

    /// Splats of the listed components, in world units.
    pub fn splats_of(&self, ids: &[u32]) -> SplatSet {
        self.learner().splats_of(ids)
    }

    /// Adds a device that computes a part of training from now on; ignored if the learner has no such
    /// part.
    ///
    /// # Errors
    /// [`DeviceError`] if the device has too little memory for the model; it is then not used.
    pub fn add_device(
        &mut self,
        device: TrainingDevice,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        self.learner_mut().add_device(device, policy)
    }
}

/// Returns the time in milliseconds since the last change of a frame's files. `None` if the time of the
/// change is unknown or in the future.
fn latency_ms(marks: &FrameMarks) -> Option<f64> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).ok()?;
    // Checked, because the recorder's clock may be ahead of this one.
    Some(1e3 * now.checked_sub(marks.last_modified()?)?.as_secs_f64())
}

/// Error of starting the demo, which trains on the built-in synthetic room.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// The parameters of the synthetic room are invalid.
    #[error("{0}")]
    Scene(#[from] ParamsError),
    /// The session could not be started.
    #[error("{0}")]
    Session(#[from] SessionError),
}

/// Returns the dataset of the built-in synthetic room.
pub fn demo_dataset() -> Result<Arc<Dataset>, DemoError> {
    Ok(Arc::new(synthetic::demo()?))
}

/// Starts a session over all frames of the built-in synthetic room.
pub fn demo_session(asked: impl Into<MethodRequest>) -> Result<Session, DemoError> {
    Ok(Session::new(demo_dataset()?, asked, Selection::all_frames())?)
}
