//! Points of several views, brought together by the components that own them.

use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{Preparer, SurfaceSettings};
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::scene::partition::Partition;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

/// A point of a view.
#[derive(Clone, Copy)]
pub(super) struct Sample {
    pub component: u32,
    pub view: u32,
    pub point: SurfacePoint,
    /// A place near it on its surface, in the frame of the depth camera. Registered colours would be
    /// looked up at texels otherwise, others between them, where interpolation makes them look more
    /// alike.
    pub local: DVec3,
}

/// Where a view's depth camera stands.
#[derive(Clone, Copy)]
pub(super) struct Stand {
    /// World to camera.
    pub rotation: DMat3,
    /// Relative to the origin of the points.
    pub centre: DVec3,
}

impl Stand {
    fn of(frame: &Frame, origin: DVec3) -> Self {
        let pose = &frame.camera.pose;
        Self { rotation: pose.rotation().transpose(), centre: pose.centre() - origin }
    }

    /// A place on the surface around a point, up to half a pixel away, in the frame of the depth
    /// camera.
    fn place_near(&self, point: &SurfacePoint) -> DVec3 {
        let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
        let local = self.rotation * (vector(point.position) - self.centre);
        let normal = self.rotation * vector(point.normal);
        // Martin Roberts' sequence in two dimensions covers the pixel evenly.
        let across = [0.754_877_666_246_693, 0.569_840_290_998_053]
            .map(|ratio| (f64::from(point.pixel) * ratio).fract() - 0.5);
        let step = f64::from(point.footprint) * DVec3::new(across[0], across[1], 0.0);
        local + step - local * (normal.dot(step) / normal.dot(local))
    }
}

/// Points by component, those of one component by view; components of a single view are left out.
pub(super) struct Matches {
    pub stands: Vec<Stand>,
    samples: Vec<Sample>,
    /// Where the components begin, and the end.
    starts: Vec<usize>,
    /// Components born, those of a single view among them.
    pub births: usize,
}

impl Matches {
    /// Of frames prepared as `settings` say; takes every `step`-th pixel of every `step`-th row.
    /// `h` is the structural scale, world units.
    ///
    /// # Errors
    /// A frame without depth.
    pub fn new(
        frames: &[Frame],
        settings: &SurfaceSettings,
        h: f64,
        step: usize,
    ) -> Result<Self, FrameError> {
        let prepare = |preparer: &mut Preparer, frame| thinned(preparer, frame, settings, step);
        let views: Vec<Vec<SurfacePoint>> =
            frames.par_iter().map_init(Preparer::new, prepare).collect::<Result<_, _>>()?;
        let stands = frames.iter().map(|frame| Stand::of(frame, settings.origin)).collect();
        Ok(Self::together(&views, stands, h))
    }

    /// Of the points of every view.
    pub fn together(views: &[Vec<SurfacePoint>], stands: Vec<Stand>, h: f64) -> Self {
        let mut partition = Partition::new(h);
        let mut samples = Vec::new();
        for (view, points) in views.iter().enumerate() {
            let owners = partition.assign(points);
            let stand = &stands[view];
            samples.extend(points.iter().zip(owners).filter_map(|(&point, owner)| {
                let local = stand.place_near(&point);
                Some(Sample { component: owner?, view: view as u32, point, local })
            }));
        }
        samples.sort_by_key(|s| (s.component, s.view));
        let mut kept = Vec::with_capacity(samples.len());
        let mut starts = vec![0];
        for run in samples.chunk_by(|a, b| a.component == b.component) {
            if run[0].view != run[run.len() - 1].view {
                kept.extend_from_slice(run);
                starts.push(kept.len());
            }
        }
        Self { stands, samples: kept, starts, births: partition.components() }
    }

    /// Components seen by several views.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Points of these.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Points of a component.
    pub fn of(&self, component: usize) -> &[Sample] {
        &self.samples[self.starts[component]..self.starts[component + 1]]
    }
}

/// The points of every `step`-th pixel of every `step`-th row.
pub(super) fn thinned(
    preparer: &mut Preparer,
    frame: &Frame,
    settings: &SurfaceSettings,
    step: usize,
) -> Result<Vec<SurfacePoint>, FrameError> {
    let mut observation = Observation::empty();
    preparer.prepare(frame, settings, &mut observation)?;
    let width = observation.ranges.width;
    observation.points.retain(|point| {
        let (column, row) = (point.pixel as usize % width, point.pixel as usize / width);
        column.is_multiple_of(step) && row.is_multiple_of(step)
    });
    Ok(observation.points)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_lie_on_the_surface_within_half_a_pixel() {
        let stand =
            Stand { rotation: DMat3::from_rotation_y(0.3), centre: DVec3::new(1.0, 2.0, 3.0) };
        let normal = DVec3::new(0.3, 0.2, -1.0).normalize();
        let local = DVec3::new(0.4, -0.3, 2.0);
        let world = stand.rotation.transpose();
        for pixel in 0..100 {
            let point = SurfacePoint {
                position: (world * local + stand.centre).as_vec3().to_array(),
                normal: (world * normal).as_vec3().to_array(),
                footprint: 0.01,
                pixel,
                ..SurfacePoint::default()
            };
            let place = stand.place_near(&point);
            assert!(normal.dot(place - local).abs() < 1e-6);
            let shift = (place / place.z - local / local.z) * local.z;
            assert!(shift.abs().max_element() < 0.0051, "{shift}");
        }
    }
}
