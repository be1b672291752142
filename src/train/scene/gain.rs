//! A frame's exposure against the scene's (`scene.md`, Gain).

use super::component_sums::{ComponentSums, SumScalar};
use super::grid::NONE;
use crate::observation::surface::SurfacePoint;
use rayon::prelude::*;

/// Fewest points of a component whose colour is trusted.
const MIN_POINTS: f64 = 20.0;
/// Fewest points that determine a frame's gain.
pub const MIN_MATCHES: f64 = 5000.0;
/// Points of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 4096;

/// Per channel the factor that brings the frame's colours closest to those of its points'
/// components, `Σ c̄·c / Σ c²`; 1 where fewer than `fewest` points are known.
pub fn gain<W: SumScalar>(
    component_sums: &ComponentSums<W>,
    points: &[SurfacePoint],
    owners: &[u32],
    fewest: f64,
) -> [f32; 3] {
    let sums: Vec<[f64; 7]> = points
        .par_chunks(CHUNK)
        .zip(owners.par_chunks(CHUNK))
        .map(|(points, owners)| chunk_sums(component_sums, points, owners))
        .collect();
    let total = sums.iter().fold([0.0; 7], |mut total, sums| {
        total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
        total
    });
    if total[6] < fewest {
        return [1.0; 3];
    }
    // A factor alone: with an offset beside it scores were worse (`scene.md`, Gain).
    [0, 1, 2].map(|i| if total[3 + i] > 0.0 { (total[i] / total[3 + i]) as f32 } else { 1.0 })
}

/// `Σ c̄·c` and `Σ c²` by channel, and the points they are over.
fn chunk_sums<W: SumScalar>(
    component_sums: &ComponentSums<W>,
    points: &[SurfacePoint],
    owners: &[u32],
) -> [f64; 7] {
    let mut sums = [0.0; 7];
    for (point, &owner) in points.iter().zip(owners) {
        // Components born in this frame have no row yet.
        if owner == NONE || owner as usize >= component_sums.len() {
            continue;
        }
        let (n, color) = component_sums.color_sums(owner as usize);
        if n < MIN_POINTS {
            continue;
        }
        for i in 0..3 {
            let c = f64::from(point.color[i]);
            sums[i] += color[i] / n * c;
            sums[3 + i] += c * c;
        }
        sums[6] += 1.0;
    }
    sums
}
