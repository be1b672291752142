//! Quality on the pixels where a view's depth camera measured a surface. A model trained on the view must
//! reproduce these, even early in a run.

use super::choices::Views;
use super::comparison::COVERED;
use super::metrics::{MetricError, mean, psnr_masked};
use super::surfaces::Surfaces;
use crate::dataset::{Dataset, FrameEntry};
use crate::math::image::{Image, RgbImage};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;
use std::path::Path;

/// Quality of one view on its seen pixels, where its depth camera measured a surface, or the mean over
/// views.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct SeenQuality {
    /// PSNR over pixels with measured depth, dB.
    pub psnr: f64,
    /// Share of pixels with coverage ≥ 0.5 among those with measured depth.
    pub coverage: f64,
    /// Share of pixels with coverage ≥ 0.5 among those with measured depth away from depth jumps and
    /// holes; `None` if there are no such pixels.
    pub coverage_interior: Option<f64>,
}

impl SeenQuality {
    /// Compares a render with its photograph on the pixels where `surfaces` has depth. All arguments
    /// show the same view at the same size. Returns `None` if no pixel has depth.
    pub(super) fn compare(
        render: &RgbImage,
        coverage: &Image<f32>,
        truth: &RgbImage,
        surfaces: &Surfaces,
    ) -> Result<Option<Self>, MetricError> {
        let mask = surfaces.z.map(|&z| z > 0.0);
        // A mean over no pixels would read as a score.
        let Some(share) = covered_share(coverage, &mask) else { return Ok(None) };
        Ok(Some(Self {
            psnr: psnr_masked(render, truth, &mask)?,
            coverage: share,
            coverage_interior: covered_share(coverage, &surfaces.interior),
        }))
    }

    pub(super) fn mean(views: &[Self]) -> Option<Self> {
        Some(Self {
            psnr: mean(views.iter().map(|v| v.psnr))?,
            coverage: mean(views.iter().map(|v| v.coverage))?,
            coverage_interior: mean(views.iter().filter_map(|v| v.coverage_interior)),
        })
    }
}

fn covered_share(coverage: &Image<f32>, mask: &Image<bool>) -> Option<f64> {
    let (mut n_masked, mut n_covered) = (0usize, 0usize);
    for (&coverage, _) in coverage.data.iter().zip(&mask.data).filter(|(_, masked)| **masked) {
        n_masked += 1;
        n_covered += usize::from(coverage >= COVERED);
    }
    (n_masked > 0).then(|| n_covered as f64 / n_masked as f64)
}

/// Counts the `views` that are also among the trained frames `learnt`.
pub fn learnt_views(dataset: &Dataset, learnt: Views<'_>, views: Views<'_>) -> usize {
    let marks = |(split, frames): Views<'_>| -> Vec<(String, Option<&Path>)> {
        let all = dataset.splits.get(split).map_or(&[][..], |split| &split.frames);
        frames.iter().filter_map(|&i| all.get(i)).map(photograph_key).collect()
    };
    let learnt: HashSet<_> = marks(learnt).into_iter().collect();
    marks(views).iter().filter(|view| learnt.contains(*view)).count()
}

fn photograph_key(frame: &FrameEntry) -> (String, Option<&Path>) {
    // Name and file are the same in every split that contains the frame.
    (frame.name.clone(), frame.color_path())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{SyntheticParams, dataset};
    use crate::math::camera::{Camera, Intrinsics};
    use crate::math::pose::Pose;

    /// One quarter of the image has no depth. Another quarter has depth but no splats, and shows a wrong
    /// colour.
    #[test]
    fn only_pixels_with_depth_count() {
        let (width, height) = (64, 32);
        let quarter = |i: usize| i % width / 16;
        let image = |value: &dyn Fn(usize) -> f32| {
            Image::from_vec(width, height, (0..width * height).map(value).collect())
        };
        let surfaces = Surfaces::new(
            Camera {
                intrinsics: Intrinsics::from_horizontal_fov(64, 32, 0.9),
                pose: Pose::IDENTITY,
            },
            image(&|i| if quarter(i) == 0 { 0.0 } else { 2.0 }),
            [0.05, 0.0],
        );
        let coverage = image(&|i| if quarter(i) == 3 { 0.4 } else { 0.9 });
        let render = coverage.map(|&a| if a < 0.5 { [0.0; 3] } else { [0.5; 3] });
        let truth = image(&|i| if quarter(i) == 0 { 1.0 } else { 0.5 }).map(|&v| [v; 3]);
        let seen = SeenQuality::compare(&render, &coverage, &truth, &surfaces).unwrap().unwrap();
        assert!((seen.psnr - -10.0 * (0.25f64 / 3.0).log10()).abs() < 1e-9);
        assert_eq!(seen.coverage, 2.0 / 3.0);
        // The edge takes six columns: the first with depth, and five more.
        assert_eq!(seen.coverage_interior, Some((32.0 - 6.0) / (48.0 - 6.0)));

        let nothing = Surfaces::new(surfaces.camera, image(&|_| 0.0), [0.05, 0.0]);
        assert_eq!(SeenQuality::compare(&render, &coverage, &truth, &nothing), Ok(None));
        let mean = SeenQuality::mean(&[
            seen,
            SeenQuality { psnr: 0.0, coverage: 0.0, coverage_interior: None },
        ]);
        let mean = mean.unwrap();
        assert_eq!((mean.coverage, mean.coverage_interior), (1.0 / 3.0, seen.coverage_interior));
        assert_eq!(SeenQuality::mean(&[]), None);
    }

    #[test]
    fn frames_count_whatever_their_split_is_called() {
        let small = SyntheticParams {
            width: 16,
            height: 12,
            n_train: 6,
            n_eval: 2,
            ..SyntheticParams::demo()
        };
        let mut room = dataset(&small).unwrap();
        assert_eq!(learnt_views(&room, (0, &[0, 1, 2, 2]), (0, &[1, 2, 3])), 2);
        assert_eq!(learnt_views(&room, (0, &[0, 1]), (1, &[0, 1])), 0);
        room.splits[1].frames = room.splits[0].frames[..2].to_vec();
        assert_eq!(learnt_views(&room, (0, &[0, 5]), (1, &[0, 1])), 1);
        assert_eq!(learnt_views(&room, (7, &[0]), (0, &[0, 99])), 0);
    }
}
