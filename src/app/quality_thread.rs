//! The thread that measures held-out views beside training, and what it is asked.

use super::panic_report::PanicReport;
use super::view_thread::ViewThread;
use super::worker::Waker;
use crate::dataset::Dataset;
use crate::eval::near::{NearRule, near_plane};
use crate::eval::report::ViewReport;
use crate::eval::views::{EvalOptions, evaluate};
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What a measurement is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QualityPurpose {
    /// The quality, on views that were held out.
    HeldOut,
    /// The quality off the camera's way.
    FromTheSide,
    /// What is kept of frames that were trained.
    Retention,
}

/// What is measured: frames of a split of a dataset, with these settings.
#[derive(Clone)]
pub struct QualityQuery {
    pub purpose: QualityPurpose,
    pub dataset: Arc<Dataset>,
    pub split: usize,
    pub views: Vec<usize>,
    /// All that will be measured: the near plane is one for them.
    pub all: Vec<usize>,
    pub options: EvalOptions,
    pub near_rule: NearRule,
    /// When: frames, seconds and components.
    pub at: (usize, f64, usize),
    /// Whether what waits to be learnt is drawn.
    pub settled: bool,
}

impl QualityQuery {
    /// With the near plane that these views are measured with.
    fn options_for(&self, splats: &SplatSet) -> EvalOptions {
        let frames = &self.dataset.splits[self.split].frames;
        let cameras: Vec<Camera> = self.all.iter().map(|&view| frames[view].camera).collect();
        let near = near_plane(splats.view(), &cameras, self.near_rule);
        EvalOptions { render: RenderOptions { near, ..self.options.render }, ..self.options }
    }
}

/// What came of it.
pub struct QualityAnswer {
    pub query: QualityQuery,
    pub scores: Result<Vec<ViewReport>, String>,
    pub took: Duration,
}

/// Starts the thread.
pub fn start(waker: Waker) -> std::io::Result<ViewThread<QualityQuery, QualityAnswer>> {
    // In rayon's global pool measuring would take every core, those of the trainer included.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let alone = alone.map_err(std::io::Error::other)?;
    ViewThread::start("quality", waker, move |splats: &SplatSet, query: QualityQuery| {
        let started = Instant::now();
        let QualityQuery { dataset, split, views, .. } = &query;
        let options = query.options_for(splats);
        let measure = || evaluate(splats, dataset, *split, views, &options, |_| {});
        let scores = measured(|| {
            let (_, scores) = alone.install(measure).map_err(|error| error.to_string())?;
            Ok(scores)
        });
        QualityAnswer { scores, took: started.elapsed(), query }
    })
}

/// What was measured, or why nothing can be: a figure is no reason to close the window, and nothing of the
/// measuring outlives its panic.
fn measured(
    measure: impl FnOnce() -> Result<Vec<ViewReport>, String>,
) -> Result<Vec<ViewReport>, String> {
    catch_unwind(AssertUnwindSafe(measure))
        .unwrap_or_else(|panic| Err(PanicReport::of(&*panic).ended("measuring the quality")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_measuring_is_a_problem_that_is_told() {
        let problem = measured(|| panic!("injected into measuring")).unwrap_err();
        for part in ["injected into measuring", "the quality", "report it"] {
            assert!(problem.contains(part), "{part:?} is missing in: {problem}");
        }
        assert_eq!(measured(|| Ok(Vec::new())).unwrap().len(), 0);
    }
}
