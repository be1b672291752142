//! Estimates properties of a recording's rig from its images: errors of timestamps, and the mount of the
//! camera on the tracked body.
//!
//! If times and trajectory are right, the depth of one image, transformed into another, matches the
//! depth measured there. Matching points also have the same colour in both photographs. So differences
//! within image pairs reveal errors that all images share. Delays follow from pairs with different
//! rotation rates, the mount from pairs with different orientations.

mod clock;
mod mount_search;
#[cfg(test)]
mod tests;

use crate::dataset::decode;
use crate::dataset::depth::{Depth, DepthKind};
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::pose::Pose;
use clock::estimate_delay;
use glam::DVec3;
use mount_search::{EVERY, Strips};
use rayon::prelude::*;

pub(super) use clock::{Clock, ImagePair};
pub(super) use mount_search::Mount;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rig {
    /// True if image rows are read one after the other (rolling shutter); false if depth agrees better
    /// without a rolling shutter.
    pub reads_rows: bool,
    /// Time from the timestamps of depth images to their capture, seconds; negative if captured earlier,
    /// 0 if undetermined.
    pub depth_delay: f64,
    pub color_delay: f64,
    pub mount: Mount,
}

impl Rig {
    /// Rig assumed before the estimate.
    pub const EXPECTED: Self = Self {
        reads_rows: true,
        depth_delay: 0.0,
        color_delay: 0.0,
        mount: Mount { shift: DVec3::ZERO, turn: DVec3::ZERO },
    };
}

pub(super) fn find(shots: &[ImagePair], clock: &Clock<'_>) -> Rig {
    let loaded = |chosen: Vec<[_; 2]>| -> Vec<DepthPair<'_>> {
        chosen.into_par_iter().filter_map(|pair| DepthPair::load(pair, clock)).collect()
    };
    let shaken = loaded(clock::pairs_by_rate_change(shots, clock));
    let delay = estimate_delay(&shaken, |pair, delay| pair.distance(clock, delay)).unwrap_or(0.0);
    let at_once = &clock.without_readout();
    let all: Vec<&DepthPair<'_>> = shaken.iter().collect();
    // A tie, as without pairs, keeps the expectation.
    let reads_rows = total_distance(&all, clock, delay) <= total_distance(&all, at_once, delay);
    let clock = if reads_rows { clock } else { at_once };
    let mount = mount_search::find(&loaded(clock::pairs_by_rotation(shots, clock)), clock, delay);
    // Photographs come last: their common points need the delay and mount of depth.
    let clock = &clock.mounted(mount);
    let shaken: Vec<ColorPair> =
        shaken.into_par_iter().filter_map(|pair| ColorPair::load(&pair, clock, delay)).collect();
    let color = estimate_delay(&shaken, |pair, delay| pair.distance(clock, delay)).unwrap_or(0.0);
    Rig { reads_rows, depth_delay: delay, color_delay: color, mount }
}

/// Limit to which relative depth differences are clamped; it bounds the effect of occlusions.
const FARTHEST_DEPTH: f64 = 0.05;
/// Side of the squares over which pixels are averaged. Averaging suppresses noise and detail finer than
/// the registration error.
const SQUARE: usize = 4;
/// Limit to which grey differences are clamped (grey in `[0, 1]`). Larger differences are caused by
/// motion or reflections.
const FARTHEST_GREY: f64 = 0.2;

pub(super) struct DepthPair<'a> {
    pub shots: [&'a ImagePair; 2],
    depths: [Depth; 2],
}

impl<'a> DepthPair<'a> {
    /// Loads both depth images. Returns `None` if one cannot be read or has depth along the ray, which
    /// no Kinect measures.
    pub fn load(shots: [&'a ImagePair; 2], clock: &Clock<'_>) -> Option<Self> {
        let [a, b] = shots;
        Some(Self {
            shots,
            depths: [load_depth(a, &clock.intrinsics)?, load_depth(b, &clock.intrinsics)?],
        })
    }

    pub fn distance(&self, clock: &Clock<'_>, delay: f64) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for share in self.depth_differences(clock, delay).into_iter().flatten() {
            sum += share.abs().min(FARTHEST_DEPTH);
            n += 1.0;
        }
        // Without common samples the match is the worst: a delay must not gain by losing them.
        if n > 0.0 { sum / n } else { FARTHEST_DEPTH }
    }

    /// Returns, for each sample of the first image, the depth measured in the second image minus the
    /// depth expected from the first, relative to the expected depth. `None` if either depth is
    /// missing. The samples are the same for every delay and clock.
    pub fn depth_differences(&self, clock: &Clock<'_>, delay: f64) -> Vec<Option<f64>> {
        self.measured(clock, delay, |_, share| share)
    }

    pub fn common(&self, clock: &Clock<'_>, delay: f64) -> Vec<DVec3> {
        let near = |world, share: f64| (share.abs() < FARTHEST_DEPTH).then_some(world);
        self.measured(clock, delay, near).into_iter().flatten().flatten().collect()
    }

