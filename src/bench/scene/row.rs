//! One row of the tables, from the runs of its configuration.

use super::training::Trained;
use super::variants::{SceneVariant, Table};
use crate::eval::cracks::CrackReport;
use crate::eval::metrics::mean_std;
use crate::eval::report::{EvalReport, SeenReport};
use crate::eval::spread::Spread;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::config::BirthRule;
use crate::train::scene::photometric::rule::PhotometricMode;
use serde::Serialize;

/// One row of a table; qualities are means over views, then over the orders of frames.
#[derive(Clone, Debug, Serialize)]
pub struct AccuracyRow {
    /// Table that the row stands in.
    pub table: Table,
    /// What was changed.
    pub configuration: String,
    /// Where components are born.
    pub births: BirthRule,
    /// How much of photographs is learnt.
    pub photographs: PhotometricMode,
    /// Structural scale, world units.
    pub h: f64,
    /// Components that are drawn.
    pub drawn: f64,
    /// Components that were born.
    pub born: f64,
    /// Bytes of the model per component.
    pub bytes_per_component: f64,
    /// Median milliseconds of training per frame.
    pub train_ms: f64,
    /// Median milliseconds of preparation per frame, on the thread that decodes.
    pub prepare_ms: f64,
    /// PSNR of the whole frame, dB.
    pub psnr: f64,
    /// Lowest of the orders.
    pub psnr_low: f64,
    /// Highest of the orders.
    pub psnr_high: f64,
    /// PSNR over covered pixels, dB.
    pub psnr_covered: Option<f64>,
    /// PSNR over covered pixels with colours aligned view by view, dB.
    pub psnr_aligned_covered: Option<f64>,
    /// Share of covered pixels.
    pub coverage: f64,
    /// Mean structural similarity of the whole frame, −1 to 1.
    pub ssim: f64,
    /// SSIM with colours aligned view by view.
    pub ssim_aligned: Option<f64>,
    /// Share of interior pixels with transmittance > 0.1 at the distance of training; this and the
    /// next three in the first order.
    pub cracks_01: Option<f64>,
    /// Share of interior pixels with transmittance > 0.3.
    pub cracks_03: Option<f64>,
    /// As `cracks_01`, at half the distance.
    pub cracks_half_01: Option<f64>,
    /// As `cracks_03`, at half the distance.
    pub cracks_half_03: Option<f64>,
}

/// What holds for all rows.
#[derive(Clone, Debug, Serialize)]
pub struct AccuracySummary {
    /// The preset's settings on this dataset.
    pub base: SceneRun,
    /// Number of training frames.
    pub frames: usize,
    /// Number of held-out views.
    pub views: usize,
    /// Orders of the frames.
    pub orders: usize,
    /// What the preset shows early of the frames it has learnt, as listed.
    pub seen: Vec<SeenReport>,
}

/// A configuration in one order of the frames.
pub struct Measured {
    /// The scene and its times.
    pub trained: Trained,
    /// How the held-out views came out.
    pub quality: EvalReport,
}

impl AccuracyRow {
    /// The row of a configuration trained in every order of the frames.
    pub fn of(variant: &SceneVariant, orders: &[Measured]) -> Self {
        let mean = |value: &dyn Fn(&Measured) -> f64| {
            mean_std(&orders.iter().map(value).collect::<Vec<_>>()).0
        };
        let mean_known = |value: &dyn Fn(&EvalReport) -> Option<f64>| {
            // None if one order has none: a mean over the others would not compare.
            let values: Option<Vec<f64>> = orders.iter().map(|m| value(&m.quality)).collect();
            values.map(|values| mean_std(&values).0)
        };
        let psnr = || orders.iter().map(|m| m.quality.psnr_mean);
        let median = |times: &dyn Fn(&Trained) -> &[f64]| {
            Spread::of(orders.iter().flat_map(|m| times(&m.trained)).copied().collect()).median
        };
        let cracks: Option<&CrackReport> = orders.iter().find_map(|m| m.quality.cracks.as_ref());
        let half = cracks.and_then(|c| c.half_distance);
        Self {
            table: variant.table,
            configuration: variant.name.clone(),
            births: variant.run.engine.births,
            photographs: PhotometricMode::of(variant.run.engine.photometric),
            h: variant.run.engine.h,
            drawn: mean(&|m| m.trained.drawn() as f64),
            born: mean(&|m| m.trained.born as f64),
            bytes_per_component: mean(&|m| {
                m.trained.model_bytes as f64 / m.trained.born.max(1) as f64
            }),
            train_ms: median(&|t| &t.train_ms),
            prepare_ms: median(&|t| &t.prepare_ms),
            psnr: mean(&|m| m.quality.psnr_mean),
            psnr_low: psnr().fold(f64::INFINITY, f64::min),
            psnr_high: psnr().fold(f64::NEG_INFINITY, f64::max),
            psnr_covered: mean_known(&|q| q.psnr_covered_mean),
            psnr_aligned_covered: mean_known(&|q| q.psnr_aligned_covered_mean),
            coverage: mean(&|m| m.quality.coverage_mean),
            ssim: mean(&|m| m.quality.ssim_mean),
            ssim_aligned: mean_known(&|q| q.ssim_aligned_mean),
            cracks_01: cracks.map(|c| c.training_distance.over_01),
            cracks_03: cracks.map(|c| c.training_distance.over_03),
            cracks_half_01: half.map(|c| c.over_01),
            cracks_half_03: half.map(|c| c.over_03),
        }
    }
}
