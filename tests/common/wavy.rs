//! Point frames of a wavy surface.

use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::observation::points::Points;

/// Wavy surface with a depth edge, of `side`×`side` tiles; some tiles are not full.
pub fn wavy_frame(phase: f32, side: usize) -> Points<f32> {
    let mut points = Points::new();
    let mut rng = Rng::new(3, Purpose::Synthetic, phase.to_bits().into());
    let step = 0.4 / side as f32;
    for tile in 0..side * side {
        let (column, row) = (tile % side, tile / side);
        for k in 0..(if tile % 7 == 3 { 17 } else { 64 }) {
            let x = (column * 8 + k % 8) as f32 * step - 1.6;
            let y = (row * 8 + k / 8) as f32 * step - 1.6;
            let edge = if x + 0.3 * y > 0.4 { 0.6 } else { 0.0 };
            let noise = 0.002 * rng.normal() as f32;
            let z = 0.4 * (2.0 * x + phase).sin() * (1.5 * y).cos() + edge + noise;
            let color = [x, y, z].map(|v| (5.0 * v).sin() * 1.7);
            points.push([x, y, z, color[0], color[1], color[2]]);
        }
        points.close_tile();
    }
    points
}
