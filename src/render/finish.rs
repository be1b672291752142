//! Post-processing of blended pixels: crack filling, then exposure.
//!
//! Neighbouring splats never cover a surface completely: background shows through where their edges
//! meet. Wider splats would close such cracks but blur the image. Instead a pixel counts as fully covered
//! once its coverage reaches the scene's `full_coverage` (1 disables filling). Below that value, coverage and
//! colour are scaled up in proportion.
//!
//! Exposure multiplies the splats' colour by the exposure recorded near the view
//! ([`crate::model::splat::exposure`]).

use super::options::{Exposing, RenderOptions};
use crate::math::camera::Camera;
use crate::model::splat::appearance::Finishing;

/// Crack filling and exposure of one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Coverage at which a pixel counts as fully covered, in `(0, 1]`.
    pub full_coverage: f32,
    /// Factors on red, green and blue.
    pub exposure: [f32; 3],
}

impl Finish {
    /// Leaves pixels unchanged.
    pub const NONE: Self = Self { full_coverage: 1.0, exposure: [1.0; 3] };

    /// Derives the crack filling of a scene and its exposure at the camera's pose.
    pub fn new(finishing: &Finishing, camera: &Camera, options: &RenderOptions) -> Self {
        let exposure = match (options.exposure_mode, &finishing.exposures) {
            (Exposing::Recorded, Some(log)) => log.at(&camera.pose),
            _ => [1.0; 3],
        };
        Self { full_coverage: finishing.full_coverage, exposure }
    }

    /// Finishes a pixel of premultiplied colour and coverage `A`. Multiplies all four by
    /// `min(1/full_coverage, 1/A)`, which limits coverage to 1, and the colour by the exposure.
    #[inline(always)]
    pub fn apply(&self, [r, g, b, coverage]: [f32; 4]) -> [f32; 4] {
        // The second bound limits coverage to 1. At coverage 0 it is infinite, so the first bound
        // applies.
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
