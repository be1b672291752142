//! Capsule (straight cable at any angle): all points within a radius of a line segment.

use glam::{DVec2, DVec3};
use std::f64::consts::TAU;

/// Axis end points and radius, metres.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Capsule {
    pub from: DVec3,
    pub to: DVec3,
    pub radius: f64,
}

impl Capsule {
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.from.min(self.to) - self.radius, self.from.max(self.to) + self.radius)
    }

    /// Returns the ray parameter `t > start` of the first entry into the capsule.
    pub fn first_entry(&self, origin: DVec3, direction: DVec3, start: f64) -> Option<f64> {
        let middle = 0.5 * (self.from + self.to);
        let around = 0.5 * (self.to - self.from).length() + self.radius;
        // Early out: most rays miss the bounding sphere, which is cheaper to test.
        enter_ball(origin - middle, direction, around)?;
        let side = self.enter_side(origin, direction);
        let ends = [self.from, self.to].map(|end| enter_ball(origin - end, direction, self.radius));
        // The capsule is the union of a cylinder and two spheres: the first entry is the smallest of three.
        let all = std::iter::once(side).chain(ends).flatten();
        all.min_by(f64::total_cmp).filter(|t| *t > start)
    }

    fn enter_side(&self, origin: DVec3, direction: DVec3) -> Option<f64> {
        let (axis, length) = self.axis();
        let o = origin - self.from;
        let flat = |v: DVec3| v - axis * v.dot(axis);
        let (across, aside) = (flat(direction), flat(o));
        let (a, b) = (across.length_squared(), across.dot(aside));
        let discriminant = b * b - a * (aside.length_squared() - self.radius * self.radius);
        if a <= 0.0 || discriminant < 0.0 {
            return None;
        }
        let t = (-b - discriminant.sqrt()) / a;
        let along = (o + direction * t).dot(axis);
        (0.0..=length).contains(&along).then_some(t)
    }

    /// Signed distance of a point from the surface, metres; negative inside.
    pub fn distance(&self, point: DVec3) -> f64 {
        (point - self.nearest_axis_point(point)).length() - self.radius
    }

    pub fn normal(&self, point: DVec3) -> DVec3 {
        (point - self.nearest_axis_point(point)).normalize_or(DVec3::Z)
    }

    /// Surface coordinates in `[0, 1]²`: angle about the axis, and position along it including the caps.
    pub fn chart(&self, point: DVec3) -> DVec2 {
        let ((axis, length), (u, v)) = (self.axis(), self.perpendicular_axes());
        let p = point - self.from;
        let angle = p.dot(v).atan2(p.dot(u)) / TAU + 0.5;
        DVec2::new(angle, (p.dot(axis) + self.radius) / (length + 2.0 * self.radius))
    }

    /// Returns the surface point at chart coordinates.
    pub fn point(&self, uv: DVec2) -> DVec3 {
        let ((axis, length), (u, v)) = (self.axis(), self.perpendicular_axes());
        let along = uv.y * (length + 2.0 * self.radius) - self.radius;
        let beyond = along - along.clamp(0.0, length);
        let ring = (self.radius * self.radius - beyond * beyond).max(0.0).sqrt();
        let around = DVec2::from_angle((uv.x - 0.5) * TAU) * ring;
        self.from + axis * along + u * around.x + v * around.y
    }

    pub fn face_size(&self) -> DVec2 {
        DVec2::new(TAU * self.radius, self.axis().1 + 2.0 * self.radius)
    }

    fn axis(&self) -> (DVec3, f64) {
        let way = self.to - self.from;
        (way.normalize_or(DVec3::Z), way.length())
    }

    fn perpendicular_axes(&self) -> (DVec3, DVec3) {
        self.axis().0.any_orthonormal_pair()
    }

    fn nearest_axis_point(&self, point: DVec3) -> DVec3 {
        let (axis, length) = self.axis();
        self.from + axis * (point - self.from).dot(axis).clamp(0.0, length)
    }
}

fn enter_ball(o: DVec3, direction: DVec3, radius: f64) -> Option<f64> {
    let (a, b) = (direction.length_squared(), o.dot(direction));
    let discriminant = b * b - a * (o.length_squared() - radius * radius);
    (discriminant >= 0.0).then(|| (-b - discriminant.sqrt()) / a)
}
