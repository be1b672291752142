//! Viewpoints of frames, and interpolation of per-frame values to nearby views.

use crate::math::cholesky::Cholesky;
use crate::math::pose::Pose;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Angle between view directions, radians, that has the same effect as the camera distance
/// [`DISTANCE`].
const ANGLE: f64 = 0.3;
/// Distance between cameras, in structural scales, at which the values of two frames correlate by one
/// half.
const DISTANCE: f64 = 12.0;
/// Variance of the noise in the value of a single frame, relative to the variance of the value between
/// places.
const NOISE: f64 = 0.05;
// Maximum number of frames used, the nearest ones: more add nothing.
const MOST: usize = 16;

/// Viewpoint of a frame: camera centre and view direction.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Viewpoint {
    /// Camera centre, world units.
    pub centre: [f64; 3],
    /// Unit view direction, world axes.
    pub forward: [f64; 3],
}

impl Viewpoint {
    /// Returns the viewpoint of a camera.
    pub fn new(pose: &Pose) -> Self {
        Self { centre: pose.centre().to_array(), forward: pose.forward().to_array() }
    }

    /// Returns the viewpoint moved by `motion`, which maps old to new world coordinates.
    pub fn moved(&self, motion: &Pose) -> Self {
        let [centre, forward] = [self.centre, self.forward].map(DVec3::from_array);
        Self {
            centre: motion.transform_point(centre).to_array(),
            forward: (motion.rotation() * forward).to_array(),
        }
    }

    /// Returns the combined distance in position and direction, with the spatial scale `reach`. It is 1
    /// if a difference in position alone, or in direction alone, gives a correlation of one half.
    fn distance(&self, other: &Self, reach: f64) -> f64 {
        let [a, b] = [self, other].map(|view| DVec3::from_array(view.centre));
        let [to, from] = [self, other].map(|view| DVec3::from_array(view.forward));
        // Both count alike: either alone gives a correlation of one half at 1.
        f64::hypot(a.distance(b) / reach, to.angle_between(from) / ANGLE)
    }
}

/// Returns the distance between cameras at which values of frames correlate by one half, world units.
/// The scene has structural scale `h`.
pub fn reach(h: f64) -> f64 {
    DISTANCE * h
}

/// Interpolates per-frame values at `pose`; `None` if there are no frames. `entry` returns viewpoint
/// and values of a frame; `reach` is the distance between cameras at which values correlate by one
/// half, world units.
///
/// This is the best linear unbiased prediction from the nearest frames with unknown mean (ordinary
/// kriging; Cressie 1993, section 3.2). The covariance is of Matérn type with smoothness 3/2. A mean
/// weighted by distance alone would be biased towards the side with more frames. It would also flatten
/// changes between frames (`evaluation.md`, Poses of held-out views).
pub fn interpolate<T, const N: usize>(
    frames: &[T],
    pose: &Pose,
    reach: f64,
    entry: impl Fn(&T) -> (Viewpoint, [f64; N]),
) -> Option<[f64; N]> {
    let here = Viewpoint::new(pose);
    let away = |(i, frame)| (here.distance(&entry(frame).0, reach), i);
    let mut nearest: Vec<(f64, usize)> = frames.iter().enumerate().map(away).collect();
    // Ties keep the order of frames, so that every machine selects the same ones.
    nearest.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    nearest.truncate(MOST);
    let (views, values): (Vec<_>, Vec<_>) = nearest.iter().map(|&(_, i)| entry(&frames[i])).unzip();
    let n = views.len();
    let among = |k: usize| {
        let (i, j) = (k / n, k % n);
        // The noise also keeps the matrix definite for frames at one place.
        covariance(views[i].distance(&views[j], reach)) + if i == j { NOISE } else { 0.0 }
    };
    let factor = Cholesky::new(n, &(0..n * n).map(among).collect::<Vec<f64>>())?;
    let towards: Vec<f64> = nearest.iter().map(|&(away, _)| covariance(away)).collect();
    let (by_place, by_mean) = (factor.solve(&towards), factor.solve(&vec![1.0; n]));
    // Weights that sum to one, whatever the mean.
    let rest = (1.0 - by_place.iter().sum::<f64>()) / by_mean.iter().sum::<f64>();
    let mut sums = [0.0; N];
    for ((value, place), mean) in values.into_iter().zip(by_place).zip(by_mean) {
        let weight = place + rest * mean;
        sums.iter_mut().zip(value).for_each(|(sum, value)| *sum += weight * value);
    }
    // An empty matrix has a factor too, so the case ends here.
    (n > 0).then_some(sums)
}

/// Returns the Matérn correlation of smoothness 3/2 at a distance.
fn covariance(distance: f64) -> f64 {
    let scaled = 3f64.sqrt() * distance;
    (1.0 + scaled) * (-scaled).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looking_ahead(x: f64) -> Pose {
        Pose::look_at(DVec3::new(x, 0.0, 0.0), DVec3::new(x, 1.0, 0.0), DVec3::Z).unwrap()
    }

    fn at(frames: &[(f64, f64)], x: f64) -> f64 {
        let entry = |&(x, value): &(f64, f64)| (Viewpoint::new(&looking_ahead(x)), [value]);
        let [value] = interpolate(frames, &looking_ahead(x), 0.3, entry).unwrap();
        value
    }

    #[test]
    fn what_changes_along_the_way_is_followed_between_frames() {
        let way: Vec<(f64, f64)> = (0..8).map(|i| (0.1 * f64::from(i), f64::from(i))).collect();
        // Three more frames on one side of a place do not bias the prediction.
        let crowded = [&way[..], &[(0.4, 4.0), (0.4, 4.0), (0.401, 4.0)]].concat();
        for frames in [&way, &crowded] {
            for x in [0.15, 0.25, 0.35, 0.45, 0.55] {
                assert!((at(frames, x) - 10.0 * x).abs() < 0.1, "{x}: {}", at(frames, x));
            }
        }
        assert!((at(&[(0.0, 1.0), (0.0, 3.0)], 0.0) - 2.0).abs() < 1e-12, "both err");
    }

    #[test]
    fn far_from_all_frames_their_mean_holds() {
        let far = at(&[(0.0, 1.0), (5.0, 3.0)], 1000.0);
        assert!((far - 2.0).abs() < 1e-9, "{far}");
        assert!((at(&[(0.0, 7.0)], 3.0) - 7.0).abs() < 1e-12);
    }

    #[test]
    fn the_nearest_of_many_frames_are_enough() {
        let frames: Vec<(f64, f64)> =
            (0..4000).map(|i| 0.01 * f64::from(i)).map(|x| (x, x.sin())).collect();
        for x in [0.305, 7.777, 39.5] {
            assert!((at(&frames, x) - x.sin()).abs() < 2e-3, "{x}: {}", at(&frames, x));
        }
    }
}
