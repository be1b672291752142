//! Quality of splats on the views of a split, by every renderer asked for.

use super::args::{ComparisonArgs, GroundTruthName};
use super::failure::Failure;
use super::{output, progress};
use vbgs_studio::dataset::Dataset;
use vbgs_studio::eval::report::{EvalReport, ViewReport};
use vbgs_studio::eval::views::{self, EvalOptions, GroundTruth};
use vbgs_studio::model::splats::Splat;
use vbgs_studio::render::{Method, RenderOptions};

/// Measures the listed views renderer by renderer; the views of one renderer stay together.
pub fn measure(
    splats: &[Splat],
    dataset: &Dataset,
    (split, frames): (usize, &[usize]),
    comparison: &ComparisonArgs,
    methods: &[Method],
) -> Result<Vec<(EvalReport, Vec<ViewReport>)>, Failure> {
    let bar = progress::bar(methods.len() * frames.len(), "view");
    let mut found = Vec::with_capacity(methods.len());
    for (i, &method) in methods.iter().enumerate() {
        let options = options(comparison, method);
        let tell = |done| bar.set_position((i * frames.len() + done) as u64);
        found.push(views::evaluate(splats, dataset, split, frames, &options, tell)?);
    }
    bar.finish_and_clear();
    // What cannot be read is the same for every renderer.
    if let Some((report, _)) = found.first() {
        output::skipped_views(dataset, report);
    }
    Ok(found)
}

fn options(comparison: &ComparisonArgs, method: Method) -> EvalOptions {
    EvalOptions {
        ground_truth: match comparison.ground_truth {
            GroundTruthName::Composited => GroundTruth::Composited,
            GroundTruthName::Rgb => GroundTruth::Rgb,
        },
        render: RenderOptions::evaluation(method, comparison.background),
    }
}
