//! Points of the current frame: their components, shifts and sums.

use super::scene::Scene;
use crate::observation::surface::{DepthTolerance, SurfacePoint};
use crate::train::scene::accumulate::AssignedPoints;
use crate::train::scene::explain::Explainer;
use crate::train::scene::gain::{MIN_MATCHES, fewest_matches, gain};
use crate::train::scene::point_fits::PointFits;

/// Points of the current frame with their components and shifts. The buffers are reused for the next
/// frame.
#[derive(Default)]
pub(super) struct FramePoints {
    /// Assigns and sums points on the CPU or a device.
    pub fits: PointFits,
    /// Component of each point.
    pub owners: Vec<u32>,
    /// Shift of each point along its ray, world units.
    shifts: Vec<f32>,
    /// Squared distance of each point from the seed of its component, world units².
    pub q: Vec<f64>,
}

impl FramePoints {
    /// Chooses a device for a new frame and assigns the frame's points to components.
    pub fn assign_new(&mut self, scene: &Scene, points: &[SurfacePoint]) {
        self.fits.begin_frame(points.len(), scene.config.h);
        self.assign(scene, points);
    }

    /// Assigns the points to components without choosing a device. Used for points that are not summed,
    /// and again after merging.
    pub fn assign(&mut self, scene: &Scene, points: &[SurfacePoint]) {
        self.fits.assign(&scene.seeds, scene.reach(), points, &mut self.owners);
    }

    /// Returns the factor per channel that converts the frame's colours to the scene's exposure.
    /// `weight` is the number of pixels per point.
    pub fn gain(&self, scene: &Scene, points: &[SurfacePoint], weight: u32) -> [f32; 3] {
        if !scene.config.gain {
            return [1.0; 3];
        }
        let fewest = fewest_matches(points.len(), MIN_MATCHES / f64::from(weight));
        gain(&scene.sums, points, &self.owners, fewest)
    }

    /// Computes the shift of each point along its ray to the most probable depth. Returns the sum of
    /// squared distances from the seeds (world units²) and the number of points with a component.
    pub fn explain(
        &mut self,
        scene: &Scene,
        points: &[SurfacePoint],
        tolerance: DepthTolerance,
    ) -> (f64, usize) {
        let explainer = Explainer {
            component_sums: &scene.sums,
            seeds: &scene.seeds,
            h: scene.config.h,
            reach: scene.reach(),
            tolerance,
            refines: scene.config.refine,
        };
        explainer.explain(points, &self.owners, &mut self.q, &mut self.shifts)
    }

    /// Adds the points to the sums of their components. Replaces `touched` by the components with
    /// points, ascending.
    pub fn sum_up(
        &mut self,
        scene: &mut Scene,
        points: &[SurfacePoint],
        weight: u32,
        gain: [f32; 3],
        touched: &mut Vec<u32>,
    ) {
        let Self { fits, owners, shifts, .. } = self;
        scene.grow_sums();
        let (seeds, h) = (&scene.seeds, scene.config.h);
        let frame = AssignedPoints { seeds, h, points, owners, shifts, gain, weight };
        fits.accumulate(&mut scene.sums, frame, touched);
        // Every frame: a row that is not full can take one more frame, since accumulation sums a component
        // with more than 4,096 points wide at once.
        scene.sums.spill_to_wide_rows(touched);
    }
}
