//! Quality of splats on the views of a split, by every renderer asked for.

use super::args::{ComparisonArgs, GroundTruthName};
use super::failure::Failure;
use super::{output, progress};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::calibration::ColorCamera;
use vbgs_studio::eval::cracks;
use vbgs_studio::eval::report::{EvalReport, SeenReport, ViewReport};
use vbgs_studio::eval::views::{self, EvalOptions, GroundTruth};
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::{Method, RenderOptions};

/// How splats are compared with photographs.
pub struct Comparison<'a> {
    /// What was asked for.
    pub args: &'a ComparisonArgs,
    /// The camera that took the photographs, if not the one that measured depth.
    pub color_camera: Option<ColorCamera>,
    /// Renderers, one after the other.
    pub methods: &'a [Method],
}

/// Measures the listed views renderer by renderer; the views of one renderer stay together.
pub fn measure(
    splats: SplatView,
    dataset: &Dataset,
    (split, frames): (usize, &[usize]),
    comparison: &Comparison,
) -> Result<Vec<(EvalReport, Vec<ViewReport>)>, Failure> {
    let methods = comparison.methods;
    if comparison.color_camera.is_some() {
        eprintln!(
            "note: photographs are compared with what their own camera sees, not the depth camera"
        );
    }
    let crack_views = cracks::views(dataset, split, frames);
    let n_crack_views = crack_views.as_ref().map_or(0, |(_, frames)| frames.len());
    let n_views = frames.len() + n_crack_views;
    let bar = progress::bar(methods.len() * n_views, "view");
    let mut found = Vec::with_capacity(methods.len());
    for (i, &method) in methods.iter().enumerate() {
        let options = comparison.options(method);
        let tell = |done| bar.set_position((i * n_views + done) as u64);
        let (mut report, scores) = views::evaluate(splats, dataset, split, frames, &options, tell)?;
        if let Some((split, crack_frames)) = &crack_views {
            let tell = |done| tell(frames.len() + done);
            report.cracks =
                cracks::measure(splats, dataset, (*split, crack_frames), &options.render, tell);
        }
        found.push((report, scores));
    }
    bar.finish_and_clear();
    // What cannot be read is the same for every renderer.
    if let Some((report, _)) = found.first() {
        output::skipped_views(dataset, report);
    }
    Ok(found)
}

/// Numbers of learnt frames after which [`seen`] is worth a look.
pub const SEEN_AFTER: [usize; 3] = [1, 10, 50];

/// Measures what splats show of the frames they were learnt from.
pub fn seen(
    splats: SplatView,
    dataset: &Dataset,
    (split, frames): (usize, &[usize]),
    comparison: &Comparison,
) -> Result<Vec<SeenReport>, Failure> {
    let mut found = Vec::with_capacity(comparison.methods.len());
    for &method in comparison.methods {
        let options = comparison.options(method);
        let (report, _) = views::evaluate(splats, dataset, split, frames, &options, |_| ())?;
        let EvalReport { views: after_frames, renderer, seen_mean, .. } = report;
        found.extend(seen_mean.map(|seen| SeenReport { after_frames, renderer, seen }));
    }
    Ok(found)
}

impl Comparison<'_> {
    fn options(&self, method: Method) -> EvalOptions {
        let ComparisonArgs { ground_truth, background, partial_coverage, exposure } = *self.args;
        EvalOptions {
            ground_truth: match ground_truth {
                GroundTruthName::Composited => GroundTruth::Composited,
                GroundTruthName::Rgb => GroundTruth::Rgb,
            },
            partial_coverage,
            color_camera: self.color_camera,
            render: RenderOptions {
                exposing: exposure,
                ..RenderOptions::evaluation(method, background)
            },
        }
    }
}
