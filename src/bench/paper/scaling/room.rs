//! Frames of the synthetic room at any number of points.

use super::row::MeanPlacement;
use crate::bench::findings::BenchError;
use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::range;
use crate::dataset::synthetic::{self, SyntheticParams};
use crate::dataset::unproject::{CameraConvention, EdgeFilter, UnprojectSettings, Unprojector};
use crate::observation::points::Points;
use crate::pipeline::error::SessionError;
use crate::train::paper::init::InitialDraw;

/// A frame to train on, and points of other frames for means on surfaces.
pub struct RoomFrames {
    /// Points that are trained on, model coordinates.
    pub frame: Points<f32>,
    others: Points<f32>,
}

/// Frames whose points means are drawn from.
const OTHER_FRAMES: usize = 6;

impl RoomFrames {
    /// Renders views of at least `n_points` points each.
    pub fn load(n_points: usize, seed: u64) -> Result<Self, BenchError> {
        // Depth is dropped at edges: a few pixels more give the points asked for.
        let height = (1.06 * n_points as f64 * 0.75).sqrt().ceil().max(8.0);
        let params = SyntheticParams {
            width: (height / 0.75).ceil() as u32,
            height: height as u32,
            n_train: OTHER_FRAMES + 1,
            n_eval: 0,
            seed,
            depth_noise: 0.0,
            ..SyntheticParams::demo()
        };
        let dataset = synthetic::dataset(&params)?;
        let frame = unprojected(&dataset, 0)?;
        let mut others = Points::new();
        for index in 1..=OTHER_FRAMES {
            let points = unprojected(&dataset, index)?;
            for i in 0..points.len() {
                let ([x, y, z], [r, g, b]) = (points.position(i), points.color(i));
                others.push([x, y, z, r, g, b]);
            }
            // Tiles do not matter here: means are drawn from single points.
            others.close_tile();
        }
        Ok(Self { frame, others })
    }

    /// Means of one kind.
    pub fn draw(&self, means: MeanPlacement, components: usize, seed: u64) -> InitialDraw {
        match means {
            MeanPlacement::Random => InitialDraw::random(components, seed),
            MeanPlacement::Surface => InitialDraw::from_points(&self.others, components, seed),
        }
    }
}

fn unprojected(dataset: &Dataset, index: usize) -> Result<Points<f32>, BenchError> {
    let range = range::estimate(dataset, 0).map_err(SessionError::from)?;
    let settings = UnprojectSettings {
        convention: CameraConvention::Exact,
        filter: EdgeFilter::Off,
        normalization: range.normalization(),
    };
    let mut points = Points::new();
    let loaded = dataset.load(0, index);
    let unproject = |frame| Unprojector::new().unproject(&frame, &settings, &mut points);
    loaded.and_then(unproject).map_err(|e: FrameError| BenchError::NoFrame {
        dataset: dataset.name.clone(),
        first: e.to_string(),
    })?;
    Ok(points)
}
