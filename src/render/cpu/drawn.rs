//! A splat in the image in f64, as the projected and the exact renderer both leave it, and its
//! narrowing to the record that the rasteriser reads.

use super::conic::Conic;
use super::lanes::EXP2_MIN;
use super::record::{ConicRecord, Rect};
use glam::DVec2;
use std::f64::consts::LOG2_E;

/// A splat in the image, in f64.
pub(super) struct ImageSplat {
    pub centre: DVec2,
    pub conic: Conic,
    /// See [`ConicRecord::linear`].
    pub linear: DVec2,
    /// Depth `z` of the centre (pinhole) or its distance (fisheye), world units.
    pub reach: f64,
    /// What the order of blending goes by, world units: view depth (projected), distance (exact).
    pub key: f64,
    pub opacity: f64,
    /// `k²` of the alpha cut.
    pub extent_squared: f64,
    pub rect: Rect,
}

impl ImageSplat {
    /// The record and its key; `None` if f32 cannot hold them.
    pub(super) fn record(&self, color: [f32; 3]) -> Option<(ConicRecord, f32)> {
        // exp(−½ D²) = 2^−(½ log₂e · D²).
        let unit = (0.5 * LOG2_E).sqrt();
        let Conic { p_x, p_y, q_y, w, .. } = self.conic;
        let record = ConicRecord {
            u: self.centre.x as f32,
            v: self.centre.y as f32,
            p_x: (unit * p_x) as f32,
            p_y: (unit * p_y) as f32,
            q_y: (unit * q_y) as f32,
            linear: self.linear.as_vec2().to_array(),
            w: (w / (unit * unit)) as f32,
            // Held above what `exp2` can take: below it the bits are no number.
            cut: ((-0.5 * LOG2_E * self.extent_squared) as f32).max(EXP2_MIN),
            opacity: self.opacity as f32,
            color,
            reach: self.reach as f32,
            rect: self.rect,
        };
        // f32 overflows long before f64 does, so finiteness is asked of what the loop will read.
        let ConicRecord { u, v, p_x, p_y, q_y, linear: [l_x, l_y], w, reach, .. } = record;
        let key = self.key as f32;
        [u, v, p_x, p_y, q_y, l_x, l_y, w, reach, key]
            .iter()
            .all(|value| value.is_finite())
            .then_some((record, key))
    }
}
