//! Thread that measures held-out views during training.

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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum QualityPurpose {
    HeldOut,
    /// Quality on views from the side, away from the camera path.
    FromTheSide,
    Retention,
}

#[derive(Clone)]
pub struct QualityQuery {
    pub purpose: QualityPurpose,
    pub dataset: Arc<Dataset>,
    pub split: usize,
    pub views: Vec<usize>,
    /// All views of the series of measurements, which share one near plane.
    pub all: Vec<usize>,
    pub options: EvalOptions,
    pub near_rule: NearRule,
    /// Frames, seconds and components at the time of the query.
    pub at: (usize, f64, usize),
    /// True if pending photographs are part of the scene.
    pub settled: bool,
}

impl QualityQuery {
    /// Render options with the near plane of this series.
    fn options_for(&self, splats: &SplatSet) -> EvalOptions {
        let frames = &self.dataset.splits[self.split].frames;
        let cameras: Vec<Camera> = self.all.iter().map(|&view| frames[view].camera).collect();
        let near = near_plane(splats.view(), &cameras, self.near_rule);
        EvalOptions { render: RenderOptions { near, ..self.options.render }, ..self.options }
    }
}

pub struct QualityAnswer {
    pub query: QualityQuery,
    pub scores: Result<Vec<ViewReport>, String>,
    pub took: Duration,
}

pub fn start(waker: Waker) -> std::io::Result<ViewThread<QualityQuery, QualityAnswer>> {
    // In rayon's global pool measuring would use every core, including those of training.
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let alone = alone.map_err(std::io::Error::other)?;
    ViewThread::start("quality", waker, move |splats: &SplatSet, query: QualityQuery| {
        let started = Instant::now();
        let QualityQuery { dataset, split, views, .. } = &query;
        let options = query.options_for(splats);
        let measure = || evaluate(splats, dataset, *split, views, &options, |_| {});
        let scores = catch_measurement(|| {
            let (_, scores) = alone.install(measure).map_err(|error| error.to_string())?;
            Ok(scores)
        });
        QualityAnswer { scores, took: started.elapsed(), query }
    })
}

/// Returns the metrics, or the reason of a failure. A panic is caught: a metric is no reason to close
/// the window, and no state of the measurement outlives it.
fn catch_measurement(
    measure: impl FnOnce() -> Result<Vec<ViewReport>, String>,
) -> Result<Vec<ViewReport>, String> {
    catch_unwind(AssertUnwindSafe(measure)).unwrap_or_else(|panic| {
        Err(PanicReport::of(&*panic).failure_notice("measuring the quality"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_of_measuring_is_a_problem_that_is_told() {
        let problem = catch_measurement(|| panic!("injected into measuring")).unwrap_err();
        for part in ["injected into measuring", "the quality", "report it"] {
            assert!(problem.contains(part), "{part:?} is missing in: {problem}");
        }
        assert_eq!(catch_measurement(|| Ok(Vec::new())).unwrap().len(), 0);
    }
}