    /// Calls `make` for each sample of the first image. Its arguments are the sample's world point and
    /// the relative depth difference in the second image. A sample without depth in both images yields
    /// `None`.
    fn measured<T>(
        &self,
        clock: &Clock<'_>,
        delay: f64,
        make: impl Fn(DVec3, f64) -> T,
    ) -> Vec<Option<T>> {
        let k = &clock.intrinsics;
        let [from, to] =
            self.shots.map(|shot| Strips::new(clock, shot.depth.0 + delay, clock.depth_reading));
        let [a, b] = &self.depths;
        let sample = |column: usize, row: usize, pose: &Pose| {
            let world = pose.transform_point(k.ray(column, row) * trusted(a, column, row)?);
            let [u, v, expected] = to.project(world)?;
            // Pixel centres are at +½, so truncation finds the pixel that contains the point.
            Some(make(world, (trusted(b, u as usize, v as usize)? - expected) / expected))
        };
        let columns = || (EVERY / 2..k.width as usize).step_by(EVERY);
        let rows = from.rows();
        rows.flat_map(|(row, pose)| columns().map(move |column| (column, row, pose)))
            .map(|(column, row, pose)| sample(column, row, pose))
            .collect()
    }
}

pub(super) fn total_distance(pairs: &[&DepthPair<'_>], clock: &Clock<'_>, delay: f64) -> f64 {
    let each: Vec<f64> = pairs.par_iter().map(|pair| pair.distance(clock, delay)).collect();
    // Summed in order, so that rounding does not depend on the number of threads.
    each.iter().sum()
}

fn load_depth(shot: &ImagePair, k: &Intrinsics) -> Option<Depth> {
    let (_, source) = &shot.depth;
    let size = (k.width, k.height);
    let depth = shot.read(|| decode::depth(&source.file, &source.encoding, size))?;
    (depth.kind == DepthKind::Z).then_some(depth)
}

fn trusted(depth: &Depth, column: usize, row: usize) -> Option<f64> {
    depth.value_at(column, row).filter(|&z| depth.is_trusted(z))
}

pub(super) struct ColorPair {
    times: [f64; 2],
    greys: [Image<f32>; 2],
    points: Vec<DVec3>,
}

impl ColorPair {
    pub fn load(pair: &DepthPair<'_>, clock: &Clock<'_>, delay: f64) -> Option<Self> {
        let [a, b] = pair.shots;
        Some(Self {
            times: [a.color.0, b.color.0],
            greys: [load_grey(a, &clock.intrinsics)?, load_grey(b, &clock.intrinsics)?],
            points: pair.common(clock, delay),
        })
    }

    /// Returns the mean absolute grey difference at points visible in both photographs, after equalising
    /// exposure.
    pub fn distance(&self, clock: &Clock<'_>, delay: f64) -> f64 {
        let [a, b] = self.times.map(|time| Strips::new(clock, time + delay, clock.color_reading));
        let shown = |world: &DVec3| {
            let [x, y] = [a.project(*world)?, b.project(*world)?];
            Some([grey_at(&self.greys[0], x)?, grey_at(&self.greys[1], y)?])
        };
        let shown: Vec<[f64; 2]> = self.points.iter().filter_map(shown).collect();
        // Automatic exposure may differ between the photographs.
        let gain =
            shown.iter().map(|[x, _]| x).sum::<f64>() / shown.iter().map(|[_, y]| y).sum::<f64>();
        // Without common points the match is the worst: a delay must not gain by losing points.
        if shown.is_empty() || !gain.is_finite() {
            return FARTHEST_GREY;
        }
        let differences = shown.iter().map(|[x, y]| (x - gain * y).abs().min(FARTHEST_GREY));
        differences.sum::<f64>() / shown.len() as f64
    }
}

fn load_grey(shot: &ImagePair, k: &Intrinsics) -> Option<Image<f32>> {
    let color = shot.read(|| decode::color(&shot.color.1, (k.width, k.height), 1))?;
    let (columns, rows) = (color.width / SQUARE, color.height / SQUARE);
    let mut means = Image::filled(columns, rows, 0.0);
    for (row, line) in means.data.chunks_mut(columns.max(1)).enumerate() {
        for (column, mean) in line.iter_mut().enumerate() {
            let of_square = |i: usize| {
                let [r, g, b, _] =
                    *color.at(SQUARE * column + i % SQUARE, SQUARE * row + i / SQUARE);
                f32::from(r) + f32::from(g) + f32::from(b)
            };
            let sum: f32 = (0..SQUARE * SQUARE).map(of_square).sum();
            *mean = sum / (3.0 * 255.0 * (SQUARE * SQUARE) as f32);
        }
    }
    Some(means)
}

fn grey_at(grey: &Image<f32>, [u, v, _]: [f64; 3]) -> Option<f64> {
    let (x, y) = (u / SQUARE as f64 - 0.5, v / SQUARE as f64 - 0.5);
    let (column, row) = (x.floor(), y.floor());
    // Checked before the casts, which saturate at 0.
    let is_inside = column >= 0.0 && row >= 0.0;
    let (right, down) = (x - column, y - row);
    let (column, row) = (column as usize, row as usize);
    if !is_inside || column + 1 >= grey.width || row + 1 >= grey.height {
        return None;
    }
    let along = |row: usize| {
        let [left, next] = [column, column + 1].map(|column| f64::from(*grey.at(column, row)));
        left + right * (next - left)
    };
    Some(along(row) + down * (along(row + 1) - along(row)))
}
