//! The settings of a run, and the model they start from.

use super::plan::{Plan, Selection};
use super::prepare::Preparation;
use super::settings::method::Method;
use crate::dataset::error::DatasetError;
use crate::dataset::range::PositionRange;
use crate::dataset::unproject::{CameraConvention, EdgeFilter, UnprojectSettings, Unprojector};
use crate::dataset::{Dataset, Layout, LoadOptions};
use crate::math::normalization::Normalization;
use crate::observation::points::Points;
use crate::train::paper::config::{Init, Preset, TrainConfig};
use crate::train::paper::init::InitialDraw;
use serde::{Deserialize, Serialize};

/// Every setting that shaped a run, for the report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RunConfig {
    /// Settings of the model.
    #[serde(flatten)]
    pub method: Method,
    /// Frames and their order.
    #[serde(flatten)]
    pub selection: Selection,
    /// How depth files are read.
    #[serde(flatten)]
    pub load: LoadOptions,
    /// How pixels become rays.
    pub camera_convention: CameraConvention,
    /// Whether mixed pixels are dropped.
    pub edge_filter: EdgeFilter,
    /// Low and high corner of the normalised range, world units.
    pub position_range: [[f64; 3]; 2],
    /// Where that range is from.
    pub position_range_source: String,
}

impl RunConfig {
    /// For a dataset whose positions lie in `range`.
    pub fn new(
        dataset: &Dataset,
        method: Method,
        selection: Selection,
        range: &PositionRange,
    ) -> Self {
        Self {
            load: dataset.options,
            camera_convention: camera_convention(method.preset(), dataset.layout),
            edge_filter: EdgeFilter::DropMixed,
            position_range: [range.lo().to_array(), range.hi().to_array()],
            position_range_source: range.source.clone(),
            method,
            selection,
        }
    }

    /// How frames become points.
    pub fn preparation(&self, normalization: Normalization) -> Preparation {
        match &self.method {
            Method::Paper(_) => Preparation::Points(self.unprojection(normalization)),
            Method::Scene(run) => Preparation::Surfaces(Box::new(run.surface.clone())),
        }
    }

    fn unprojection(&self, normalization: Normalization) -> UnprojectSettings {
        UnprojectSettings {
            convention: self.camera_convention,
            filter: self.edge_filter,
            normalization,
        }
    }
}

/// The published loader's rays are part of the `paper` preset, where that loader applies.
fn camera_convention(preset: Preset, layout: Layout) -> CameraConvention {
    match (preset, layout) {
        (Preset::Paper, Layout::Blender) => CameraConvention::Paper,
        _ => CameraConvention::Exact,
    }
}

/// Initial means. Where they come from data it is the first usable frame of all shards, so that
/// these start alike.
pub(super) fn initial_draw(
    dataset: &Dataset,
    config: &RunConfig,
    train: &TrainConfig,
    normalization: Normalization,
) -> Result<InitialDraw, DatasetError> {
    if train.init == Init::Random {
        return Ok(InitialDraw::random(train.components, train.seed));
    }
    let plan = Plan::new(dataset, &config.selection.whole(), train.seed)?;
    let settings = config.unprojection(normalization);
    let mut points = Points::new();
    for &index in &plan.frames {
        let loaded = dataset.load(plan.split, index);
        let counts =
            loaded.and_then(|frame| Unprojector::new().unproject(&frame, &settings, &mut points));
        if counts.is_ok() && !points.is_empty() {
            break;
        }
    }
    Ok(InitialDraw::from_points(&points, train.components, train.seed))
}
