//! Checks, before training on a frame, whether the frame's points agree with the scene
//! (`photographs.md`, Outlier frames).

use crate::math::camera::Camera;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::scene::component_sums::{ComponentSums, KNOWN_POINTS};
use crate::train::scene::components::Seeds;
use crate::train::scene::observe::FrameView;
use glam::DVec3;
use rayon::prelude::*;

// Stride over the points: neighbours are redundant.
const EVERY: usize = 8;
/// Number of points per task; a multiple of [`EVERY`].
const CHUNK: usize = 1024;
/// Minimum number of components per task.
const MIN_TASK: usize = 128;
/// Approximate maximum number of components that are tested for visibility.
const MAX_COMPONENTS: usize = 4096;
/// Minimum number of compared points, or of components in view, for an outlier test.
const MIN_MATCHES: f64 = 100.0;

/// Agreement of a frame's points with the components that existed before the frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameAgreement {
    /// Squared difference between the colour of a point and the mean of its component, summed over
    /// points and channels.
    pub squared_error: f64,
    /// Number of points whose colours were compared.
    pub points: f64,
    /// Number of components in view that the frame either measured or saw through.
    pub in_view: f64,
    /// Number of components in view that the frame saw through: the ray towards each reached a farther
    /// surface or none.
    pub seen_through: f64,
}

/// A frame and the scene before training on that frame.
pub struct FrameBesideScene<'a> {
    pub component_sums: &'a ComponentSums,
    pub seeds: &'a Seeds,
    /// Structural scale, world units.
    pub h: f64,
    /// The frame as recorded.
    pub frame: &'a Observation,
    /// Camera of the frame with the corrected pose.
    pub camera: &'a Camera,
    /// Points of the frame under the corrected pose.
    pub points: &'a [SurfacePoint],
    /// Component of each point.
    pub owners: &'a [u32],
    /// Factor per channel that converts the frame's colours to the scene's exposure.
    pub gain: [f32; 3],
}

impl FrameBesideScene<'_> {
    /// Returns the agreement of the frame with the scene. Fields are zero if they are computed from too
    /// few points or components.
    pub fn agreement(&self) -> FrameAgreement {
        let mut found = FrameAgreement::default();
        for (squared_error, points) in self.differences() {
            found.squared_error += squared_error;
            found.points += points;
        }
        (found.in_view, found.seen_through) = self.count_seen_through();
        // Too few to judge a frame by; zeros leave the running means unchanged.
        if found.points < MIN_MATCHES {
            (found.squared_error, found.points) = (0.0, 0.0);
        }
        if found.in_view < MIN_MATCHES {
            (found.seen_through, found.in_view) = (0.0, 0.0);
        }
        found
    }

    /// Returns the squared colour error and the number of compared points for each [`CHUNK`] of points.
    /// The fixed chunk size makes sums independent of the number of threads.
    fn differences(&self) -> Vec<(f64, f64)> {
        let chunks = self.points.par_chunks(CHUNK).zip(self.owners.par_chunks(CHUNK));
        let chunks = chunks.map(|(points, owners)| {
            let mut sum = (0.0, 0.0);
            for (point, &owner) in points.iter().zip(owners).step_by(EVERY) {
                let Some(color) = self.component_sums.known_color(owner) else { continue };
                let difference = |i: usize| f64::from(point.color[i] * self.gain[i]) - color[i];
                sum.0 += (0..3).map(|i| difference(i).powi(2)).sum::<f64>();
                sum.1 += 1.0;
            }
            sum
        });
        chunks.collect()
    }

    /// Returns the number of tested components that the frame measured or saw through, and how many of
    /// these it saw through.
    fn count_seen_through(&self) -> (f64, f64) {
        let viewer = FrameView::new(self.frame, self.camera, self.h);
        let every = self.component_sums.len().div_ceil(MAX_COMPONENTS).max(1);
        let is_through = |id: usize| {
            let (n, offset, _) = self.component_sums.plane_sums(id);
            if n < KNOWN_POINTS {
                return None;
            }
            let seed = DVec3::from_array(self.seeds.of(id).map(f64::from));
            viewer.measures_through(seed + DVec3::from_array(offset) * (self.h / n))
        };
        let ids = (0..self.component_sums.len().div_ceil(every)).into_par_iter();
        let seen = ids.with_min_len(MIN_TASK).filter_map(|at| is_through(at * every));
        let counts = seen.map(|is_through| (1, u32::from(is_through)));
        let (in_view, through) = counts.reduce(|| (0, 0), |a, b| (a.0 + b.0, a.1 + b.1));
        (f64::from(in_view), f64::from(through))
    }
}
