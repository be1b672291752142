//! What the phone stores of a frame.

use super::exposure::gains;
use super::lidar::{LidarImage, measure};
use super::walk::Walk;
use crate::dataset::synthetic::scene::SyntheticScene;
use crate::dataset::synthetic::view::ToneCurve;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec2, Vec3};

/// First stream of the lidar's noise; frames count up from it.
const LIDAR: u64 = 1 << 40;
/// How long the shutter is open, as a part of the walk.
const SHUTTER: f64 = 0.000_1;
/// Light lost in the corners.
const VIGNETTING: f64 = 0.06;
/// Pixels of motion above which a photograph is a mean of three views, and of five.
const BLURRED: [f64; 2] = [1.2, 4.0];
/// Distance at which motion is judged, metres.
const TYPICAL_DEPTH: f64 = 1.5;
/// Longest side of depth images, and least ratio of photographs to them.
const DEPTH_SIDE: f64 = 256.0;
const LEAST_FACTOR: f64 = 2.0;

/// A frame as it is stored.
pub struct Capture {
    /// sRGB-encoded, opaque.
    pub color: Image<[u8; 4]>,
    /// Metres along the optical axis; 0 in holes.
    pub depth_z: Image<f64>,
    /// 0 to 2.
    pub confidence: Image<u8>,
}

/// The phone on its walk.
#[derive(Clone, Debug)]
pub struct PhoneCamera {
    walk: Walk,
    gains: Vec<f32>,
    seed: u64,
}

impl PhoneCamera {
    pub fn new(walk: Walk, n_frames: usize, seed: u64) -> Self {
        Self { walk, gains: gains(n_frames, seed), seed }
    }

    /// Where a frame is taken from.
    pub fn pose(&self, frame: usize) -> Pose {
        self.walk.handheld(self.part(frame))
    }

    /// Renders a frame; `depth` are the lidar's intrinsics.
    pub fn capture(&self, scene: &SyntheticScene, frame: usize, depth: Intrinsics) -> Capture {
        let mut rng = Rng::new(self.seed, Purpose::Synthetic, LIDAR + frame as u64);
        let camera = Camera { intrinsics: depth, pose: self.pose(frame) };
        let LidarImage { depth_z, confidence } = measure(scene.room(), &camera, &mut rng);
        Capture { color: self.photograph(scene, frame), depth_z, confidence }
    }

    fn part(&self, frame: usize) -> f64 {
        self.walk.part(frame as f64, self.gains.len())
    }

    /// A photograph: the mean light while the shutter is open, times gain and vignetting.
    fn photograph(&self, scene: &SyntheticScene, frame: usize) -> Image<[u8; 4]> {
        let k = scene.intrinsics();
        let poses = self.exposed(frame, &k);
        let mut light = Image::filled(k.width as usize, k.height as usize, Vec3::ZERO);
        for pose in &poses {
            let seen = scene.radiance(&Camera { intrinsics: k, pose: *pose });
            light.data.iter_mut().zip(&seen.data).for_each(|(sum, seen)| *sum += *seen);
        }
        let gain = self.gains.get(frame).copied().unwrap_or(1.0) / poses.len() as f32;
        let tone = ToneCurve::new();
        let (width, centre) = (light.width, DVec2::new(k.cx, k.cy));
        let developed = light.data.iter().enumerate().map(|(i, light)| {
            let pixel = DVec2::new((i % width) as f64, (i / width) as f64);
            let from_centre = (pixel + 0.5 - centre).length_squared() / centre.length_squared();
            tone.pixel(*light * (gain * (1.0 - VIGNETTING * from_centre) as f32))
        });
        Image::from_vec(width, light.height, developed.collect())
    }

    /// Poses while the shutter is open: one where the phone hardly moves, else three or five.
    fn exposed(&self, frame: usize, k: &Intrinsics) -> Vec<Pose> {
        let middle = self.part(frame);
        let at = |moment: f64| self.walk.handheld(middle + SHUTTER * (moment - 0.5));
        let moved = motion(&at(0.0), &at(1.0), k);
        let n = match BLURRED.iter().filter(|least| moved > **least).count() {
            0 => return vec![at(0.5)],
            1 => 3,
            _ => 5,
        };
        (0..n).map(|i| at((i as f64 + 0.5) / f64::from(n))).collect()
    }
}

/// Pixels by which the picture moves between two poses.
fn motion(from: &Pose, to: &Pose, k: &Intrinsics) -> f64 {
    let (offset, turn) = from.offset_to(to);
    k.fx * (turn.to_scaled_axis().length() + offset.length() / TYPICAL_DEPTH)
}

/// The lidar's camera: the photograph's lens, 192×256 pixels behind a photograph of 1440×1920.
pub fn depth_camera(k: &Intrinsics) -> Intrinsics {
    let longest = f64::from(k.width.max(k.height));
    k.scaled(1.0 / (longest / DEPTH_SIDE).max(LEAST_FACTOR))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::params::PhoneScene;

    #[test]
    fn fast_frames_are_blurred_and_slow_ones_are_not() {
        let k = Intrinsics::from_horizontal_fov(1440, 1920, 0.873);
        let phone = PhoneCamera::new(Walk::new(PhoneScene::Door, 0), 70, 0);
        let n_views: Vec<usize> = (0..70).map(|i| phone.exposed(i, &k).len()).collect();
        let count = |n: usize| n_views.iter().filter(|found| **found == n).count();
        assert_eq!(count(1) + count(3) + count(5), 70);
        assert!(count(1) > 3 && count(3) > 10, "{n_views:?}");
        let depth = depth_camera(&k);
        assert_eq!([depth.width, depth.height], [192, 256]);
    }
}
