//! Shapes with exact ray intersections (closed-form; torus iterative) and charts for light and texture.
//!
//! Ray directions need not be unit vectors. A pixel's ray has z = 1 in the camera frame. So `t` is the
//! depth along the optical axis, without the rounding of a conversion. The torus is sphere traced, then
//! refined by Newton's method, so its depth is exact to rounding as well.

use glam::{DVec2, DVec3};
use std::f64::consts::{PI, TAU};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Shape {
    /// Axis-aligned box, seen from outside.
    Block {
        lo: DVec3,
        hi: DVec3,
    },
    /// Axis-aligned box, seen from inside, such as a room.
    Shell {
        lo: DVec3,
        hi: DVec3,
    },
    Sphere {
        centre: DVec3,
        radius: f64,
    },
    /// Upright cylinder with a lid; `base` is the centre of its base.
    Cylinder {
        base: DVec3,
        radius: f64,
        height: f64,
    },
    /// Torus in a horizontal plane.
    Torus {
        centre: DVec3,
        major: f64,
        minor: f64,
    },
    Cable(Capsule),
}

/// Ray. Its parameter `t` is in units of `direction`, which need not be a unit vector.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ray {
    pub origin: DVec3,
    pub direction: DVec3,
    /// Component-wise `1 / direction`; infinite where the component is zero.
    pub inverse: DVec3,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Hit {
    pub t: f64,
    /// Index of the face (chart) of the shape that was hit.
    pub face: usize,
}

/// Minimum ray parameter of a hit. Nearer hits belong to the surface on which the ray starts.
const START: f64 = 1e-6;

impl Ray {
    pub fn new(origin: DVec3, direction: DVec3) -> Self {
        Self { origin, direction, inverse: direction.recip() }
    }

    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

impl Shape {
    pub fn n_faces(&self) -> usize {
        match self {
            Self::Block { .. } | Self::Shell { .. } => 6,
            Self::Cylinder { .. } => 2,
            Self::Sphere { .. } | Self::Torus { .. } | Self::Cable(_) => 1,
        }
    }

    pub fn bounds(&self) -> (DVec3, DVec3) {
        match *self {
            Self::Block { lo, hi } | Self::Shell { lo, hi } => (lo, hi),
            Self::Sphere { centre, radius } => (centre - radius, centre + radius),
            Self::Cylinder { base, radius, height } => {
                let side = DVec3::new(radius, radius, 0.0);
                (base - side, base + side + DVec3::Z * height)
            }
            Self::Torus { centre, major, minor } => {
                let half = DVec3::new(major + minor, major + minor, minor);
                (centre - half, centre + half)
            }
            Self::Cable(capsule) => capsule.bounds(),
        }
    }

    #[inline]
    pub fn intersect(&self, ray: &Ray) -> Option<Hit> {
        match *self {
            Self::Block { lo, hi } => {
                let (near, far, axis) = slabs(ray, lo, hi, true);
                (near <= far && near > START).then(|| box_hit(ray, near, axis, true))
            }
            Self::Shell { lo, hi } => {
                let (near, far, axis) = slabs(ray, lo, hi, false);
                (near <= far && far > START).then(|| box_hit(ray, far, axis, false))
            }
            Self::Sphere { centre, radius } => {
                // The exit is ignored: balls are solid, and cameras are in free space.
                let (t, _) = sphere_span(ray.origin - centre, ray.direction, radius)?;
                (t > START).then_some(Hit { t, face: 0 })
            }
            Self::Cylinder { base, radius, height } => cylinder(ray, base, radius, height),
            Self::Torus { centre, major, minor } => torus(ray, centre, major, minor),
            Self::Cable(capsule) => {
                let enter = capsule.first_entry(ray.origin, ray.direction, START);
                enter.map(|t| Hit { t, face: 0 })
            }
        }
    }

    /// Returns the unit normal at a surface point. It points outward, for a shell inward.
    pub fn normal(&self, point: DVec3, face: usize) -> DVec3 {
        match *self {
            Self::Block { .. } => axis_normal(face),
            Self::Shell { .. } => -axis_normal(face),
            Self::Sphere { centre, .. } => (point - centre).normalize(),
            Self::Cylinder { base, .. } => match face {
                0 => (point - base).with_z(0.0).normalize(),
                _ => DVec3::Z,
            },
            Self::Torus { centre, major, .. } => {
                let p = point - centre;
                (p - p.with_z(0.0).normalize() * major).normalize()
            }
            Self::Cable(capsule) => capsule.normal(point),
        }
    }

