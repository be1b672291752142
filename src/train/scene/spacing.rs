//! Maximum distance of points from their seeds: the structural scale, less in close views that resolve more
//! detail (`scene.md`, Near detail), more along the ray if depth is noisy (`scene.md`, Ray search).

use crate::model::scene::state::WHOLE;
use crate::model::scene::sums::MAX_OFFSET;
use crate::observation::surface::SurfacePoint;
use serde::{Deserialize, Serialize};

/// Denser seeds in close views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct NearSpacing {
    /// Maximum distance of a point from its seed, in pixels of its view.
    pub pixels: f64,
    /// Minimum share of the structural scale.
    pub least: f64,
}

impl NearSpacing {
    /// Values for rooms (`scene.md`, Near detail).
    pub const ROOM: Self = Self { pixels: 10.0, least: 0.65 };
}

/// Maximum distance of points from their seeds.
#[derive(Clone, Copy, Debug)]
pub struct Spacing {
    h: f32,
    near: Option<NearSpacing>,
    /// Length of the ray search, in half-widths of depth noise.
    along_rays: f32,
}

impl Spacing {
    /// Creates a spacing of `h` world units, reduced in close views according to `near`.
    pub fn new(h: f64, near: Option<NearSpacing>) -> Self {
        Self { h: h as f32, near, along_rays: 0.0 }
    }

    /// Adds a search along the rays of points without a seed, as far as the given number of half-widths of
    /// their depth noise.
    pub fn with_ray_search(self, half_widths: f64) -> Self {
        Self { along_rays: half_widths as f32, ..self }
    }

    /// Returns the structural scale, world units.
    pub fn h(self) -> f32 {
        self.h
    }

    /// True if points without a seed are searched along their rays.
    pub fn searches_rays(self) -> bool {
        self.along_rays > 0.0
    }

    /// Returns how far along its ray, in either direction, a point may find its surface, world units.
    #[inline(always)]
    pub fn reach_along_ray(self, point: &SurfacePoint) -> f32 {
        // Limited by the maximum offset in sums.
        (self.along_rays * point.noise).min((MAX_OFFSET - 1.0) * self.h)
    }

    /// True if the spacing is uniform.
    pub fn is_uniform(self) -> bool {
        self.near.is_none()
    }

    /// Returns the share of the structural scale that a point may be from its seed, in units of 1/[`WHOLE`].
    #[inline(always)]
    pub fn share(self, point: &SurfacePoint) -> u8 {
        self.near.map_or(WHOLE, |near| {
            let share = near.pixels as f32 * point.footprint / self.h;
            let parts = (share.clamp(near.least as f32, 1.0) * f32::from(WHOLE)).ceil();
            // At least one part, even for invalid numbers: a component must represent some surface.
            parts.max(1.0) as u8
        })
    }

    /// Returns the maximum distance of a point from its seed, world units.
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
