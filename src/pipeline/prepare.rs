//! Preparation of decoded frames as observations, with one implementation per observation type.

use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{Preparer, SurfaceCounts, SurfaceSettings};
use crate::dataset::unproject::{PointCounts, UnprojectSettings, Unprojector};
use crate::observation::points::Points;
use crate::observation::surface::Observation;
use std::fmt::Display;

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
