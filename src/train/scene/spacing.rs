//! How far a point may be from its seed: the structural scale, less where a view comes near enough to tell
//! smaller things apart (`scene.md`, Near detail), and more along its ray where depth is noisy (Ray search).

use crate::model::scene::state::WHOLE;
use crate::model::scene::sums::MAX_OFFSET;
use crate::observation::surface::SurfacePoint;
use serde::{Deserialize, Serialize};

/// Seeds closer together where views come near.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NearSpacing {
    /// Largest distance of a point from its seed, pixels of the view that it is from.
    pub pixels: f64,
    /// Least share of the structural scale.
    pub least: f64,
}

impl NearSpacing {
    /// What serves a room (`scene.md`, Near detail).
    pub const ROOM: Self = Self { pixels: 10.0, least: 0.65 };
}

/// How far points may be from their seeds.
#[derive(Clone, Copy, Debug)]
pub struct Spacing {
    h: f32,
    near: Option<NearSpacing>,
    /// Half-widths of its depth's noise that a point may be from its surface along its ray.
    along_rays: f32,
}

impl Spacing {
    /// The structural scale `h`, world units, everywhere or as `near` says.
    pub fn new(h: f64, near: Option<NearSpacing>) -> Self {
        Self { h: h as f32, near, along_rays: 0.0 }
    }

    /// The same where points without a seed look for one along their rays, as far as so many half-widths of
    /// their depth's noise.
    pub fn with_ray_search(self, half_widths: f64) -> Self {
        Self { along_rays: half_widths as f32, ..self }
    }

    /// The structural scale, world units.
    pub fn h(self) -> f32 {
        self.h
    }

    /// Whether points without a seed look for one along their rays.
    pub fn searches_rays(self) -> bool {
        self.along_rays > 0.0
    }

    /// How far from its place along its ray, either way, a point may find its surface, world units.
    #[inline(always)]
    pub fn reach_along_ray(self, point: &SurfacePoint) -> f32 {
        // Sums hold points no farther from their seed than that.
        (self.along_rays * point.noise).min((MAX_OFFSET - 1.0) * self.h)
    }

    /// Whether it is the same everywhere.
    pub fn is_even(self) -> bool {
        self.near.is_none()
    }

    /// The share of the structural scale that a point may be from its seed, in parts of [`WHOLE`].
    #[inline(always)]
    pub fn share(self, point: &SurfacePoint) -> u8 {
        self.near.map_or(WHOLE, |near| {
            let share = near.pixels as f32 * point.footprint / self.h;
            let parts = (share.clamp(near.least as f32, 1.0) * f32::from(WHOLE)).ceil();
            // A component takes up some surface, whatever the numbers.
            parts.max(1.0) as u8
        })
    }

    /// How far a point may be from its seed, world units.
    #[inline(always)]
    pub fn reach(self, point: &SurfacePoint) -> f32 {
        self.h * (f32::from(self.share(point)) / f32::from(WHOLE))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nearer_views_tell_smaller_things_apart() {
        let at = |footprint: f32| SurfacePoint { footprint, ..SurfacePoint::default() };
        let even = Spacing::new(0.035, None);
        assert_eq!([0.0, 0.001, 1.0].map(|f| even.reach(&at(f))), [0.035; 3]);
        let room = Spacing::new(0.036, Some(NearSpacing::ROOM));
        assert_eq!([0.0, 0.002, 0.00269, 0.004].map(|f| room.share(&at(f))), [42, 42, 48, 64]);
        assert!((room.reach(&at(0.00269)) - 0.027).abs() < 1e-6);
        assert_eq!(room.share(&at(f32::NAN)), 1);
    }
}
