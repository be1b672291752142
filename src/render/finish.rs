//! What becomes of a pixel once its splats are blended: cracks are filled, then exposure is applied.
//!
//! Neighbouring splats never cover a surface whole: light comes through where their rims meet. Wider
//! splats close such cracks and blur what they show. Instead a pixel counts as covered in full from a
//! coverage below 1 on, the scene's `full_coverage` (1 fills no crack); below that coverage and colour rise
//! in proportion.
//!
//! Exposure multiplies the splats' colour as the camera that saw the scene exposed it thereabouts
//! ([`crate::model::splat::exposure`]).

use super::options::{Exposing, RenderOptions};
use crate::math::camera::Camera;
use crate::model::splat::appearance::Finishing;

/// What becomes of an image's pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Coverage from which on a pixel counts as covered in full, in `(0, 1]`.
    pub full_coverage: f32,
    /// Factors on red, green and blue.
    pub exposure: [f32; 3],
}

impl Finish {
    /// Pixels as they are.
    pub const NONE: Self = Self { full_coverage: 1.0, exposure: [1.0; 3] };

    /// What the pixels of one view of a scene become: its crack filling, and its exposure there.
    pub fn new(finishing: &Finishing, camera: &Camera, options: &RenderOptions) -> Self {
        let exposure = match (options.exposing, &finishing.exposures) {
            (Exposing::Recorded, Some(log)) => log.at(&camera.pose),
            _ => [1.0; 3],
        };
        Self { full_coverage: finishing.full_coverage, exposure }
    }

    /// Premultiplied colour and coverage `A` of a finished pixel: all times
    /// `min(1/full_coverage, 1/A)`, so that coverage ends at 1.
    #[inline(always)]
    pub fn apply(&self, [r, g, b, coverage]: [f32; 4]) -> [f32; 4] {
        // The second bound holds coverage at 1; where nothing covers it is infinite and the first
        // one counts.
        let factor = (1.0 / self.full_coverage).min(1.0 / coverage);
        let [red, green, blue] = self.exposure;
        [r * factor * red, g * factor * green, b * factor * blue, coverage * factor]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_rises_in_proportion_and_ends_at_one() {
        for (coverage, full_coverage, closed) in
            [(0.0, 0.5, 0.0), (0.2, 0.5, 0.4), (0.5, 0.5, 1.0), (0.9, 0.5, 1.0), (0.3, 1.0, 0.3)]
        {
            let finish = Finish { full_coverage, ..Finish::NONE };
            let color = 0.5 * coverage;
            let pixel = finish.apply([color, color, color, coverage]);
            assert_eq!(pixel, [0.5 * closed, 0.5 * closed, 0.5 * closed, closed], "{coverage}");
        }
    }

    #[test]
    fn exposure_leaves_coverage() {
        let finish = Finish { exposure: [2.0, 1.0, 0.5], ..Finish::NONE };
        assert_eq!(finish.apply([0.25, 0.25, 0.25, 0.5]), [0.5, 0.25, 0.125, 0.5]);
    }
}
