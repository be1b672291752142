//! Settings of a run.

use super::plan::Selection;
use super::settings::method::Method;
use crate::dataset::range::PositionRange;
use crate::dataset::unproject::{CameraConvention, EdgeFilter};
use crate::dataset::{Dataset, LoadOptions};
use serde::{Deserialize, Serialize};

/// Every setting that affects a run, for reports and checkpoints.
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
    /// Convention by which pixels become rays.
    pub camera_convention: CameraConvention,
    /// Treatment of mixed pixels.
    pub edge_filter: EdgeFilter,
    /// Low and high corner of the normalised range, in world units.
    pub position_range: [[f64; 3]; 2],
    /// Source of that range.
    pub position_range_source: String,
}

impl RunConfig {
    /// Settings for a dataset whose positions lie in `range`.
    pub fn new(
        dataset: &Dataset,
        method: Method,
        selection: Selection,
        range: &PositionRange,
    ) -> Self {
        Self {
            load: dataset.options,
            camera_convention: method.as_any().camera_convention(dataset.layout),
            edge_filter: EdgeFilter::DropMixed,
            position_range: [range.lo().to_array(), range.hi().to_array()],
            position_range_source: range.source.clone(),
            method,
            selection,
        }
    }
    /// Settings of the run over all shards.
    pub fn without_shard(&self) -> Self {
        Self { selection: self.selection.without_shard(), ..self.clone() }
    }
}
