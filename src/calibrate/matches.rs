//! Points of several views, matched by the components that own them.
//!
//! Components replace feature matching: points of one component lie on one surface patch in every view.
//! Matching relies on the very depth that is to be calibrated, so searches begin with components several
//! times as large.

use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{Preparer, SurfaceSettings};
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::scene::merge::Partition;
use glam::{DMat3, DVec3};
use rayon::prelude::*;

#[derive(Clone, Copy)]
pub(super) struct MatchedPoint {
    pub component: u32,
    pub view: u32,
    pub point: SurfacePoint,
    /// Position on the point's surface at which colours are sampled, offset by up to half a pixel, in
    /// the depth camera's frame. Without the offset, a registered colour would be read exactly at a
    /// texel centre in its own view but interpolated in others. This smoothing would bias the colour
    /// difference.
    pub local: DVec3,
}

/// Pose of a view's depth camera, relative to the points' origin. It maps world to camera, whereas a
/// `Pose` maps camera to world.
#[derive(Clone, Copy)]
pub(super) struct CameraPose {
    pub rotation: DMat3,
    pub centre: DVec3,
}

impl CameraPose {
    fn of(frame: &Frame, origin: DVec3) -> Self {
        let pose = &frame.camera.pose;
        Self { rotation: pose.rotation().transpose(), centre: pose.centre() - origin }
    }

    /// Returns a position on the surface up to half a pixel from a point, in the depth camera's frame.
    fn jittered_surface_point(&self, point: &SurfacePoint) -> DVec3 {
        let local = self.rotation * (point.position_vector() - self.centre);
        let normal = self.rotation * point.normal_vector();
        // Martin Roberts' R2 sequence covers the pixel evenly.
        let across = [0.754_877_666_246_693, 0.569_840_290_998_053]
            .map(|ratio| (f64::from(point.pixel) * ratio).fract() - 0.5);
        let step = f64::from(point.footprint) * DVec3::new(across[0], across[1], 0.0);
        // Back along the ray onto the tangent plane.
        local + step - local * (normal.dot(step) / normal.dot(local))
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct MatchedDepth {
    /// Depth offset (world units) and depth scale.
    pub values: [f64; 2],
    pub along_z: bool,
}

/// Matched points, sorted by component and view. Components seen by a single view are left out.
pub(super) struct Matches {
    pub depth: MatchedDepth,
    pub poses: Vec<CameraPose>,
    samples: Vec<MatchedPoint>,
    /// Index of each component's first point; the last entry is the number of points.
    starts: Vec<usize>,
    /// Number of components created, including those seen by a single view.
    pub births: usize,
}

impl Matches {
    /// Converts frames to points by `settings`, keeps every `step`-th pixel of rows and columns, and
    /// matches the points. `h` is the structural scale (size of a component), world units.
    ///
    /// # Errors
    /// Fails for a frame without depth.
    pub fn new(
        frames: &[Frame],
        settings: &SurfaceSettings,
        depth: MatchedDepth,
        (h, step): (f64, usize),
    ) -> Result<Self, FrameError> {
        let prepare = |preparer: &mut Preparer, frame| -> Result<_, FrameError> {
            let mut observation = Observation::empty();
            preparer.prepare(frame, settings, &mut observation)?;
            let width = observation.ranges.width;
            observation.points.retain(|point| {
                let (column, row) = (point.pixel as usize % width, point.pixel as usize / width);
                // By pixel rather than list position, so that the choice does not depend on the filters.
                column.is_multiple_of(step) && row.is_multiple_of(step)
            });
            Ok(observation.points)
        };
        let views: Vec<Vec<SurfacePoint>> =
            frames.par_iter().map_init(Preparer::new, prepare).collect::<Result<_, _>>()?;
        let poses = frames.iter().map(|frame| CameraPose::of(frame, settings.origin)).collect();
        Ok(Self::from_views(&views, poses, depth, h))
    }

    pub fn from_views(
        views: &[Vec<SurfacePoint>],
        poses: Vec<CameraPose>,
        depth: MatchedDepth,
        h: f64,
    ) -> Self {
        let mut partition = Partition::new(h);
        let mut samples = Vec::new();
        for (view, points) in views.iter().enumerate() {
            // View by view: births depend on the order.
            let owners = partition.assign(points);
            let pose = &poses[view];
            samples.extend(points.iter().zip(owners).filter_map(|(&point, owner)| {
                let local = pose.jittered_surface_point(&point);
                Some(MatchedPoint { component: owner?, view: view as u32, point, local })
            }));
        }
        // Stable sort: within a view, points stay in tile order.
        samples.sort_by_key(|s| (s.component, s.view));
        let mut kept = Vec::with_capacity(samples.len());
        let mut starts = vec![0];
        for run in samples.chunk_by(|a, b| a.component == b.component) {
            // Sorted by view: first and last differ if any two do.
            if run[0].view != run[run.len() - 1].view {
                kept.extend_from_slice(run);
                starts.push(kept.len());
            }
        }
        Self { depth, poses, samples: kept, starts, births: partition.components() }
    }

    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    pub fn n_sightings(&self) -> usize {
        self.samples.chunk_by(|a, b| (a.component, a.view) == (b.component, b.view)).count()
    }

    pub fn samples(&self) -> &[MatchedPoint] {
        &self.samples
    }

    #[cfg(test)]
    pub fn spoil(&mut self, every: usize, place: impl Fn(DVec3) -> DVec3) {
        for sample in self.samples.iter_mut().step_by(every) {
            sample.point.position = place(sample.point.position_vector()).as_vec3().to_array();
        }
    }

    pub fn start_of(&self, component: usize) -> usize {
        self.starts[component]
    }

    pub fn points_of(&self, component: usize) -> &[MatchedPoint] {
        &self.samples[self.starts[component]..self.starts[component + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_lie_on_the_surface_within_half_a_pixel() {
        let pose =
            CameraPose { rotation: DMat3::from_rotation_y(0.3), centre: DVec3::new(1.0, 2.0, 3.0) };
        let normal = DVec3::new(0.3, 0.2, -1.0).normalize();
        let local = DVec3::new(0.4, -0.3, 2.0);
        let world = pose.rotation.transpose();
        for pixel in 0..100 {
            let point = SurfacePoint {
                position: (world * local + pose.centre).as_vec3().to_array(),
                normal: (world * normal).as_vec3().to_array(),
                footprint: 0.01,
                pixel,
                ..SurfacePoint::default()
            };
            let place = pose.jittered_surface_point(&point);
            assert!(normal.dot(place - local).abs() < 1e-6);
            let shift = (place / place.z - local / local.z) * local.z;
            assert!(shift.abs().max_element() < 0.0051, "{shift}");
        }
    }
}
