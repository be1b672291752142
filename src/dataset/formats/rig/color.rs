//! Photometric difference between two photographs as a function of the delay from timestamp to capture.

use super::clock::{Clock, ImagePair};
use super::depth;
use super::mount_search::Strips;
use crate::dataset::decode;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use glam::DVec3;

/// Side of the squares over which pixels are averaged. Averaging suppresses noise and detail finer than
/// the registration error.
const SQUARE: usize = 4;
/// Limit to which grey differences are clamped (grey in `[0, 1]`). Larger differences are caused by
/// motion or reflections.
const FARTHEST: f64 = 0.2;

pub(super) struct Pair {
    times: [f64; 2],
    greys: [Image<f32>; 2],
    points: Vec<DVec3>,
}

impl Pair {
    pub fn load(pair: &depth::Pair<'_>, clock: &Clock<'_>, delay: f64) -> Option<Self> {
        let [a, b] = pair.shots;
        Some(Self {
            times: [a.color.0, b.color.0],
            greys: [load(a, &clock.intrinsics)?, load(b, &clock.intrinsics)?],
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
            return FARTHEST;
        }
        let differences = shown.iter().map(|[x, y]| (x - gain * y).abs().min(FARTHEST));
        differences.sum::<f64>() / shown.len() as f64
    }
}

fn load(shot: &ImagePair, k: &Intrinsics) -> Option<Image<f32>> {
    let color = shot.read(|| decode::color(&shot.color.1, (k.width, k.height)))?;
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
