//! Signed distance functions of the shapes.

use super::solid::Shape;
use glam::{DVec2, DVec3};

impl Shape {
    /// Signed distance of a point from the surface, metres. Negative inside a solid; for a shell, negative
    /// outside the room.
    pub fn distance(&self, point: DVec3) -> f64 {
        match *self {
            Self::Block { lo, hi } => box_distance(point, lo, hi),
            Self::Shell { lo, hi } => (point - lo).min(hi - point).min_element(),
            Self::Sphere { centre, radius } => (point - centre).length() - radius,
            Self::Cylinder { base, radius, height } => {
                let p = point - base;
                let off = DVec2::new(p.truncate().length() - radius, (-p.z).max(p.z - height));
                off.max(DVec2::ZERO).length() + off.max_element().min(0.0)
            }
            Self::Torus { centre, major, minor } => {
                let p = point - centre;
                DVec2::new(p.truncate().length() - major, p.z).length() - minor
            }
            Self::Cable(capsule) => capsule.distance(point),
        }
    }
}

fn box_distance(point: DVec3, lo: DVec3, hi: DVec3) -> f64 {
    let off = (lo - point).max(point - hi);
    off.max(DVec3::ZERO).length() + off.max_element().min(0.0)
}
