//! Gain of a frame relative to the scene's exposure (`scene.md`, Gain).

use super::component_sums::ComponentSums;
use crate::observation::surface::SurfacePoint;
use glam::DVec3;
use rayon::prelude::*;

/// Number of points in known components that suffice to determine the gain of a large frame.
pub const MIN_MATCHES: f64 = 5000.0;
/// Minimum share of a frame's points in known components for its gain to be determined;
/// [`MIN_MATCHES`] points always suffice.
const MIN_SHARE: f64 = 0.125;
/// Minimum number of points in known components to determine the gain of any frame.
const FEWEST_MATCHES: f64 = 100.0;
/// Points per partial sum; a fixed size makes sums independent of the number of threads.
const CHUNK: usize = 512;

/// Returns how many of a frame's points must be in known components to determine the frame's gain. The
/// result is at most `most`.
pub fn fewest_matches(points: usize, most: f64) -> f64 {
    // The upper limit last: frames of few, heavy points need fewer matches.
    (MIN_SHARE * points as f64).max(FEWEST_MATCHES).min(most)
}

/// Returns the gain of each channel: the factor that converts the frame's colours to the scene's
/// exposure. The gain is `Σ c̄ / Σ c` over the points. Here `c` is the colour of a point and `c̄` the
/// mean colour of its component. The gain is 1 if fewer than `fewest` points are in known components, or
/// if either sum is zero. A gain of 0 would train the scene on black.
///
/// The least-squares factor `Σ c̄·c / Σ c²` is not used: its denominator contains the noise of the frame's
/// colours, which makes it a few per cent too small. The bias would accumulate along a sequence of
/// overlapping frames.
pub fn gain(
    component_sums: &ComponentSums,
    points: &[SurfacePoint],
    owners: &[u32],
    fewest: f64,
) -> [f32; 3] {
    let chunks = points.par_chunks(CHUNK).zip(owners.par_chunks(CHUNK));
    let chunks = chunks.map(|(points, owners)| Brightness::of(component_sums, points, owners));
    Brightness::gain(chunks.collect::<Vec<_>>(), fewest)
}

#[derive(Default)]
pub struct Brightness {
    expected: DVec3,
    seen: DVec3,
    points: f64,
}

impl Brightness {
    /// Returns the summed colours of the points in known components, and the summed mean colours of
    /// their components.
    pub fn of(component_sums: &ComponentSums, points: &[SurfacePoint], owners: &[u32]) -> Self {
        let mut sums = Self::default();
        for (point, &owner) in points.iter().zip(owners) {
            let Some(color) = component_sums.known_color(owner) else { continue };
            sums.expected += DVec3::from_array(color);
            sums.seen += DVec3::from_array(point.color.map(f64::from));
            sums.points += 1.0;
        }
        sums
    }

    /// Returns the gain of a frame, computed from the sums over parts of its points. Apart from
    /// rounding, it equals [`gain()`] of all points. Parts are added in order.
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
        // A factor only: an additional offset lowered the scores (`scene.md`, Gain).
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
    use crate::model::scene::state::VisibilityCounts;
    use crate::model::scene::sums::N_SUMS;

    #[test]
    fn gains_are_ratios_of_brightness_and_never_nothing() {
        // The scene has no blue, the frame no green.
        let mut row = [0.0; N_SUMS];
        row[0] = 100.0;
        row[10..13].copy_from_slice(&[60.0, 40.0, 0.0]);
        let mut sums = ComponentSums::default();
        sums.push(&row, VisibilityCounts::default());
        let seen = SurfacePoint { color: [0.3, 0.0, 0.5], ..SurfacePoint::default() };
        let (points, owners) = (vec![seen; 10], vec![0; 10]);
        let found = gain(&sums, &points, &owners, 5.0);
        assert!((found[0] - 2.0).abs() < 1e-6, "{found:?}");
        assert_eq!(found[1..], [1.0, 1.0], "black has no exposure");
        assert_eq!(gain(&sums, &points, &owners, 10.0), found);
        assert_eq!(gain(&sums, &points, &owners, 11.0), [1.0; 3], "too few matches");
        let fewest = [100, 8000, 80_000].map(|points| fewest_matches(points, MIN_MATCHES));
        assert_eq!(fewest, [100.0, 1000.0, 5000.0]);
    }
}
