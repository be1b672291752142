//! Options of an evaluation that appear in reports, and the measurements that a report needs.

use super::cracks;
use super::report::{EvalReport, SeenReport, ViewReport};
use super::views::{EvalError, EvalOptions, evaluate};
use crate::dataset::Dataset;
use crate::model::splat::appearance::SplatView;
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Reference image with which a render is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum GroundTruth {
    /// Photograph composited with straight alpha over the background of the render.
    Composited,
    /// RGB bytes of the photograph without its alpha, as in the paper.
    Rgb,
}

/// Selects the camera poses from which evaluated views are rendered.
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
    /// Poses as recorded.
    #[default]
    Recorded,
    /// Poses corrected like those of the surrounding training frames; poses as recorded if training
    /// corrected none.
    Corrected,
}

/// Numbers of frames trained on after which [`seen`] is called: one frame, a first pan around the
/// scene, and most of a short recording.
pub const SEEN_AFTER: [usize; 3] = [1, 10, 50];

/// Views of a dataset: index of the split and frame indices in it.
pub type Views<'a> = (usize, &'a [usize]);

/// Scores views against their photographs and, if `crack_views` is given ([`cracks::views`]), measures
/// cracks. `progress` receives the number of steps done, of [`n_steps`] in total.
///
/// # Errors
/// [`EvalError`] if a render and its photograph cannot be compared or no view is usable. Single unusable
/// views are listed in the report instead.
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
        let count = |done| progress(views.len() + done);
        report.cracks = cracks::measure(splats, dataset, crack_views, &options.render, count);
    }
    Ok((report, scores))
}

/// Returns the number of steps of [`measure_quality`].
pub fn n_steps((_, views): Views<'_>, crack_views: Option<Views<'_>>) -> usize {
    views.len() + crack_views.map_or(0, |(_, frames)| frames.len())
}

/// Measures quality on the pixels where depth cameras measured a surface, in views of all frames trained
/// on so far. Returns `None` if no frame has depth.
///
/// # Errors
/// As [`measure_quality`].
pub fn seen(
    splats: SplatView<'_>,
    dataset: &Dataset,
    (split, frames): Views<'_>,
    options: &EvalOptions,
) -> Result<Option<SeenReport>, EvalError> {
    let (report, _) = evaluate(splats, dataset, split, frames, options, |_| ())?;
    // As many views are scored as frames were trained: unusable files count as neither.
    let EvalReport { views: after_frames, protocol, means, .. } = report;
    let renderer = protocol.renderer;
    Ok(means.seen_mean.map(|seen| SeenReport { after_frames, renderer, seen }))
}
