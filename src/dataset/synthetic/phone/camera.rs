//! Frames as the phone stores them: photograph, lidar depth and confidence.

use super::lidar::measure;
use super::walk::Walk;
use crate::dataset::synthetic::scene::SyntheticScene;
use crate::dataset::synthetic::view::ToneCurve;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec2, Vec3};

/// Random stream of the lidar noise of the first frame. The frame index is added to it.
const LIDAR: u64 = 1 << 40;
/// Exposure time as a fraction of the duration of the walk.
const SHUTTER: f64 = 0.000_1;
/// Relative light loss in the image corners.
const VIGNETTING: f64 = 0.06;
/// Thresholds of image motion, pixels: above the first, a photograph averages three views; above the
/// second, five.
const BLURRED: [f64; 2] = [1.2, 4.0];
/// Surface depth for which motion blur is estimated, metres.
const TYPICAL_DEPTH: f64 = 1.5;
/// Maximum side of the depth image, pixels.
const DEPTH_SIDE: f64 = 256.0;
/// Minimum ratio of photograph resolution to depth resolution.
const LEAST_FACTOR: f64 = 2.0;

/// Photograph and depth image in the form in which a phone stores them.
pub struct Capture {
    /// Photograph, sRGB-encoded and opaque.
    pub color: Image<[u8; 4]>,
    /// Depth along the optical axis, metres; 0 in holes.
    pub depth_z: Image<f64>,
    /// Confidence code of each depth pixel, 0 to 2.
    pub confidence: Image<u8>,
}

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

    pub fn pose(&self, frame: usize) -> Pose {
        self.walk.shaken_pose(self.walk_parameter(frame))
    }

    pub fn capture(&self, scene: &SyntheticScene, frame: usize, depth: Intrinsics) -> Capture {
        let mut rng = Rng::new(self.seed, Purpose::Synthetic, LIDAR + frame as u64);
        let camera = Camera { intrinsics: depth, pose: self.pose(frame) };
        let (depth_z, confidence) = measure(scene.room(), &camera, &mut rng);
        Capture { color: self.photograph(scene, frame), depth_z, confidence }
    }

    fn walk_parameter(&self, frame: usize) -> f64 {
        self.walk.walk_parameter(frame as f64, self.gains.len())
    }

    /// Renders a photograph as the mean radiance over the exposure, with gain and vignetting.
    fn photograph(&self, scene: &SyntheticScene, frame: usize) -> Image<[u8; 4]> {
        let k = scene.intrinsics();
        let poses = self.exposure_poses(frame, &k);
        // Radiance is averaged, as in a shutter; the tone curve comes after.
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
            // 1 in the corners.
            let from_centre = (pixel + 0.5 - centre).length_squared() / centre.length_squared();
            tone.pixel(*light * (gain * (1.0 - VIGNETTING * from_centre) as f32))
        });
        Image::from_vec(width, light.height, developed.collect())
    }

    /// Returns poses sampled over the exposure: one for small motion, otherwise three or five.
    fn exposure_poses(&self, frame: usize, k: &Intrinsics) -> Vec<Pose> {
        let middle = self.walk_parameter(frame);
        let at = |moment: f64| self.walk.shaken_pose(middle + SHUTTER * (moment - 0.5));
        let moved = image_motion(&at(0.0), &at(1.0), k);
        // Views cost time, and slow frames need one.
        let n = match BLURRED.iter().filter(|least| moved > **least).count() {
            0 => return vec![at(0.5)],
            1 => 3,
            _ => 5,
        };
        (0..n).map(|i| at((i as f64 + 0.5) / f64::from(n))).collect()
    }
}

fn image_motion(from: &Pose, to: &Pose, k: &Intrinsics) -> f64 {
    let (offset, turn) = from.offset_to(to);
    // Rotation moves all pixels alike, translation those at the typical depth.
    k.fx * (turn.to_scaled_axis().length() + offset.length() / TYPICAL_DEPTH)
}

/// Returns the intrinsics of the lidar image, which shares the photograph's field of view. For example, a
/// photograph of 1440×1920 pixels has a lidar image of 192×256 pixels.
pub fn depth_camera(k: &Intrinsics) -> Intrinsics {
    let longest = f64::from(k.width.max(k.height));
    k.scaled(1.0 / (longest / DEPTH_SIDE).max(LEAST_FACTOR))
}

const STREAM: u64 = u64::MAX - 4;
const GAINS: [f64; 2] = [0.8, 1.25];
/// Minimum relative difference between consecutive gains.
const LEAST_STEP: f64 = 0.08;
/// Approximate number of consecutive frames with the same gain.
const FRAMES_PER_STEP: usize = 14;

/// Returns the exposure gain of each of `n` frames; the first is 1.
pub(super) fn gains(n: usize, seed: u64) -> Vec<f32> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, STREAM);
    // Gives short recordings a few steps too.
    let length = FRAMES_PER_STEP.min(n.div_ceil(3)).max(1);
    let mut gains = Vec::with_capacity(n);
    let (mut gain, mut left) = (1.0, length);
    while gains.len() < n {
        if left == 0 {
            gain = next(gain, &mut rng);
            left = length / 2 + rng.below(length) + 1;
        }
        gains.push(gain as f32);
        left -= 1;
    }
    gains
}

fn next(gain: f64, rng: &mut Rng) -> f64 {
    // Uniform in the logarithm: brighter and darker steps are equally likely.
    let [low, high] = GAINS.map(f64::ln);
    loop {
        // Terminates quickly: at most a quarter of the draws are rejected.
        let drawn = rng.range(low, high).exp();
        if (drawn / gain - 1.0).abs() > LEAST_STEP {
            return drawn;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::params::PhoneScene;

    #[test]
    fn fast_frames_are_blurred_and_slow_ones_are_not() {
        let k = Intrinsics::from_horizontal_fov(1440, 1920, 0.873);
        let phone = PhoneCamera::new(Walk::new(PhoneScene::Door, 0), 70, 0);
        let n_views: Vec<usize> = (0..70).map(|i| phone.exposure_poses(i, &k).len()).collect();
        let count = |n: usize| n_views.iter().filter(|found| **found == n).count();
        assert_eq!(count(1) + count(3) + count(5), 70);
        assert!(count(1) > 3 && count(3) > 10, "{n_views:?}");
        let depth = depth_camera(&k);
        assert_eq!([depth.width, depth.height], [192, 256]);
    }

    #[test]
    fn gains_change_in_a_few_steps() {
        for (seed, n) in [(0, 70), (1, 70), (2, 24), (3, 2), (4, 1), (5, 0)] {
            let gains = gains(n, seed);
            assert_eq!(gains.len(), n);
            assert!(gains.first().is_none_or(|first| *first == 1.0));
            assert!(gains.iter().all(|gain| (0.8..=1.25).contains(gain)), "{gains:?}");
            let n_steps = gains.array_windows().filter(|[a, b]| a != b).count();
            assert!(n_steps <= n.div_ceil(3) && n_steps >= n / 24, "{n_steps} of {n}");
        }
    }
}