    /// Returns the chart (texture) coordinates of a surface point, in `[0, 1]²`.
    #[inline]
    pub fn chart(&self, point: DVec3, face: usize) -> DVec2 {
        // Offset by half a turn, so the chart runs from 0 to 1 with its seam at −x.
        let angle = |x: f64, y: f64| y.atan2(x) / TAU + 0.5;
        match *self {
            Self::Block { lo, hi } | Self::Shell { lo, hi } => {
                let (u, v) = plane_axes(face);
                let unit = (point - lo) / (hi - lo);
                DVec2::new(unit[u], unit[v])
            }
            Self::Sphere { centre, radius } => {
                let p = (point - centre) / radius;
                DVec2::new(angle(p.x, p.y), 0.5 * (p.z + 1.0))
            }
            Self::Cylinder { base, radius, height } => {
                let p = point - base;
                match face {
                    0 => DVec2::new(angle(p.x, p.y), p.z / height),
                    _ => (p.truncate() / radius + 1.0) * 0.5,
                }
            }
            Self::Torus { centre, major, minor } => {
                let p = point - centre;
                let out = p.truncate().length() - major;
                DVec2::new(angle(p.x, p.y), angle(out / minor, p.z / minor))
            }
            Self::Cable(capsule) => capsule.chart(point),
        }
    }

    /// Returns the surface point at chart coordinates (inverse of [`Shape::chart`]).
    pub fn point(&self, uv: DVec2, face: usize) -> DVec3 {
        let around = |u: f64| DVec2::from_angle((u - 0.5) * TAU);
        match *self {
            Self::Block { lo, hi } | Self::Shell { lo, hi } => {
                let (u, v) = plane_axes(face);
                let mut unit = DVec3::splat((face % 2) as f64);
                unit[u] = uv.x;
                unit[v] = uv.y;
                lo + unit * (hi - lo)
            }
            Self::Sphere { centre, radius } => {
                let z = 2.0 * uv.y - 1.0;
                // Rounding may make the square negative at the poles.
                let ring = around(uv.x) * (1.0 - z * z).max(0.0).sqrt();
                centre + ring.extend(z) * radius
            }
            Self::Cylinder { base, radius, height } => match face {
                0 => base + (around(uv.x) * radius).extend(uv.y * height),
                _ => base + ((uv * 2.0 - 1.0) * radius).extend(height),
            },
            Self::Torus { centre, major, minor } => {
                let tube = around(uv.y) * minor;
                centre + (around(uv.x) * (major + tube.x)).extend(tube.y)
            }
            Self::Cable(capsule) => capsule.point(uv),
        }
    }

