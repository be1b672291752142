//! The near plane of measured views, as far away as the scene asks.

use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatView;
use crate::render::{EVALUATION_NEAR, following_near};
use glam::DVec3;

/// Views and splats looked at, evenly spaced.
const VIEWS: usize = 16;
const SPLATS: usize = 4096;
/// Share of the depths of splats in a view that may be nearer than what the near plane follows.
const NEARER: f64 = 0.02;

/// Near plane for views by these cameras, world units: [`following_near`] of the depth that nearly all
/// splats in their pictures are beyond. [`EVALUATION_NEAR`] where they show none.
pub fn near_plane(splats: SplatView<'_>, cameras: &[Camera]) -> f64 {
    let every = |n: usize, most: usize| n.div_ceil(most).max(1);
    let splats = splats.splats();
    let mut depths = Vec::new();
    for camera in cameras.iter().step_by(every(cameras.len(), VIEWS)) {
        let (rotation, translation) = camera.pose.inverse();
        let k = &camera.intrinsics;
        let drawn = splats.iter().filter(|splat| splat.opacity > 0.0);
        for splat in drawn.step_by(every(splats.len(), SPLATS)) {
            let at = rotation * DVec3::from_array(splat.mean.map(f64::from)) + translation;
            let [u, v] = [k.fx * at.x / at.z + k.cx, k.fy * at.y / at.z + k.cy];
            let (width, height) = (f64::from(k.width), f64::from(k.height));
            if at.z > 0.0 && (0.0..width).contains(&u) && (0.0..height).contains(&v) {
                depths.push(at.z);
            }
        }
    }
    if depths.is_empty() {
        return EVALUATION_NEAR;
    }
    let at = (depths.len() as f64 * NEARER) as usize;
    following_near(*depths.select_nth_unstable_by(at, f64::total_cmp).1)
}
