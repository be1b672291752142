//! Difference between two depth images as a function of the delay from timestamp to capture.

use super::clock::{Clock, ImagePair};
use super::mount_search::{EVERY, Strips};
use crate::dataset::decode;
use crate::dataset::depth::{Depth, DepthKind};
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// Limit to which relative depth differences are clamped; it bounds the effect of occlusions.
const FARTHEST: f64 = 0.05;

pub(super) struct Pair<'a> {
    pub shots: [&'a ImagePair; 2],
    depths: [Depth; 2],
}

impl<'a> Pair<'a> {
    /// Loads both depth images. Returns `None` if one cannot be read or has depth along the ray, which
    /// no Kinect measures.
    pub fn load(shots: [&'a ImagePair; 2], clock: &Clock<'_>) -> Option<Self> {
        let [a, b] = shots;
        Some(Self { shots, depths: [load(a, &clock.intrinsics)?, load(b, &clock.intrinsics)?] })
    }

    pub fn distance(&self, clock: &Clock<'_>, delay: f64) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for share in self.depth_differences(clock, delay).into_iter().flatten() {
            sum += share.abs().min(FARTHEST);
            n += 1.0;
        }
        // Without common samples the match is the worst: a delay must not gain by losing them.
        if n > 0.0 { sum / n } else { FARTHEST }
    }

    /// Returns, for each sample of the first image, the depth measured in the second image minus the
    /// depth expected from the first, relative to the expected depth. `None` if either depth is
    /// missing. The samples are the same for every delay and clock.
    pub fn depth_differences(&self, clock: &Clock<'_>, delay: f64) -> Vec<Option<f64>> {
        self.measured(clock, delay, |_, share| share)
    }

    pub fn common(&self, clock: &Clock<'_>, delay: f64) -> Vec<DVec3> {
        let near = |world, share: f64| (share.abs() < FARTHEST).then_some(world);
        self.measured(clock, delay, near).into_iter().flatten().flatten().collect()
    }

    /// Calls `make` for each sample of the first image. Its arguments are the sample's world point and
    /// the relative depth difference in the second image. A sample without depth in both images yields
    /// `None`.
    fn measured<T>(
        &self,
        clock: &Clock<'_>,
        delay: f64,
        make: impl Fn(DVec3, f64) -> T,
    ) -> Vec<Option<T>> {
        let k = &clock.intrinsics;
        let [from, to] =
            self.shots.map(|shot| Strips::new(clock, shot.depth.0 + delay, clock.depth_reading));
        let [a, b] = &self.depths;
        let sample = |column: usize, row: usize, pose: &Pose| {
            let world = pose.transform_point(k.ray(column, row) * trusted(a, column, row)?);
            let [u, v, expected] = to.project(world)?;
            // Pixel centres are at +½, so truncation finds the pixel that contains the point.
            Some(make(world, (trusted(b, u as usize, v as usize)? - expected) / expected))
        };
        let columns = || (EVERY / 2..k.width as usize).step_by(EVERY);
        let rows = from.rows();
        rows.flat_map(|(row, pose)| columns().map(move |column| (column, row, pose)))
            .map(|(column, row, pose)| sample(column, row, pose))
            .collect()
    }
}

pub(super) fn total(pairs: &[&Pair<'_>], clock: &Clock<'_>, delay: f64) -> f64 {
    let each: Vec<f64> = pairs.par_iter().map(|pair| pair.distance(clock, delay)).collect();
    // Summed in order, so that rounding does not depend on the number of threads.
    each.iter().sum()
}

fn load(shot: &ImagePair, k: &Intrinsics) -> Option<Depth> {
    let (_, source) = &shot.depth;
    let size = (k.width, k.height);
    let depth = shot.read(|| decode::depth(&source.file, &source.encoding, size))?;
    (depth.kind == DepthKind::Z).then_some(depth)
}

fn trusted(depth: &Depth, column: usize, row: usize) -> Option<f64> {
    depth.value_at(column, row).filter(|&z| depth.is_trusted(z))
}
