//! A frame's exposure against the scene's (`scene.md`, Gain).

use super::component_sums::ComponentSums;
use super::grid::NONE;
use super::sum_scalar::SumScalar;
use crate::observation::surface::SurfacePoint;
use glam::DVec3;
use rayon::prelude::*;

/// Fewest points of a component whose colour is trusted.
const MIN_POINTS: f64 = 20.0;
/// Fewest points that determine a frame's gain.
pub const MIN_MATCHES: f64 = 5000.0;
/// Points of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 512;

/// Per channel the factor that makes the frame's colours as bright as those of its points' components,
/// `Σ c̄ / Σ c`; 1 where fewer than `fewest` points are known, or either sum is nothing: no exposure makes
/// light of black, and a frame that is multiplied to black teaches it.
///
/// Not that of least squares, `Σ c̄·c / Σ c²`: noise of the frame's colours is in its denominator, so that it
/// is too small by a few per cent, and in a chain of frames, each beside the last, once more with each.
pub fn gain<W: SumScalar>(
    component_sums: &ComponentSums<W>,
    points: &[SurfacePoint],
    owners: &[u32],
    fewest: f64,
) -> [f32; 3] {
    let sums: Vec<Brightness> = points
        .par_chunks(CHUNK)
        .zip(owners.par_chunks(CHUNK))
        .map(|(points, owners)| chunk_sums(component_sums, points, owners))
        .collect();
    let mut total = Brightness::default();
    for sums in &sums {
        total.expected += sums.expected;
        total.seen += sums.seen;
        total.points += sums.points;
    }
    if total.points < fewest {
        return [1.0; 3];
    }
    // A factor alone: with an offset beside it scores were worse (`scene.md`, Gain).
    let (expected, seen) = (total.expected.to_array(), total.seen.to_array());
    [0, 1, 2].map(|i| {
        let is_lit = expected[i] > 0.0 && seen[i] > 0.0;
        if is_lit { (expected[i] / seen[i]) as f32 } else { 1.0 }
    })
}

/// Sums of colours over points of known components.
#[derive(Default)]
struct Brightness {
    /// Of the components' means.
    expected: DVec3,
    /// Of the points.
    seen: DVec3,
    points: f64,
}

fn chunk_sums<W: SumScalar>(
    component_sums: &ComponentSums<W>,
    points: &[SurfacePoint],
    owners: &[u32],
) -> Brightness {
    let mut sums = Brightness::default();
    for (point, &owner) in points.iter().zip(owners) {
        // Components born in this frame have no row yet.
        if owner == NONE || owner as usize >= component_sums.len() {
            continue;
        }
        let (n, color) = component_sums.color_sums(owner as usize);
        if n < MIN_POINTS {
            continue;
        }
        sums.expected += DVec3::from_array(color) / n;
        sums.seen += DVec3::from_array(point.color.map(f64::from));
        sums.points += 1.0;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::scene::state::{StoredSums, VisibilityCounts};
    use crate::model::scene::sums::N_SUMS;

    #[test]
    fn gains_are_ratios_of_brightness_and_never_nothing() {
        // The blue of the scene, and the green of the frame, is black.
        let mut row = [0.0; N_SUMS];
        row[0] = 100.0;
        row[10..13].copy_from_slice(&[60.0, 40.0, 0.0]);
        let stored = StoredSums::F64(vec![row]);
        let sums = ComponentSums::<f64>::restore(stored, vec![VisibilityCounts::default()]);
        let seen = SurfacePoint { color: [0.3, 0.0, 0.5], ..SurfacePoint::default() };
        let (points, owners) = (vec![seen; 10], vec![0; 10]);
        let found = gain(&sums.unwrap(), &points, &owners, 5.0);
        assert!((found[0] - 2.0).abs() < 1e-6, "{found:?}");
        assert_eq!(found[1..], [1.0, 1.0], "black has no exposure");
    }
}
