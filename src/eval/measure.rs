//! The one place that measures a model: its views, the cracks between its splats, and what it shows
//! of the frames it was learnt from. Command line, benches and reports all take their numbers here,
//! so that two tables never differ in what they mean by quality.

use super::cracks;
use super::report::{EvalReport, SeenReport, ViewReport};
use super::views::{EvalError, EvalOptions, evaluate};
use crate::dataset::Dataset;
use crate::model::splat::appearance::SplatView;

/// Numbers of learnt frames after which [`seen`] is worth a look: the first frame, a first turn
/// around, and most of a short recording.
pub const SEEN_AFTER: [usize; 3] = [1, 10, 50];

/// Views of a dataset by split and positions in it.
pub type Views<'a> = (usize, &'a [usize]);

/// Scores the views of one renderer against their photographs and, where `crack_views`
/// ([`cracks::views`]) names any, looks for cracks in those. `progress` hears how many of
/// [`n_steps`] are done.
///
/// # Errors
/// [`EvalError`] if a photograph does not fit or no view can be used; unusable views among usable
/// ones are listed in the report.
pub fn quality(
    splats: SplatView<'_>,
    dataset: &Dataset,
    (split, views): Views<'_>,
    crack_views: Option<Views<'_>>,
    options: &EvalOptions,
    mut progress: impl FnMut(usize),
) -> Result<(EvalReport, Vec<ViewReport>), EvalError> {
    let (mut report, scores) = evaluate(splats, dataset, split, views, options, &mut progress)?;
    if let Some(crack_views) = crack_views {
        // Cracks follow the views, so their count goes on from there.
        let tell = |done| progress(views.len() + done);
        report.cracks = cracks::measure(splats, dataset, crack_views, &options.render, tell);
    }
    Ok((report, scores))
}

/// Views that [`quality`] goes through.
pub fn n_steps((_, views): Views<'_>, crack_views: Option<Views<'_>>) -> usize {
    views.len() + crack_views.map_or(0, |(_, frames)| frames.len())
}

/// What splats show on the pixels that the frames learnt so far saw; `None` if no frame has depth.
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
    // As many views could be scored as frames were learnt: unusable files are neither.
    let EvalReport { views: after_frames, renderer, seen_mean, .. } = report;
    Ok(seen_mean.map(|seen| SeenReport { after_frames, renderer, seen }))
}
