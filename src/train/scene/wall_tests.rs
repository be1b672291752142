//! Tests of pose correction on a flat wall that fills the picture, with few components.

use super::config::SceneConfig;
use super::trainer::SceneTrainer;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use crate::observation::surface::{DepthTolerance, Observation, SurfacePoint};
use glam::{DQuat, DVec3};

/// Distance of the wall along the first world axis, which is its normal, metres.
const DISTANCE: f64 = 1.2;

/// Standard deviations of recorded positions, metres, and rotations, radians, per axis.
const ERRORS: [f64; 2] = [0.002, 0.0024];
const FRAMES: usize = 24;

/// Texture of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Paint {
    Pattern,
    /// Parallel lines; motion along the lines is undetermined.
    Stripes,
    /// A gradual change of brightness only.
    Plain,
    /// One panel on a plain wall.
    Door,
}

impl Paint {
    fn color(self, y: f64, z: f64) -> DVec3 {
        let panel = |y: f64, z: f64| {
            let edge = |d: f64| 1.0 / (1.0 + (-d / 0.006).exp());
            edge(0.25 - (y - 0.1).abs()) * edge(0.35 - (z + 0.05).abs())
        };
        match self {
            Self::Pattern => {
                let wave = DVec3::new(17.0 * y + 9.0 * z, 23.0 * z - 5.0 * y, 31.0 * (y + z));
                DVec3::splat(0.5) + 0.25 * wave.map(f64::sin)
            }
            Self::Stripes => DVec3::new(0.6, 0.5, 0.4) + 0.2 * (21.0 * z).sin(),
            Self::Plain => DVec3::new(0.6, 0.5, 0.4) * (1.0 + 0.1 * y),
            Self::Door => DVec3::new(0.6, 0.5, 0.4) * (1.0 - 0.3 * panel(y, z)) * (1.0 + 0.1 * y),
        }
    }
}

#[derive(Clone, Copy)]
struct Wall {
    paint: Paint,
    /// Columns of the depth image.
    columns: u32,
    /// Half-width of the depth noise, metres.
    noise: f64,
    /// Standard deviations of recorded positions, metres, and rotations, radians, per axis.
    errors: [f64; 2],
    seed: u64,
}

const PHONE: Wall =
    Wall { paint: Paint::Pattern, columns: 96, noise: 0.01, errors: ERRORS, seed: 0 };

impl Wall {
    fn real(i: usize) -> Pose {
        let a = 0.3 * i as f64;
        let eye = DVec3::new(0.1 * (0.7 * a).sin(), 0.3 * a.sin(), 0.2 * (1.3 * a).cos());
        let target = DVec3::new(DISTANCE, 0.2 * (1.1 * a).sin(), 0.1 * (0.9 * a).cos());
        Pose::look_at(eye, target, DVec3::Z).unwrap()
    }

    /// Returns the recorded pose of frame `i`. Half of its error drifts slowly; the other half is
    /// independent per frame.
    fn recorded(&self, i: usize) -> Pose {
        let mut fast = Rng::new(self.seed, Purpose::Synthetic, i as u64);
        let mut slow = Rng::new(self.seed, Purpose::Init, 0);
        let [shift, turn] = self.errors.map(|deviation| {
            DVec3::from_array([0; 3].map(|_| {
                let phase = slow.range(0.0, 6.3);
                let drift = (0.25 * i as f64 + phase).sin();
                deviation * (drift + fast.normal() / 2f64.sqrt())
            }))
        });
        Self::real(i).attached_camera(shift, DQuat::from_scaled_axis(turn))
    }

