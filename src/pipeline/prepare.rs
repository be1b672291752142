//! A decoded frame in the form that a learner understands: what turns pixels into observations, one
//! implementation for each form.

use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{Preparer, SurfaceCounts, SurfaceSettings};
use crate::dataset::unproject::{PointCounts, UnprojectSettings, Unprojector};
use crate::observation::points::Points;
use crate::observation::surface::Observation;
use std::fmt::Display;

/// How frames are prepared. Implemented by the settings of each preparation, which threads share.
pub trait Prepare: Send + Sync + 'static {
    /// What a learner learns from.
    type Observation: Send + 'static;
    /// Buffers kept between frames, one for each thread.
    type Memory: Default + Send + 'static;
    /// What became of the pixels; in words without those that made points.
    type Counts: Display;

    /// An observation without points, whose memory frames reuse.
    fn empty() -> Self::Observation;

    /// Replaces `observation` by what a frame holds.
    ///
    /// # Errors
    /// [`FrameError`] for a frame without what is needed, such as depth.
    fn prepare(
        &self,
        frame: &Frame,
        memory: &mut Self::Memory,
        observation: &mut Self::Observation,
    ) -> Result<Self::Counts, FrameError>;

    /// Points of an observation.
    fn n_points(observation: &Self::Observation) -> usize;

    /// Measured pixels that made no point.
    fn dropped(counts: &Self::Counts) -> usize;
}

/// Coloured points for the published algorithm.
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

/// Surface points and ranges for the scene preset.
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
