//! Start of a session: the only place that distinguishes the presets of a run.

use super::error::SessionError;
use super::frame_loop::{FrameLoop, InitialLearner, ObservationOf, PresetLoop, TypedPreset};
use super::plan::{Plan, Selection};
use super::prefetch::Prefetch;
use super::run::RunConfig;
use super::session::Session;
use super::settings::method::{Method, MethodRequest};
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::range::PositionRange;
use crate::dataset::surface::{Preparer, SurfaceCounts, SurfaceSettings};
use crate::dataset::synthetic::ParamsError;
use crate::dataset::unproject::{PointCounts, UnprojectSettings, Unprojector};
use crate::dataset::{Dataset, synthetic};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::observation::points::Points;
use crate::observation::surface::Observation;
use std::fmt::Display;
use std::sync::Arc;

/// Initial state of a learner.
pub(super) enum InitialState<'a> {
    /// Untrained; positions lie in this range.
    Fresh(&'a PositionRange),
    /// Stored model after this number of frames. It must match the run's settings.
    Stored(&'a StoredModel, u64),
}

/// Starts decoding the frames of a plan from position `first`, for a learner of the run's preset. Also
/// returns the transform from world to model coordinates.
pub(super) fn frame_loop(
    dataset: &Arc<Dataset>,
    run: &RunConfig,
    plan: &Plan,
    first: usize,
    origin: &InitialState,
) -> Result<(Box<dyn FrameLoop>, Normalization), SessionError> {
    match &run.method {
        Method::Paper(config) => preset_loop(config, dataset, run, plan, first, origin),
        Method::Scene(scene) => preset_loop(&**scene, dataset, run, plan, first, origin),
    }
}

fn preset_loop<P: TypedPreset>(
    preset: &P,
    dataset: &Arc<Dataset>,
    run: &RunConfig,
    plan: &Plan,
    first: usize,
    origin: &InitialState,
) -> Result<(Box<dyn FrameLoop>, Normalization), SessionError> {
    let beginning: InitialLearner<ObservationOf<P>> = match origin {
        InitialState::Fresh(range) => preset.begin(dataset, run, range, plan.pixels(dataset))?,
        InitialState::Stored(model, frames) => {
            preset.restore(model, *frames).map_err(SessionError::Stored)?
        }
    };
    let InitialLearner { learner, normalization } = beginning;
    let preparation = preset.preparation(run, normalization);
    let prefetch = Prefetch::start(dataset.clone(), plan, first, preparation)?;
    Ok((Box::new(PresetLoop { prefetch, learner }), normalization))
}

/// Preparation of frames, implemented by its settings, which the threads share.
pub trait Prepare: Send + Sync + 'static {
    /// Input of a learner.
    type Observation: Send + 'static;
    /// Buffers reused between frames, one per thread.
    type Memory: Default + Send + 'static;
    /// Counts of pixels by result; displays those without a point.
    type Counts: Display;

    /// Returns an observation without points, whose memory frames reuse.
    fn empty() -> Self::Observation;

    /// Replaces `observation` by that of a frame.
    ///
    /// # Errors
    /// [`FrameError`] for a frame that lacks required data, such as depth.
    fn prepare(
        &self,
        frame: &Frame,
        memory: &mut Self::Memory,
        observation: &mut Self::Observation,
    ) -> Result<Self::Counts, FrameError>;

    /// Number of points of an observation.
    fn n_points(observation: &Self::Observation) -> usize;

    /// Measured pixels without a point.
    fn dropped(counts: &Self::Counts) -> usize;
}

/// Prepares coloured points for the published algorithm.
impl Prepare for UnprojectSettings {
    type Observation = Points<f32>;
    type Memory = Unprojector;
    type Counts = PointCounts;

    fn empty() -> Points<f32> {
        Points::new()
    }

    fn prepare(
        &self,
        frame: &Frame,
        unprojector: &mut Unprojector,
        points: &mut Points<f32>,
    ) -> Result<PointCounts, FrameError> {
        unprojector.unproject(frame, self, points)
    }

    fn n_points(points: &Points<f32>) -> usize {
        points.len()
    }

    fn dropped(counts: &PointCounts) -> usize {
        counts.dropped()
    }
}

/// Prepares surface points and ranges for the scene preset.
impl Prepare for SurfaceSettings {
    type Observation = Observation;
    type Memory = Preparer;
    type Counts = SurfaceCounts;

    fn empty() -> Observation {
        Observation::empty()
    }

    fn prepare(
        &self,
        frame: &Frame,
        preparer: &mut Preparer,
        surfaces: &mut Observation,
    ) -> Result<SurfaceCounts, FrameError> {
        preparer.prepare(frame, self, surfaces)
    }

    fn n_points(surfaces: &Observation) -> usize {
        surfaces.points.len()
    }

    fn dropped(counts: &SurfaceCounts) -> usize {
        counts.dropped()
    }
}

/// Error of starting the demo.
#[derive(Debug, thiserror::Error)]
pub enum DemoError {
    /// Invalid scene parameters.
    #[error("{0}")]
    Scene(#[from] ParamsError),
    /// The session could not be started.
    #[error("{0}")]
    Session(#[from] SessionError),
}

/// Returns the synthetic room.
pub fn dataset() -> Result<Arc<Dataset>, DemoError> {
    Ok(Arc::new(synthetic::demo()?))
}

/// Starts a session over all frames of the demo.
pub fn session(asked: impl Into<MethodRequest>) -> Result<Session, DemoError> {
    Ok(Session::new(dataset()?, asked, Selection::all_frames())?)
}
