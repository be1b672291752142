//! Distance of two depth images as a function of their delay.

use super::clock::{Clock, ImagePair};
use super::mount_search::{EVERY, Strips};
use crate::dataset::decode;
use crate::dataset::depth::{Depth, DepthKind};
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// Limit for relative depth differences, to bound the effect of occlusions.
const FARTHEST: f64 = 0.05;

pub(super) struct Pair<'a> {
    pub shots: [&'a ImagePair; 2],
    depths: [Depth; 2],
}

impl<'a> Pair<'a> {
    /// Loads both images; `None` if one cannot be read or is measured along rays, as no Kinect does.
    pub fn load<At>(shots: [&'a ImagePair; 2], clock: &Clock<At>) -> Option<Self> {
        let [a, b] = shots;
        Some(Self { shots, depths: [load(a, &clock.intrinsics)?, load(b, &clock.intrinsics)?] })
    }

    pub fn distance<At>(&self, clock: &Clock<At>, delay: f64) -> f64
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let (mut sum, mut n) = (0.0, 0.0);
        for share in self.depth_differences(clock, delay).into_iter().flatten() {
            sum += share.abs().min(FARTHEST);
            n += 1.0;
        }
        // Without common samples the match is the worst: a delay must not gain by losing them.
        if n > 0.0 { sum / n } else { FARTHEST }
    }

    /// Signed depth difference of the second image to the first, relative to depth. Samples are the same
    /// for any clock and delay.
    pub fn depth_differences<At>(&self, clock: &Clock<At>, delay: f64) -> Vec<Option<f64>>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        self.measured(clock, delay, |_, share| share)
    }

    pub fn common<At>(&self, clock: &Clock<At>, delay: f64) -> Vec<DVec3>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let near = |world, share: f64| (share.abs() < FARTHEST).then_some(world);
        self.measured(clock, delay, near).into_iter().flatten().flatten().collect()
    }

    /// For each sample of the first image, `make` of its world point and the relative depth difference in
    /// the second image; `None` if one has no depth.
    fn measured<At, T>(
        &self,
        clock: &Clock<At>,
        delay: f64,
        make: impl Fn(DVec3, f64) -> T,
    ) -> Vec<Option<T>>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let k = &clock.intrinsics;
        let [from, to] = self
            .shots
            .map(|shot| Strips::new(*k, &clock.at, shot.depth.0 + delay, clock.depth_reading));
        let [a, b] = &self.depths;
        let sample = |column: usize, row: usize, pose: &Pose| {
            let world = pose.transform_point(k.ray(column, row) * trusted(a, column, row)?);
            let [u, v, expected] = to.project(world)?;
            Some(make(world, (trusted(b, u as usize, v as usize)? - expected) / expected))
        };
        let columns = || (EVERY / 2..k.width as usize).step_by(EVERY);
        let rows = from.rows();
        rows.flat_map(|(row, pose)| columns().map(move |column| (column, row, pose)))
            .map(|(column, row, pose)| sample(column, row, pose))
            .collect()
    }
}

pub(super) fn total<At>(pairs: &[&Pair<'_>], clock: &Clock<At>, delay: f64) -> f64
where
    At: Fn(f64) -> Option<Pose> + Sync,
{
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
