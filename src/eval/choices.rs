//! Options of a comparison that reports state.

use super::comparison::COVERED;
use super::cracks;
use super::report::{EvalReport, SeenReport, ViewReport};
use super::views::{EvalError, EvalOptions, evaluate};
use crate::dataset::Dataset;
use crate::math::image::{Image, RgbImage};
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::Rendered;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Reference of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundTruth {
    /// Photograph composited with straight alpha over the render's background: the fair comparison.
    Composited,
    /// RGB bytes with alpha dropped, as in the paper.
    Rgb,
}

/// Treatment of pixels that splats cover partially.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PartialCoverage {
    /// The background shows through, as renderers draw it.
    Composited,
    /// The splats' colour divided by its coverage, where that is at least
    /// [`COVERED`](super::comparison::COVERED): the result of filling all cracks (`evaluation.md`,
    /// Partial coverage).
    Divided,
}

/// Camera poses of evaluated views.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    Display,
    EnumString,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ViewPoses {
    /// As recorded.
    #[default]
    Recorded,
    /// Corrected like the surrounding training frames; as recorded if no pose was corrected.
    Corrected,
}

/// Colours of the splats without the background, where coverage is at least [`COVERED`].
pub(super) fn divide_by_coverage(rendered: &Rendered, background: [f32; 3]) -> RgbImage {
    let (color, coverage) = (&rendered.color, &rendered.coverage);
    let pixel = |(color, &coverage): (&[f32; 3], &f32)| {
        // With less coverage the colour is too uncertain to divide.
        if coverage < COVERED {
            return *color;
        }
        let behind = background.map(|b| (1.0 - coverage) * b);
        std::array::from_fn(|i| ((color[i] - behind[i]) / coverage).clamp(0.0, 1.0))
    };
    let pixels = color.data.iter().zip(&coverage.data).map(pixel);
    Image::from_vec(color.width, color.height, pixels.collect())
}

/// Numbers of trained frames after which [`seen`] is measured: the first frame, a first turn around, and
/// most of a short recording.
pub const SEEN_AFTER: [usize; 3] = [1, 10, 50];

/// Views of a dataset: index of the split and frame indices in it.
pub type Views<'a> = (usize, &'a [usize]);

/// Scores views of one renderer against their photographs and, if `crack_views` is given
/// ([`cracks::views`]), measures cracks. `progress` receives the number of [`n_steps`] done.
///
/// # Errors
/// [`EvalError`] if a photograph does not fit or no view is usable; single unusable views are listed in the
/// report.
pub fn measure_quality(
    splats: SplatView<'_>,
    dataset: &Dataset,
    (split, views): Views<'_>,
    crack_views: Option<Views<'_>>,
    options: &EvalOptions,
    mut progress: impl FnMut(usize),
) -> Result<(EvalReport, Vec<ViewReport>), EvalError> {
    let (mut report, scores) = evaluate(splats, dataset, split, views, options, &mut progress)?;
    if let Some(crack_views) = crack_views {
        // Cracks are measured after the views, so their count continues.
        let tell = |done| progress(views.len() + done);
        report.cracks = cracks::measure(splats, dataset, crack_views, &options.render, tell);
    }
    Ok((report, scores))
}

/// Number of steps of [`quality`].
pub fn n_steps((_, views): Views<'_>, crack_views: Option<Views<'_>>) -> usize {
    views.len() + crack_views.map_or(0, |(_, frames)| frames.len())
}

/// Quality on the pixels seen by the frames trained on so far; `None` if no frame has depth.
///
/// # Errors
/// As [`quality`].
pub fn seen(
    splats: SplatView<'_>,
    dataset: &Dataset,
    (split, frames): Views<'_>,
    options: &EvalOptions,
) -> Result<Option<SeenReport>, EvalError> {
    let (report, _) = evaluate(splats, dataset, split, frames, options, |_| ())?;
    // The number of scored views equals that of trained frames: unusable files count as neither.
    let EvalReport { views: after_frames, renderer, seen_mean, .. } = report;
    Ok(seen_mean.map(|seen| SeenReport { after_frames, renderer, seen }))
}

#[cfg(test)]
mod partial_coverage_tests {
    use super::*;

    #[test]
    fn coverage_is_divided_out_where_it_is_known() {
        let background = [0.5, 0.0, 1.0];
        let color = [0.4, 0.2, 0.6];
        let over = |coverage: f32| -> [f32; 3] {
            std::array::from_fn(|i| coverage * color[i] + (1.0 - coverage) * background[i])
        };
        let shares = [1.0, 0.75, 0.5, 0.25];
        let image = Rendered {
            color: Image::from_vec(4, 1, shares.map(over).to_vec()),
            coverage: Image::from_vec(4, 1, shares.to_vec()),
            depth: Image::filled(4, 1, 0.0),
            n_invalid: 0,
        };
        let found = divide_by_coverage(&image, background).data;
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6);
        assert!(found[..3].iter().all(|&pixel| near(pixel, color)), "{found:?}");
        assert!(near(found[3], over(0.25)));
    }
}
