//! Evaluation viewpoints off the camera trajectory that show surfaces the training frames have seen.

use super::params::{ParamsError, PhoneScene, SyntheticCamera};
use super::room::FurnishedRoom;
use super::solid::{Hit, Ray};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec2, DVec3};

const STREAM: u64 = u64::MAX - 5;
/// Minimum distance between a viewpoint and every surface, metres.
const CLEARANCE: f64 = 0.25;
/// Number of rays per image axis for estimating the share of an image that training frames have seen.
const GRID: usize = 9;
/// Share of an image seen by training frames at which the search for a better viewpoint stops.
const ENOUGH_COVERED: f64 = 0.97;
/// Minimum share of a viewpoint's image that training frames have seen; the viewpoint is otherwise
/// invalid.
const LEAST_SEEN: f64 = 0.5;
/// Maximum number of candidates per viewpoint.
const TRIES: usize = 20_000;
/// Number of candidates after which the best valid one is used.
const BETTER: usize = 24;
/// Minimum cosine of the incidence angle at which a surface counts as seen (80°).
const FACING: f64 = 0.17;
/// Maximum distance at which a surface counts as seen, metres.
const NEAR_ENOUGH: f64 = 5.0;

pub(super) struct FreeRules {
    seed: u64,
    /// Range of the distance to the surface at the image centre, metres.
    distance: [f64; 2],
    /// Range of the angle between the viewpoint and the nearest training view, degrees. It is measured
    /// at the surface in the image centre.
    view_angle_degrees: [f64; 2],
}

impl FreeRules {
    pub fn new(camera: SyntheticCamera, seed: u64) -> Self {
        let (distance, view_angle_degrees) = match camera {
            SyntheticCamera::Phone(PhoneScene::Door) => ([0.45, 1.6], [20.0, 60.0]),
            SyntheticCamera::Phone(PhoneScene::Room) | SyntheticCamera::Room => {
                ([0.4, 4.5], [0.0, 180.0])
            }
        };
        Self { seed, distance, view_angle_degrees }
    }
}

/// Chooses `n` viewpoints. `trained` has the intrinsics of the training frames, whose poses are `poses`.
///
/// # Errors
/// Fails if too few viewpoints satisfy `rules`.
pub(super) fn choose(
    n: usize,
    room: &FurnishedRoom,
    trained: Camera,
    poses: &[Pose],
    rules: &FreeRules,
) -> Result<Vec<Pose>, ParamsError> {
    let training = TrainingViews { room, k: trained.intrinsics, poses };
    let mut chosen = Vec::with_capacity(n);
    for i in 0..n {
        // A stream for each view: more views do not change the first ones.
        let mut rng = Rng::new(rules.seed ^ STREAM, Purpose::Synthetic, i as u64);
        match training.free_view(rules, &mut rng) {
            Some(pose) => chosen.push(pose),
            None => {
                return Err(ParamsError {
                    setting: "free frames",
                    expected: "viewpoints in free space that show surfaces seen by the training frames",
                    found: format!("{i} of {n}; record more training frames"),
                });
            }
        }
    }
    Ok(chosen)
}

struct TrainingViews<'a> {
    room: &'a FurnishedRoom,
    k: Intrinsics,
    poses: &'a [Pose],
}

