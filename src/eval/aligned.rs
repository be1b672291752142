//! Score of a view at its aligned pose: the remaining error is the model's, not the pose's (`eval.md`,
//! Poses aligned).

use super::comparison::{Comparison, compare};
use super::metrics::mean_std;
use super::sharpness::{self, N_BANDS, SharpnessBand};
use super::sizes::MetricError;
use crate::math::image::{Image, RgbImage};
use crate::math::pose::Pose;
use glam::DQuat;
use serde::{Deserialize, Serialize};

/// Quality of a view rendered from the pose aligned to its photograph, or the mean over views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AlignedView {
    /// Distance of the aligned pose from the original one, world units.
    pub shift: f64,
    /// Angle between both poses, degrees.
    pub turn: f64,
    /// PSNR over the whole frame, dB.
    pub psnr: f64,
    /// PSNR over covered pixels, dB.
    pub psnr_covered: f64,
    /// PSNR over covered pixels with colours aligned, dB.
    pub psnr_aligned_covered: f64,
    /// SSIM, `valid` padding.
    pub ssim: f64,
    /// SSIM with colours aligned.
    pub ssim_aligned: f64,
    /// SSIM of the gradient magnitudes with colours aligned.
    pub gradient_ssim: f64,
    /// Sharpness per octave from the finest, with colours aligned.
    pub bands: [SharpnessBand; N_BANDS],
}

impl AlignedView {
    /// Compares the render from the aligned camera with the photograph. `None` if no pixel is covered or
    /// the photograph has no detail.
    ///
    /// # Errors
    /// The images differ in size, or are smaller than an SSIM window.
    pub fn compare(
        [from, to]: [&Pose; 2],
        shown: &RgbImage,
        coverage: &Image<f32>,
        truth: &RgbImage,
    ) -> Result<Option<Self>, MetricError> {
        let Comparison { psnr, ssim, covered, .. } = compare(shown, coverage, truth)?;
        let Some(covered) = covered else { return Ok(None) };
        // At the photograph's exposure: a darker render has less energy but is not less sharp.
        let exposed = covered.alignment.apply(shown, coverage);
        let Some(bands) = sharpness::bands(&exposed, coverage, truth) else { return Ok(None) };
        let turn = DQuat::from_mat3(&(from.rotation().transpose() * to.rotation()));
        Ok(Some(Self {
            shift: (to.centre() - from.centre()).length(),
            turn: turn.to_scaled_axis().length().to_degrees(),
            psnr,
            psnr_covered: covered.psnr,
            psnr_aligned_covered: covered.aligned_psnr,
            ssim,
            ssim_aligned: covered.aligned_ssim,
            gradient_ssim: sharpness::gradient_ssim(&exposed, truth)?,
            bands,
        }))
    }

    /// Mean over views; `None` without views.
    pub fn mean(views: &[Self]) -> Option<Self> {
        let mean =
            |value: fn(&Self) -> f64| mean_std(&views.iter().map(value).collect::<Vec<_>>()).0;
        let bands: Vec<_> = views.iter().map(|view| view.bands).collect();
        Some(Self {
            bands: sharpness::mean(&bands)?,
            shift: mean(|view| view.shift),
            turn: mean(|view| view.turn),
            psnr: mean(|view| view.psnr),
            psnr_covered: mean(|view| view.psnr_covered),
            psnr_aligned_covered: mean(|view| view.psnr_aligned_covered),
            ssim: mean(|view| view.ssim),
            ssim_aligned: mean(|view| view.ssim_aligned),
            gradient_ssim: mean(|view| view.gradient_ssim),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use glam::DVec3;

    /// Exposure is compensated before detail is compared; shifts are in world units, turns in degrees.
    #[test]
    fn a_darker_view_is_as_sharp() {
        let mut rng = Rng::new(5, Purpose::Synthetic, 0);
        let pixel = |_| std::array::from_fn(|_| (0.2 + 0.5 * rng.uniform()) as f32);
        let truth = Image::from_vec(32, 24, (0..32 * 24).map(pixel).collect());
        let dark = truth.map(|p| p.map(|v| 0.5 * v));
        let turn = DQuat::from_rotation_y(0.5f64.to_radians());
        let to = Pose::IDENTITY.attached_camera(DVec3::new(0.0, 0.03, 0.04), turn);
        let coverage = Image::filled(32, 24, 1.0);
        let poses = [&Pose::IDENTITY, &to];
        let view = AlignedView::compare(poses, &dark, &coverage, &truth).unwrap().unwrap();
        assert!((view.shift - 0.05).abs() < 1e-9 && (view.turn - 0.5).abs() < 1e-6, "{view:?}");
        assert!(view.psnr < 15.0 && view.psnr_aligned_covered > 80.0, "{view:?}");
        assert!(view.bands.iter().all(|band| (band.energy_ratio - 1.0).abs() < 1e-3), "{view:?}");
        assert!(view.gradient_ssim > 0.999, "{view:?}");
        let other = AlignedView { shift: 0.15, ..view };
        assert!((AlignedView::mean(&[view, other]).unwrap().shift - 0.1).abs() < 1e-9);
        assert_eq!(AlignedView::mean(&[]), None);
        let nothing = AlignedView::compare(poses, &dark, &coverage.map(|_| 0.1), &truth).unwrap();
        assert_eq!(nothing, None);
    }
}