    /// Returns the size of a chart along its two directions, metres.
    pub fn face_size(&self, face: usize) -> DVec2 {
        match *self {
            Self::Block { lo, hi } | Self::Shell { lo, hi } => {
                let (u, v) = plane_axes(face);
                DVec2::new((hi - lo)[u], (hi - lo)[v])
            }
            Self::Sphere { radius, .. } => DVec2::new(TAU * radius, PI * radius),
            Self::Cylinder { radius, height, .. } => match face {
                0 => DVec2::new(TAU * radius, height),
                _ => DVec2::splat(2.0 * radius),
            },
            Self::Torus { major, minor, .. } => DVec2::new(TAU * major, TAU * minor),
            Self::Cable(capsule) => capsule.face_size(),
        }
    }
}

/// Returns the axes that span a box face. The index of a face is `2·axis`, plus 1 for the side of higher
/// coordinates.
fn plane_axes(face: usize) -> (usize, usize) {
    match face / 2 {
        0 => (1, 2),
        1 => (0, 2),
        _ => (0, 1),
    }
}

fn axis_normal(face: usize) -> DVec3 {
    let sign = if face % 2 == 1 { 1.0 } else { -1.0 };
    sign * [DVec3::X, DVec3::Y, DVec3::Z][face / 2]
}

/// Slab test: returns the ray parameters of the entry into a box and of the exit. Also returns the axis
/// of the entry plane if `want_entry`, otherwise that of the exit plane.
#[inline]
fn slabs(ray: &Ray, lo: DVec3, hi: DVec3, want_entry: bool) -> (f64, f64, usize) {
    // An axis that the ray does not move along gives ±∞, which bounds neither entry nor exit.
    let a = (lo - ray.origin) * ray.inverse;
    let b = (hi - ray.origin) * ray.inverse;
    let (enter, leave) = (a.min(b), a.max(b));
    let (near, far) = (enter.max_element(), leave.min_element());
    let (list, value) = if want_entry { (enter, near) } else { (leave, far) };
    // Compared exactly: `value` is one of the three.
    let axis = if list.x == value {
        0
    } else if list.y == value {
        1
    } else {
        2
    };
    (near, far, axis)
}

/// Returns the hit with its face. A ray that ascends along an axis enters at the low side and leaves at
/// the high side.
fn box_hit(ray: &Ray, t: f64, axis: usize, is_entry: bool) -> Hit {
    let high = (ray.direction[axis] > 0.0) != is_entry;
    Hit { t, face: 2 * axis + usize::from(high) }
}

/// Returns the ray parameters of the entry into a sphere and of the exit. `o` is the ray's origin
/// relative to the centre.
fn sphere_span(o: DVec3, direction: DVec3, radius: f64) -> Option<(f64, f64)> {
    let (a, b) = (direction.length_squared(), o.dot(direction));
    let discriminant = b * b - a * (o.length_squared() - radius * radius);
    let root = discriminant.sqrt();
    (discriminant >= 0.0).then(|| ((-b - root) / a, (-b + root) / a))
}

fn cylinder(ray: &Ray, base: DVec3, radius: f64, height: f64) -> Option<Hit> {
    let o = ray.origin - base;
    let (d, flat) = (ray.direction, o.truncate());
    let mut best = None;
    let a = d.truncate().length_squared();
    let b = flat.dot(d.truncate());
    let discriminant = b * b - a * (flat.length_squared() - radius * radius);
    // A vertical ray never meets the side.
    if a > 0.0 && discriminant >= 0.0 {
        let t = (-b - discriminant.sqrt()) / a;
        let z = o.z + t * d.z;
        if t > START && (0.0..=height).contains(&z) {
            best = Some(Hit { t, face: 0 });
        }
    }
    // Only the lid, from above: every cylinder has its base on another surface.
    if d.z < 0.0 && o.z > height {
        let t = (height - o.z) / d.z;
        let at = flat + d.truncate() * t;
        if t > START && at.length_squared() <= radius * radius {
            // A ray that meets the lid enters the side's infinite cylinder above it, so no side hit
            // is nearer.
            best = Some(Hit { t, face: 1 });
        }
    }
    best
}

/// Intersects a ray with a torus. Sphere tracing approaches the surface to 1 µm, then Newton's method
/// refines the hit to rounding errors.
fn torus(ray: &Ray, centre: DVec3, major: f64, minor: f64) -> Option<Hit> {
    const CLOSE: f64 = 1e-6;
    const STEPS: usize = 96;
    // The march is bounded by this sphere, which most rays miss.
    let (enter, leave) = sphere_span(ray.origin - centre, ray.direction, major + minor)?;
    let speed = ray.direction.length();
    let distance = |t: f64| {
        let p = ray.at(t) - centre;
        DVec2::new(p.truncate().length() - major, p.z).length() - minor
    };
    let mut t = enter.max(START);
    for _ in 0..STEPS {
        let d = distance(t);
        if d < CLOSE {
            // Each step doubles the correct digits: from 1 µm, three exhaust f64.
            for _ in 0..3 {
                let p = ray.at(t) - centre;
                let normal = (p - p.with_z(0.0).normalize() * major).normalize();
                let rate = normal.dot(ray.direction);
                // A Newton step diverges where the ray is tangent to the ring.
                if rate.abs() > 1e-3 * speed {
                    t -= distance(t) / rate;
                }
            }
            return (t > START).then_some(Hit { t, face: 0 });
        }
        // Distance is in metres, `t` in lengths of the direction.
        t += d / speed;
        if t > leave {
            return None;
        }
    }
    None
}

impl Shape {
    /// Returns the signed distance of a point from the surface, metres. It is negative inside a solid;
    /// for a shell, it is negative outside the room.
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
    // The first term is the distance outside, the second the negative one inside.
    off.max(DVec3::ZERO).length() + off.max_element().min(0.0)
}

/// Capsule (cylinder with hemispherical caps), given by its axis's end points and radius, metres.
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
        sphere_span(origin - middle, direction, around)?;
        let side = self.enter_side(origin, direction);
        let cap = |end: DVec3| Some(sphere_span(origin - end, direction, self.radius)?.0);
        let ends = [self.from, self.to].map(cap);
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
        // A ray along the axis enters through a cap.
        if a <= 0.0 || discriminant < 0.0 {
            return None;
        }
        let t = (-b - discriminant.sqrt()) / a;
        let along = (o + direction * t).dot(axis);
        (0.0..=length).contains(&along).then_some(t)
    }

    pub fn distance(&self, point: DVec3) -> f64 {
        (point - self.nearest_axis_point(point)).length() - self.radius
    }

    pub fn normal(&self, point: DVec3) -> DVec3 {
        // On the axis no direction is the normal; any unit vector avoids NaN.
        (point - self.nearest_axis_point(point)).normalize_or(DVec3::Z)
    }

    /// Returns the surface coordinates of a point, in `[0, 1]²`: angle about the axis, and position
    /// along it including the caps.
    pub fn chart(&self, point: DVec3) -> DVec2 {
        let ((axis, length), (u, v)) = (self.axis(), self.perpendicular_axes());
        let p = point - self.from;
        let angle = p.dot(v).atan2(p.dot(u)) / TAU + 0.5;
        DVec2::new(angle, (p.dot(axis) + self.radius) / (length + 2.0 * self.radius))
    }

    pub fn point(&self, uv: DVec2) -> DVec3 {
        let ((axis, length), (u, v)) = (self.axis(), self.perpendicular_axes());
        let along = uv.y * (length + 2.0 * self.radius) - self.radius;
        let beyond = along - along.clamp(0.0, length);
        // Rounding may make the square negative at the tips.
        let ring = (self.radius * self.radius - beyond * beyond).max(0.0).sqrt();
        let around = DVec2::from_angle((uv.x - 0.5) * TAU) * ring;
        self.from + axis * along + u * around.x + v * around.y
    }

    pub fn face_size(&self) -> DVec2 {
        DVec2::new(TAU * self.radius, self.axis().1 + 2.0 * self.radius)
    }

    fn axis(&self) -> (DVec3, f64) {
        let way = self.to - self.from;
        // A capsule of length zero is a sphere, for which any axis serves.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    const SHAPES: [Shape; 6] = [
        Shape::Block { lo: DVec3::new(-0.3, -0.2, 0.1), hi: DVec3::new(0.5, 0.3, 0.6) },
        Shape::Shell { lo: DVec3::new(-4.0, -4.0, -4.0), hi: DVec3::new(4.0, 4.0, 4.0) },
        Shape::Sphere { centre: DVec3::new(0.1, 0.2, 0.3), radius: 0.4 },
        Shape::Cylinder { base: DVec3::new(0.1, 0.0, -0.2), radius: 0.3, height: 0.7 },
        Shape::Torus { centre: DVec3::new(0.0, 0.1, 0.2), major: 0.5, minor: 0.15 },
        Shape::Cable(Capsule {
            from: DVec3::new(-0.3, 0.1, -0.2),
            to: DVec3::new(0.4, 0.3, 0.3),
            radius: 0.2,
        }),
    ];

    #[test]
    fn hits_lie_on_the_surface_and_charts_invert() {
        let mut rng = Rng::new(1, Purpose::Synthetic, 0);
        for shape in SHAPES {
            let mut n_hits = 0;
            for _ in 0..2000 {
                let mut random = |s: f64| DVec3::from_array([(); 3].map(|()| rng.range(-s, s)));
                let origin = random(1.0).normalize_or(DVec3::X) * 2.0;
                let ray = Ray::new(origin, random(0.6) - origin);
                let Some(hit) = shape.intersect(&ray) else { continue };
                n_hits += 1;
                let point = ray.at(hit.t);
                let uv = shape.chart(point, hit.face);
                let back = shape.point(uv, hit.face);
                assert!((back - point).length() < 1e-6, "{shape:?}: {point} and {back}");
                assert!(shape.distance(point).abs() < 1e-9, "{shape:?}: {point}");
                let facing = shape.normal(point, hit.face).dot(ray.direction);
                assert!(facing < 1e-6, "{shape:?}: a visible surface faces the ray");
                let (lo, hi) = shape.bounds();
                assert!((point - lo).min_element() > -1e-9 && (hi - point).min_element() > -1e-9);
            }
            assert!(n_hits > 300, "{shape:?} was hit {n_hits} times");
        }
    }
}