impl TrainingViews<'_> {
    /// Returns the first candidate of which training frames have seen the share [`ENOUGH_COVERED`].
    /// Otherwise returns the best valid candidate, if there is one.
    fn free_view(&self, rules: &FreeRules, rng: &mut Rng) -> Option<Pose> {
        let (mut best, mut n_found) = (None, 0);
        // Candidates with a smaller share never become the best.
        let mut most = LEAST_SEEN;
        for _ in 0..TRIES {
            let Some(pose) = self.candidate(rules, rng) else { continue };
            let share = self.covered_share(&pose);
            if share > most {
                (best, most) = (Some(pose), share);
            }
            n_found += 1;
            if most >= ENOUGH_COVERED || (n_found >= BETTER && best.is_some()) {
                break;
            }
        }
        best
    }

    fn candidate(&self, rules: &FreeRules, rng: &mut Rng) -> Option<Pose> {
        let (target, normal) = self.random_seen_surface(rng)?;
        let (lo, hi) = self.room.bounds();
        let eye = lo + (hi - lo) * DVec3::from_array([(); 3].map(|()| rng.uniform()));
        let way = target - eye;
        let [near, far] = rules.distance;
        let is_near = (near..=far).contains(&way.length());
        // Cheap tests come before rays.
        if !is_near || -normal.dot(way) < FACING * way.length() || !self.is_free(eye) {
            return None;
        }
        if self.room.is_blocked(&Ray::new(eye, way)) {
            return None;
        }
        // Last, since it casts a ray to every training view.
        let aside = self.degrees_to_nearest_view(target, normal, eye)?;
        let [least, most] = rules.view_angle_degrees;
        let pose = Pose::look_at(eye, target, DVec3::Z)?;
        (least..=most).contains(&aside).then_some(pose)
    }

    fn random_seen_surface(&self, rng: &mut Rng) -> Option<(DVec3, DVec3)> {
        let pose = self.poses.get(rng.below(self.poses.len().max(1)))?;
        let (x, y) = (rng.uniform(), rng.uniform());
        let k = &self.k;
        let pixel = DVec2::new(x * f64::from(k.width), y * f64::from(k.height));
        self.cast_pixel(pose, pixel)
    }

    fn cast_pixel(&self, pose: &Pose, pixel: DVec2) -> Option<(DVec3, DVec3)> {
        let k = &self.k;
        let way = DVec3::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy, 1.0);
        let ray = Ray::new(pose.centre(), pose.rotation() * way);
        let hits = self.room.solids.iter().filter_map(|solid| {
            let hit = solid.shape.intersect(&ray)?;
            Some((hit, solid))
        });
        let by_depth = |a: &Hit, b: &Hit| a.t.total_cmp(&b.t);
        let (hit, solid) = hits.min_by(|(a, _), (b, _)| by_depth(a, b))?;
        let point = ray.at(hit.t);
        Some((point, solid.shape.normal(point, hit.face)))
    }

    fn is_free(&self, eye: DVec3) -> bool {
        self.room.solids.iter().all(|solid| solid.shape.distance(eye) > CLEARANCE)
    }

    fn is_visible_from(&self, pose: &Pose, point: DVec3, normal: DVec3) -> bool {
        let way = point - pose.centre();
        let distance = way.length();
        // Without a ray, which costs most.
        if distance > NEAR_ENOUGH || -normal.dot(way) < FACING * distance {
            return false;
        }
        let camera = Camera { intrinsics: self.k, pose: *pose };
        let (pixel, z) = camera.project(point);
        let size = DVec2::new(f64::from(self.k.width), f64::from(self.k.height));
        // Behind the camera the projection is mirrored.
        let is_inside = z > 0.0 && pixel.cmpge(DVec2::ZERO).all() && pixel.cmplt(size).all();
        is_inside && !self.room.is_blocked(&Ray::new(pose.centre(), way))
    }

    fn degrees_to_nearest_view(&self, point: DVec3, normal: DVec3, eye: DVec3) -> Option<f64> {
        let seeing = self.poses.iter().filter(|pose| self.is_visible_from(pose, point, normal));
        let degrees = |pose: &Pose| (eye - point).angle_between(pose.centre() - point).to_degrees();
        seeing.map(degrees).min_by(f64::total_cmp)
    }

    fn covered_share(&self, pose: &Pose) -> f64 {
        let size = DVec2::new(f64::from(self.k.width), f64::from(self.k.height));
        let is_seen = |i: &usize| {
            let cell = DVec2::new((i % GRID) as f64 + 0.5, (i / GRID) as f64 + 0.5);
            self.cast_pixel(pose, cell / GRID as f64 * size).is_some_and(|(point, normal)| {
                self.poses.iter().any(|pose| self.is_visible_from(pose, point, normal))
            })
        };
        let n_seen = (0..GRID * GRID).filter(is_seen).count();
        n_seen as f64 / (GRID * GRID) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::super::phone::contents::furnish;
    use super::super::phone::walk::Walk;
    use super::*;

    #[test]
    fn views_are_free_and_show_what_was_seen() {
        for scene in [PhoneScene::Room, PhoneScene::Door] {
            let rules = FreeRules::new(SyntheticCamera::Phone(scene), 2);
            let (room, walk) = (furnish(scene, 2), Walk::new(scene, 2));
            let poses: Vec<Pose> = (0..30).map(|i| walk.steady(f64::from(i) / 30.0)).collect();
            let k = Intrinsics::from_horizontal_fov(72, 96, 0.873);
            let trained = Camera { intrinsics: k, pose: Pose::IDENTITY };
            let views = choose(8, &room, trained, &poses, &rules).unwrap();
            assert_eq!(views.len(), 8);
            let training = TrainingViews { room: &room, k, poses: &poses };
            let middle = DVec2::new(36.0, 48.0);
            for view in views {
                assert!(training.is_free(view.centre()), "{scene:?}: {}", view.centre());
                assert!(training.covered_share(&view) > LEAST_SEEN);
                let (point, normal) = training.cast_pixel(&view, middle).unwrap();
                let aside = training.degrees_to_nearest_view(point, normal, view.centre()).unwrap();
                let [least, most] = rules.view_angle_degrees;
                assert!((least - 0.1..most + 0.1).contains(&aside), "{scene:?}: {aside} degrees");
            }
            assert!(choose(1, &room, trained, &[], &rules).is_err(), "no training frames");
        }
    }
}
