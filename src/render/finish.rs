//! Post-processing of blended pixels: crack filling, then exposure.
//!
//! Neighbouring splats never cover a surface completely: background shows through where their edges
//! meet. Wider splats would close such cracks but blur the image. Instead a pixel counts as fully covered
//! once its coverage reaches the scene's `full_coverage` (1 disables filling). Below that value, coverage and
//! colour are scaled up in proportion.
//!
//! Exposure multiplies the splats' colour by the exposure recorded near the view
//! ([`crate::model::splat::pose_log`]).

use super::options::{Exposing, RenderOptions};
use crate::math::camera::Camera;
use crate::model::splat::appearance::Finishing;

/// Crack filling and exposure of one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finish {
    /// Coverage at which a pixel counts as fully covered, in `(0, 1]`.
    pub full_coverage: f32,
    /// Exposure factors of red, green and blue.
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

    /// Applies crack filling and exposure to a pixel of premultiplied colour and coverage `A`.
    /// Multiplies all four values by `min(1/full_coverage, 1/A)`, which limits coverage to 1, and the
    /// colour by the exposure.
    #[inline(always)]
    pub fn apply(&self, [r, g, b, coverage]: [f32; 4]) -> [f32; 4] {
        // The second bound limits coverage to 1. At coverage 0 it is infinite, so the first bound
        // applies.
        let factor = (1.0 / self.full_coverage).min(1.0 / coverage);
        let [red, green, blue] = self.exposure;
        [r * factor * red, g * factor * green, b * factor * blue, coverage * factor]
    }
}

/// Coefficients of a polynomial per channel that approximates the viridis colour map, one row per
/// power, constant first. Fitted by least squares to the map's 256 entries; maximum error 0.01. Viridis
/// is perceptually uniform, also with colour blindness.
pub const RAMP: [[f32; 3]; 7] = [
    [0.277_727_3, 0.005_407_345, 0.334_099_8],
    [0.105_093_04, 1.404_613_5, 1.384_590_2],
    [-0.330_861_83, 0.214_847_56, 0.095_095_16],
    [-4.634_230_5, -5.799_101, -19.332_44],
    [6.228_27, 14.179_934, 56.690_55],
    [4.776_385, -13.745_145, -65.353_03],
    [-5.435_456, 4.645_852_6, 26.312_435],
];

/// Stored colour that marks a splat, for example as selected. A splat of exactly this colour keeps it
/// under every paint. Neither the ramp nor recorded colours come near it, and trained colours do not
/// match its digits exactly.
pub const MARKER_COLOR: [f32; 3] = [1.0, 0.353, 0.863];

/// Returns the colour at `share` of the viridis ramp: dark violet at 0, yellow at 1. Values outside are
/// clamped; NaN counts as 0.
pub fn ramp(share: f32) -> [f32; 3] {
    // `clamp` keeps NaN, and a NaN colour would spread through blending.
    let t = if share.is_nan() { 0.0 } else { share.clamp(0.0, 1.0) };
    std::array::from_fn(|channel| {
        let sum = RAMP.iter().rev().fold(0.0, |sum, row| sum * t + row[channel]);
        // The fit errs by up to 0.01 and may leave the range of colours.
        sum.clamp(0.0, 1.0)
    })
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

    #[test]
    fn the_ramp_runs_from_violet_to_yellow_and_never_gets_darker() {
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.02);
        assert!(near(ramp(0.0), [0.267, 0.005, 0.329]) && near(ramp(1.0), [0.993, 0.906, 0.144]));
        assert!(near(ramp(0.5), [0.128, 0.567, 0.551]));
        assert_eq!((ramp(-3.0), ramp(f32::NAN), ramp(7.0)), (ramp(0.0), ramp(0.0), ramp(1.0)));
        let luma = |c: [f32; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        let steps: Vec<f32> = (0..=64).map(|i| luma(ramp(i as f32 / 64.0))).collect();
        assert!(steps.windows(2).all(|pair| pair[1] > pair[0] - 1e-3));
    }
}
