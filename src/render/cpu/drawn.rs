//! A projected splat in f64, produced by both renderers, and its conversion to the rasteriser's f32
//! record.

use super::conic::Conic;
use super::lanes::EXP2_MIN;
use super::record::{ConicRecord, Rect};
use glam::DVec2;
use std::f64::consts::LOG2_E;

/// Splat in the image, in f64.
pub(super) struct ImageSplat {
    pub centre: DVec2,
    pub conic: Conic,
    /// See [`ConicRecord::linear`].
    pub linear: DVec2,
    /// Depth `z` (pinhole) or distance (fisheye) of the centre, world units.
    pub reach: f64,
    /// Sort key, world units: view depth (projected) or distance (exact).
    pub key: f64,
    pub opacity: f64,
    /// `k²` at the alpha cut.
    pub extent_squared: f64,
    pub rect: Rect,
}

impl ImageSplat {
    /// Record and sort key; `None` if a value overflows f32.
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
            // Limited to the range of `exp2`: below it, the bits of its result are not a valid number.
            min_exponent: ((-0.5 * LOG2_E * self.extent_squared) as f32).max(EXP2_MIN),
            opacity: self.opacity as f32,
            color,
            reach: self.reach as f32,
            rect: self.rect,
        };
        // f32 overflows long before f64, so finiteness is checked on the values that the loop reads.
        let ConicRecord { u, v, p_x, p_y, q_y, linear: [l_x, l_y], w, reach, .. } = record;
        let key = self.key as f32;
        [u, v, p_x, p_y, q_y, l_x, l_y, w, reach, key]
            .iter()
            .all(|value| value.is_finite())
            .then_some((record, key))
    }
}