    fn frame(&self, i: usize) -> Observation {
        let mut rng = Rng::new(self.seed, Purpose::Reassign, i as u64);
        let intrinsics = Intrinsics::from_horizontal_fov(self.columns, 3 * self.columns / 4, 1.1);
        let (real, pose) = (Self::real(i), self.recorded(i));
        let exposure = 1.0 + 0.08 * (0.9 * i as f64).sin();
        let (width, height) = (intrinsics.width as usize, intrinsics.height as usize);
        let mut ranges = Image::filled(width, height, f32::NAN);
        let normal = real.rotation().transpose() * DVec3::NEG_X;
        let point = |pixel: usize| {
            let (u, v) = ((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5);
            let ray = DVec3::new(
                (u - intrinsics.cx) / intrinsics.fx,
                (v - intrinsics.cy) / intrinsics.fy,
                1.0,
            )
            .normalize();
            let t = (DISTANCE - real.centre().x) / (real.rotation() * ray).x;
            let seen = real.transform_point(t * ray);
            let noise = DVec3::new(rng.normal(), rng.normal(), rng.normal());
            let color = exposure * (self.paint.color(seen.y, seen.z) + 0.02 * noise);
            let range = t + 0.4 * self.noise * rng.normal();
            ranges.data[pixel] = range as f32;
            let tilt = 0.05 * DVec3::new(rng.normal(), rng.normal(), rng.normal());
            SurfacePoint {
                position: pose.transform_point(range * ray).as_vec3().to_array(),
                range: range as f32,
                color: color.clamp(DVec3::ZERO, DVec3::ONE).as_vec3().to_array(),
                noise: self.noise as f32,
                normal: (pose.rotation() * (normal + tilt).normalize()).as_vec3().to_array(),
                footprint: (range / intrinsics.fx) as f32,
                direction: (pose.rotation() * ray).as_vec3().to_array(),
                pixel: pixel as u32,
            }
        };
        let points = (0..width * height).map(point).collect();
        Observation {
            camera: Camera { intrinsics, pose },
            points,
            ranges,
            tolerance: DepthTolerance { margin: [0.03, 0.02], refinement: 0.03, place: 0.03 },
            ..Observation::empty()
        }
    }
}

/// Returns the root mean square errors of positions (metres) and rotations (radians), after removing the mean
/// error of all frames.
fn errors(poses: &[Pose]) -> [f64; 2] {
    let n = poses.len() as f64;
    let offs = poses.iter().enumerate().map(|(i, pose)| {
        let real = Wall::real(i);
        let turn = DQuat::from_mat3(&(pose.rotation() * real.rotation().transpose()));
        [pose.centre() - real.centre(), turn.normalize().to_scaled_axis()]
    });
    let offs: Vec<[DVec3; 2]> = offs.collect();
    [0, 1].map(|part| {
        let mean = offs.iter().map(|off| off[part]).sum::<DVec3>() / n;
        (offs.iter().map(|off| (off[part] - mean).length_squared()).sum::<f64>() / n).sqrt()
    })
}

fn train(trainer: &mut SceneTrainer, wall: &Wall, frames: usize) {
    for i in 0..frames {
        trainer.train(&wall.frame(i));
    }
}

/// Trains on the wall. Returns the errors of the recorded poses and of the poses found by training.
fn before_and_after(wall: &Wall, h: f64) -> [[f64; 2]; 2] {
    let mut trainer = SceneTrainer::new(&SceneConfig::coarse(h), DVec3::ZERO);
    train(&mut trainer, wall, FRAMES);
    let state = trainer.state();
    assert!((50..400).contains(&state.seeds.len()), "{} components", state.seeds.len());
    let recorded: Vec<Pose> = (0..FRAMES).map(|i| wall.recorded(i)).collect();
    let found: Vec<Pose> = state.poses.iter().map(|frame| frame.poses().unwrap()[1]).collect();
    [errors(&recorded), errors(&found)]
}

#[test]
fn paint_and_planes_correct_poses_by_few_components() {
    for (paint, seed) in [Paint::Pattern, Paint::Door].into_iter().zip([0, 1]) {
        let [recorded, found] = before_and_after(&Wall { paint, seed, ..PHONE }, 0.1);
        let [shift, turn] = if paint == Paint::Pattern { [0.65, 0.5] } else { [0.9, 0.75] };
        assert!(found[0] < shift * recorded[0] && found[1] < turn * recorded[1], "{found:?}");
    }
}

#[test]
fn motions_that_a_wall_leaves_open_stay_as_recorded() {
    for paint in [Paint::Plain, Paint::Stripes] {
        for columns in [PHONE.columns, 28] {
            let wall = Wall { paint, columns, ..PHONE };
            let [recorded, found] = before_and_after(&wall, 0.1);
            assert!(found[0] <= recorded[0] && found[1] < 0.8 * recorded[1], "{found:?}");
        }
        let wall = Wall { paint, errors: [0.0; 2], ..PHONE };
        let [_, found] = before_and_after(&wall, 0.1);
        assert!(found[0] < 0.85 * ERRORS[0] && found[1] < 0.5 * ERRORS[1], "{found:?}");
    }
}

/// A texture too fine for the components must not move poses far from the recorded ones.
#[test]
fn paint_that_is_finer_than_components_moves_nothing_far() {
    for seed in 0..3 {
        let [recorded, found] = before_and_after(&Wall { seed, ..PHONE }, 0.16);
        let most = recorded.map(|error| 1.5 * error);
        assert!(found[0] < most[0] && found[1] < most[1], "{recorded:?} {found:?}");
    }
}

#[test]
fn a_single_frame_stays_as_recorded() {
    let mut trainer = SceneTrainer::new(&SceneConfig::coarse(0.1), DVec3::ZERO);
    trainer.train(&PHONE.frame(0));
    let [recorded, found] = trainer.state().poses[0].poses().unwrap();
    assert!((recorded.centre() - found.centre()).length() < 1e-12);
}

#[test]
fn five_components_correct_nothing() {
    let mut trainer = SceneTrainer::new(&SceneConfig::coarse(0.5), DVec3::ZERO);
    train(&mut trainer, &PHONE, 4);
    let mut frame = PHONE.frame(4);
    frame.points.truncate(20);
    assert_eq!(trainer.motion(&frame), None);
}

#[test]
fn a_wall_is_tracked_by_few_components() {
    let config = SceneConfig { track: true, ..SceneConfig::coarse(0.1) };
    let mut trainer = SceneTrainer::new(&config, DVec3::ZERO);
    train(&mut trainer, &PHONE, 12);
    let found: Vec<Pose> = trainer.state().trajectory.iter().filter_map(|at| at.pose()).collect();
    assert_eq!(found.len(), 12);
    // Alignment to pictures of the scene alone gives ninety millimetres.
    assert!(errors(&found)[0] < 0.01, "{:?}", errors(&found));
}
