//! A frame's exposure against the scene's (`scene.md`, Gain).

use super::component_sums::ComponentSums;
use super::grid::NONE;
use super::sum_scalar::SumScalar;
use crate::observation::surface::SurfacePoint;
use glam::DVec3;
use rayon::prelude::*;

/// Fewest points of a component whose colour is trusted.
const MIN_POINTS: f64 = 20.0;
/// Known points that determine the gain of a large frame.
pub const MIN_MATCHES: f64 = 5000.0;
/// Share of the points of a small frame that determine its gain.
const MIN_SHARE: f64 = 0.125;
/// Fewest points that determine the gain of any frame.
const FEWEST_MATCHES: f64 = 100.0;
/// Points of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 512;

/// Returns how many of a frame's points must be known to determine its gain, at most `most`.
pub fn fewest_matches(points: usize, most: f64) -> f64 {
    (MIN_SHARE * points as f64).max(FEWEST_MATCHES).min(most)
}

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
    let chunks = points.par_chunks(CHUNK).zip(owners.par_chunks(CHUNK));
    let chunks = chunks.map(|(points, owners)| Brightness::of(component_sums, points, owners));
    Brightness::gain(chunks.collect::<Vec<_>>(), fewest)
}

/// Sums of colours over points of known components.
#[derive(Default)]
pub struct Brightness {
    /// Of the components' means.
    expected: DVec3,
    /// Of the points.
    seen: DVec3,
    points: f64,
}

impl Brightness {
    /// Of some points with their components.
    pub fn of<W: SumScalar>(
        component_sums: &ComponentSums<W>,
        points: &[SurfacePoint],
        owners: &[u32],
    ) -> Self {
        let mut sums = Self::default();
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

    /// The [`gain`] that the parts of a frame tell of together, added in their order.
    pub fn gain(parts: impl IntoIterator<Item = Self>, fewest: f64) -> [f32; 3] {
        let mut total = Self::default();
        for part in parts {
            total.expected += part.expected;
            total.seen += part.seen;
            total.points += part.points;
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
