//! A decoded frame in the form that a model learns from.

use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{Preparer, SurfaceCounts, SurfaceSettings};
use crate::dataset::unproject::{PointCounts, UnprojectSettings, Unprojector};
use crate::observation::points::Points;
use crate::observation::surface::Observation;

/// How frames are prepared.
#[derive(Clone, Debug, PartialEq)]
pub enum Preparation {
    /// Coloured points, for the paper's preset.
    Points(UnprojectSettings),
    /// Surface points and ranges, for the scene's.
    Surfaces(Box<SurfaceSettings>),
}

/// What a model learns from.
pub enum Material {
    /// For the paper's preset.
    Points(Points<f32>),
    /// For the scene's.
    Surfaces(Box<Observation>),
}

impl Material {
    /// Number of points.
    pub fn len(&self) -> usize {
        match self {
            Self::Points(points) => points.len(),
            Self::Surfaces(frame) => frame.points.len(),
        }
    }

    /// The points, if that is what it is.
    pub fn into_points(self) -> Option<Points<f32>> {
        match self {
            Self::Points(points) => Some(points),
            Self::Surfaces(_) => None,
        }
    }

    /// Whether there is nothing to learn from.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What became of the pixels of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counts {
    /// See [`PointCounts`].
    Points(PointCounts),
    /// See [`SurfaceCounts`].
    Surfaces(SurfaceCounts),
}

impl Counts {
    /// Measured pixels that made no point.
    pub fn dropped(&self) -> usize {
        match self {
            Self::Points(counts) => counts.dropped(),
            Self::Surfaces(counts) => counts.dropped(),
        }
    }
}

/// In words, without those that made points.
impl std::fmt::Display for Counts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Points(c) => write!(
                f,
                "{} holes, {} at edges, {} out of range, {} transparent",
                c.holes, c.dropped_edge, c.dropped_range, c.dropped_alpha
            ),
            Self::Surfaces(c) => write!(
                f,
                "{} holes, {} flying, {} at a slant, {} out of range, {} transparent, {} outside the colour image",
                c.holes,
                c.dropped_flying,
                c.dropped_slant,
                c.dropped_range,
                c.dropped_alpha,
                c.dropped_no_color
            ),
        }
    }
}

/// Prepares frames one after the other; keeps memory between them.
#[derive(Default)]
pub(super) struct Desk {
    unprojector: Unprojector,
    preparer: Preparer,
    /// Material whose memory the next frame may take.
    pub memory: Option<Material>,
}

impl Desk {
    /// What a frame holds for the model.
    pub fn prepare(
        &mut self,
        frame: &Frame,
        preparation: &Preparation,
    ) -> Result<(Material, Counts), FrameError> {
        match (preparation, self.memory.take()) {
            (Preparation::Points(settings), memory) => {
                let mut points = match memory {
                    Some(Material::Points(points)) => points,
                    _ => Points::default(),
                };
                let counts = self.unprojector.unproject(frame, settings, &mut points)?;
                Ok((Material::Points(points), Counts::Points(counts)))
            }
            (Preparation::Surfaces(settings), memory) => {
                let mut surfaces = match memory {
                    Some(Material::Surfaces(surfaces)) => surfaces,
                    _ => Box::new(Observation::empty()),
                };
                let counts = self.preparer.prepare(frame, settings, &mut surfaces)?;
                Ok((Material::Surfaces(surfaces), Counts::Surfaces(counts)))
            }
        }
    }
}
