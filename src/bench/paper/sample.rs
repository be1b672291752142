//! Frames of a dataset in memory, and the held-out views that measure a model trained on them.

use crate::bench::findings::BenchError;
use crate::dataset::Dataset;
use crate::eval::choices::GroundTruth;
use crate::eval::views;
use crate::eval::views::EvalOptions;
use crate::math::measured_pixel::Normalization;
use crate::observation::points::Points;
use crate::pipeline::frame_loop::TypedPreset;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::prefetch::Prefetch;
use crate::pipeline::session::Session;
use crate::render::{RenderMethod, RenderOptions};
use crate::train::paper::config::{PaperConfig, PaperOverrides};
use crate::train::paper::learner::PaperLearner;
use std::sync::Arc;

/// Points of evenly spaced training frames, for repeated training.
pub struct TrainingSample {
    pub dataset: Arc<Dataset>,
    pub normalization: Normalization,
    pub frames: Vec<Points<f32>>,
    /// Split and frame indices of the held-out views.
    views: (usize, Vec<usize>),
}

impl TrainingSample {
    /// Decodes up to `n_frames` evenly spaced training frames. Unusable frames are skipped.
    pub fn load(
        dataset: Arc<Dataset>,
        n_frames: usize,
        n_views: usize,
    ) -> Result<Self, BenchError> {
        // The session only provides the plan and the unprojection settings. One component avoids
        // allocating a model of the paper's size.
        let small = PaperOverrides { components: Some(1), ..PaperOverrides::default() };
        let config = PaperConfig::paper().with(&small)?;
        let session = Session::new(dataset.clone(), config.clone(), Selection::all_frames())?;
        let (split, chosen) = (session.plan().split, spaced(&session.plan().frames, n_frames));
        let normalization = *session.normalization();
        let preparation = config.preparation(session.config(), normalization);
        drop(session);
        let plan = Plan { split, frames: chosen, held_out: None };
        let mut prefetch = Prefetch::start(dataset.clone(), &plan, 0, preparation)?;
        let results = std::iter::from_fn(|| prefetch.next_frame()).map(|frame| frame.result);
        let mut first_problem = None;
        let frames: Vec<_> = results
            .filter_map(|result| match result {
                Ok(prepared) => Some(prepared.observation),
                Err(problem) => {
                    first_problem.get_or_insert(problem);
                    None
                }
            })
            .collect();
        if frames.is_empty() {
            let first = first_problem.unwrap_or_else(|| "no frame is selected".to_owned());
            return Err(BenchError::NoFrame { dataset: dataset.name.clone(), first });
        }
        let held_out = dataset.evaluation(split).new_views;
        let views = (held_out.split, spaced(&held_out.frames, n_views));
        Ok(Self { dataset, normalization, frames, views })
    }

    /// Mean PSNR of the held-out views in dB: black background, against RGB without alpha, as in
    /// the paper.
    pub fn psnr(&self, engine: &dyn PaperLearner, config: &PaperConfig) -> Result<f64, BenchError> {
        // The engine was trained in model coordinates, so its splats are converted to world here.
        let splat =
            |k| config.conversion.splat(&engine.component(k).posterior, &self.normalization);
        let splats: Vec<_> = (0..engine.status().components).map(splat).collect();
        let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let options = EvalOptions::plain(GroundTruth::Rgb, render);
        let (split, views) = &self.views;
        let (report, _) = views::evaluate(&splats, &self.dataset, *split, views, &options, |_| ())?;
        Ok(report.means.psnr_mean)
    }

    pub fn n_views(&self) -> usize {
        self.views.1.len()
    }

    pub fn thinned(&self, n_points: usize) -> Vec<Points<f32>> {
        self.frames.iter().map(|frame| thin(frame, n_points)).collect()
    }
}

/// Returns up to `n` evenly spaced items.
pub(in crate::bench) fn spaced<T: Copy>(items: &[T], n: usize) -> Vec<T> {
    let n = n.min(items.len());
    (0..n).map(|i| items[i * items.len() / n]).collect()
}

/// Returns evenly spaced whole tiles of a frame with about `n_points` points in total, at least one
/// tile.
pub fn thin(points: &Points<f32>, n_points: usize) -> Points<f32> {
    let tiles: Vec<usize> = (0..points.n_tiles()).collect();
    let n_tiles = n_points * tiles.len() / points.len().max(1);
    let mut thinned = Points::new();
    // Whole tiles, because search and sums work on tiles (`dataset.md`, Tile order). Points picked
    // one by one would be far apart within a tile and slower to process.
    for tile in spaced(&tiles, n_tiles.max(1)) {
        for i in points.tile(tile) {
            let ([x, y, z], [r, g, b]) = (points.position(i), points.color(i));
            thinned.push([x, y, z, r, g, b]);
        }
        thinned.close_tile();
    }
    thinned
}

pub fn count(frames: &[Points<f32>]) -> usize {
    frames.iter().map(Points::len).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_whole_tiles_evenly() {
        let rows: Vec<[f64; 6]> = (0..640).map(|i| [f64::from(i); 6]).collect();
        let thinned = thin(&Points::from_rows(&rows), 130);
        assert_eq!((thinned.len(), thinned.n_tiles()), (128, 2));
        assert_eq!([thinned.x[0], thinned.x[64]], [0.0, 320.0]);
        assert_eq!(thin(&Points::from_rows(&rows), 1).len(), 64);
        assert_eq!(spaced(&[1, 2, 3], 9), [1, 2, 3]);
    }
}
