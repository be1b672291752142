//! Random splats.

use crate::common::scenes::cone;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::splat::appearance::Appearance;
use vbgs_studio::model::splat::splats::Splat;

/// Random splats in a cube of side 3; the scale is at most `largest`, the thinnest axis `thinnest`
/// times that.
pub fn cloud(seed: u64, n: usize, largest: f64, thinnest: f64, opacity: [f64; 2]) -> Vec<Splat> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
    (0..n)
        .map(|_| {
            let mut at = |lo: f64, hi: f64| rng.range(lo, hi) as f32;
            let q = [0; 4].map(|_| at(-1.0, 1.0));
            let norm = q.iter().map(|v| v * v).sum::<f32>().sqrt();
            Splat {
                mean: [0; 3].map(|_| at(-1.5, 1.5)),
                opacity: at(opacity[0], opacity[1]),
                color: [0; 3].map(|_| at(0.0, 1.0)),
                scale: [0; 3]
                    .map(|_| largest as f32 * f64::from(at(thinnest.ln(), 0.0)).exp() as f32),
                rotation: q.map(|v| v / norm),
            }
        })
        .collect()
}

/// Gradients of about 1 per world unit, view dependence of about a third.
pub fn appearance(seed: u64, n: usize) -> Vec<Appearance> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 1);
    let mut rows = |size: f64| [0; 3].map(|_| [0; 3].map(|_| (size * rng.normal()) as f32));
    let mut one =
        || Appearance { gradient: rows(1.0), directional: rows(0.3), observed: cone(rows(0.4)) };
    (0..n).map(|_| one()).collect()
}
