//! Frames of a dataset in memory, and the held-out views on which models trained on these frames are
//! evaluated.

use crate::bench::findings::BenchError;
use crate::bench::{ViewIndices, each_frame, held_out_views, spaced};
use crate::dataset::Dataset;
use crate::eval::choices::GroundTruth;
use crate::eval::views;
use crate::eval::views::EvalOptions;
use crate::math::measured_pixel::Normalization;
use crate::observation::points::Points;
use crate::pipeline::frame_loop::TypedPreset;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::session::Session;
use crate::render::{RenderMethod, RenderOptions};
use crate::train::paper::config::{PaperConfig, PaperOverrides};
use crate::train::paper::learner::PaperLearner;
use std::ops::Range;
use std::sync::Arc;

/// Points of evenly spaced training frames, for repeated training.
pub struct TrainingSample {
    pub dataset: Arc<Dataset>,
    pub normalization: Normalization,
    pub frames: Vec<Points<f32>>,
    /// Held-out views on which PSNR is measured.
    views: ViewIndices,
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
        let mut frames = Vec::new();
        each_frame(&dataset, &plan, preparation, |_, _, prepared| {
            frames.push(std::mem::take(&mut prepared.observation));
            Ok(())
        })?;
        let views = held_out_views(&dataset, split, n_views);
        Ok(Self { dataset, normalization, frames, views })
    }

    /// Returns the mean PSNR of the held-out views in dB, as in the paper: black background and RGB
    /// without alpha.
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

/// Thins a frame: returns evenly spaced whole tiles with about `n_points` points in total, and at least
/// one tile.
pub fn thin(points: &Points<f32>, n_points: usize) -> Points<f32> {
    let tiles: Vec<usize> = (0..points.n_tiles()).collect();
    // `max` for an empty frame, which has no tiles either.
    let n_tiles = n_points * tiles.len() / points.len().max(1);
    let mut thinned = Points::new();
    // Whole tiles, because search and sums work on tiles (`dataset.md`, Tile order). Points picked
    // one by one would be far apart within a tile and slower to process.
    for tile in spaced(&tiles, n_tiles.max(1)) {
        push_tile(&mut thinned, points, points.tile(tile));
    }
    thinned
}

/// Appends the points of `from` at `indices` as one tile.
pub fn push_tile(to: &mut Points<f32>, from: &Points<f32>, indices: Range<usize>) {
    for i in indices {
        let ([x, y, z], [r, g, b]) = (from.position(i), from.color(i));
        to.push([x, y, z, r, g, b]);
    }
    to.close_tile();
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
    }
}
