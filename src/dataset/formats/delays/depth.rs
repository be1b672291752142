//! How well two depth images fit, given when they were taken.

use super::clock::{Clock, Shot};
use super::strips::{EVERY, Strips};
use crate::dataset::decode;
use crate::dataset::depth::{Depth, DepthKind};
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;

/// Distances count as shares of the depth, at most this: edges hide and show.
const FARTHEST: f64 = 0.05;

/// Two images of the same surfaces.
pub(super) struct Pair<'a> {
    pub shots: [&'a Shot; 2],
    depths: [Depth; 2],
}

impl<'a> Pair<'a> {
    /// `None` where one of them cannot be read, or measures along rays, as no Kinect does.
    pub fn load<At>(shots: [&'a Shot; 2], clock: &Clock<At>) -> Option<Self> {
        let [a, b] = shots;
        Some(Self { shots, depths: [load(a, &clock.intrinsics)?, load(b, &clock.intrinsics)?] })
    }

    /// Mean distance of the first one's depth from the second one's, as a share of the depth.
    pub fn distance<At>(&self, clock: &Clock<At>, delay: f64) -> f64
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let (mut sum, mut n) = (0.0, 0.0);
        for (_, share) in self.measured(clock, delay) {
            sum += share.min(FARTHEST);
            n += 1.0;
        }
        if n > 0.0 { sum / n } else { FARTHEST }
    }

    /// World points that both measured.
    pub fn common<At>(&self, clock: &Clock<At>, delay: f64) -> Vec<DVec3>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let measured = self.measured(clock, delay).into_iter();
        measured.filter(|(_, share)| *share < FARTHEST).map(|(world, _)| world).collect()
    }

    /// World points of the first one, and how far, as a share of their depth, the second one's are.
    fn measured<At>(&self, clock: &Clock<At>, delay: f64) -> Vec<(DVec3, f64)>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let k = &clock.intrinsics;
        let [from, to] = self
            .shots
            .map(|shot| Strips::new(*k, &clock.at, shot.depth.0 + delay, clock.depth_reading));
        let [a, b] = &self.depths;
        let mut measured = Vec::new();
        for (row, pose) in from.rows() {
            for column in (EVERY / 2..k.width as usize).step_by(EVERY) {
                let Some(z) = trusted(a, column, row) else { continue };
                let world = pose.transform_point(k.ray(column, row) * z);
                let Some([u, v, expected]) = to.seen(world) else { continue };
                let Some(found) = trusted(b, u as usize, v as usize) else { continue };
                measured.push((world, (found - expected).abs() / expected));
            }
        }
        measured
    }
}

fn load(shot: &Shot, k: &Intrinsics) -> Option<Depth> {
    let (_, source) = &shot.depth;
    let size = (k.width, k.height);
    let depth = shot.read(|| decode::depth(&source.file, &source.encoding, size))?;
    (depth.kind == DepthKind::Z).then_some(depth)
}

fn trusted(depth: &Depth, column: usize, row: usize) -> Option<f64> {
    depth.value_at(column, row).filter(|&z| depth.trusts(z))
}
