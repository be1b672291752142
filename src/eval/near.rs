//! Near plane of evaluated views, adapted to the scale of the scene.

use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatView;
use crate::render::{EVALUATION_NEAR, near_plane_for};
use crate::train::setting::Preset;
use glam::DVec3;

/// Maximum number of views that are sampled, evenly spaced. The next constant limits the splats per
/// view.
const VIEWS: usize = 16;
const SPLATS: usize = 4096;
/// Fraction of splats allowed in front of the reference depth. The near plane is derived from that
/// depth.
const NEARER: f64 = 0.02;

/// Rule for the near plane of evaluated views.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NearRule {
    /// Near plane from [`near_plane_for`], for a depth that nearly all splats in view exceed.
    Following,
    /// The published near plane, [`EVALUATION_NEAR`]. If half of the splats in view are so near that the
    /// world unit cannot be metres, it is replaced. The replacement is the result of [`near_plane_for`]
    /// for their median depth.
    Published,
}

impl NearRule {
    /// Returns the rule for models of a preset. Models without a known preset are treated as
    /// unpublished.
    pub fn of(preset: Option<Preset>) -> Self {
        match preset {
            Some(Preset::Paper) => Self::Published,
            Some(Preset::Scene) | None => Self::Following,
        }
    }
}

/// Returns the near plane for views by the given cameras, world units. Returns [`EVALUATION_NEAR`] if no
/// splats are in view.
pub fn near_plane(splats: SplatView<'_>, cameras: &[Camera], rule: NearRule) -> f64 {
    // At least 1: a step of 0 would panic for an empty model.
    let every = |n: usize, most: usize| n.div_ceil(most).max(1);
    let splats = splats.splats();
    let mut depths = Vec::new();
    for camera in cameras.iter().step_by(every(cameras.len(), VIEWS)) {
        let (rotation, translation) = camera.pose.inverse();
        let k = &camera.intrinsics;
        // Splats of opacity 0 are empty slots, and their positions have no meaning.
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
    let mut beyond = |share: f64| {
        // Below the length, because every share is less than 1.
        let at = (depths.len() as f64 * share) as usize;
        near_plane_for(*depths.select_nth_unstable_by(at, f64::total_cmp).1)
    };
    match rule {
        NearRule::Following => beyond(NEARER),
        NearRule::Published => beyond(0.5).min(EVALUATION_NEAR),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;
    use crate::model::splat::splats::Splat;

    #[test]
    fn published_figures_keep_their_near_plane_unless_the_unit_is_another() {
        let intrinsics = Intrinsics::from_horizontal_fov(64, 48, 1.0);
        let cameras = [Camera { intrinsics, pose: Pose::IDENTITY }];
        // A wall from 0.3 to 6 m, in worlds of several units.
        let near = |unit: f32, rule| {
            let splat = |i: u8| {
                let mean = [0.0, 0.0, unit * (0.3 + 0.3 * f32::from(i))];
                Splat { mean, opacity: 0.9, scale: [0.01 * unit; 3], ..Splat::default() }
            };
            let splats: Vec<Splat> = (0..20).map(splat).collect();
            near_plane(SplatView::new(&splats, &[]).unwrap(), &cameras, rule)
        };
        let both = |unit| [NearRule::Following, NearRule::Published].map(|rule| near(unit, rule));
        let is = |found: [f64; 2], expected: [f64; 2]| {
            let apart = |(a, b): (f64, f64)| (a / b - 1.0).abs();
            assert!(found.into_iter().zip(expected).all(|p| apart(p) < 1e-9), "{found:?}");
        };
        is(both(1.0), [0.02, 0.2]);
        is(both(1e-4), [2e-6, 2e-5]);
        is(both(1e4), [200.0, 0.2]);
        assert_eq!(
            near_plane(SplatView::new(&[], &[]).unwrap(), &cameras, NearRule::Published),
            0.2
        );
    }
}
