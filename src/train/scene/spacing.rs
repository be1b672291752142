//! How far a point may be from its seed: the structural scale, and less where a view comes near enough to
//! tell smaller things apart (`scene.md`, Near detail).

use crate::model::scene::state::WHOLE;
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
}

impl Spacing {
    /// The structural scale `h`, world units, everywhere or as `near` says.
    pub fn new(h: f64, near: Option<NearSpacing>) -> Self {
        Self { h: h as f32, near }
    }

    /// The structural scale, world units.
    pub fn h(self) -> f32 {
        self.h
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
