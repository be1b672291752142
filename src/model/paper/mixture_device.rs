//! The seam between learning a mixture and whatever device computes its passes.
//!
//! A device finds what the processor finds, to the bit, of every tile it answers for: it adds,
//! subtracts and multiplies in f32 alone, in the processor's order. What needs more (an exponential,
//! a logarithm, a coordinate that is no number) it leaves to the processor, tile by tile.

use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::device_error::DeviceError;

/// Candidates per point that a device compares at most.
pub const MAX_DEVICE_CANDIDATES: usize = 4;
/// Points of a tile at most.
pub const MAX_TILE_POINTS: usize = 64;

/// Computes passes over frames: search, E-step and sums of every tile.
pub trait MixtureDevice: Send + Sync {
    /// What it runs on, for reports.
    fn name(&self) -> String;

    /// Takes over initial means, or what has moved of them, for the passes to come.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or has no room for so many.
    fn set_means(&mut self, means: &MeanCells<'_>) -> Result<(), DeviceError>;

    /// Takes over a frame for the passes to come.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or has no room for so many points.
    fn set_points(&mut self, points: &PointColumns<'_>) -> Result<(), DeviceError>;

    /// Scores the points against the means and, `with_sums`, sums them; both must be set.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, has no memory or does not answer. Nothing is known of
    /// the pass then.
    fn pass(&mut self, rule: &PassRule, with_sums: bool) -> Result<DevicePass<'_>, DeviceError>;
}

/// Where the cells of a grid of means are, normalised.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GridShape {
    /// Lower corner of the first cell; cells at the border extend to infinity.
    pub lo: [f32; 3],
    /// Edge of a cell.
    pub cell: f32,
    /// Cells per unit.
    pub per_unit: f32,
    /// Cells along each axis; the first changes fastest.
    pub dims: [usize; 3],
}

impl GridShape {
    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.dims.iter().product()
    }
}

/// Initial means by component, normalised, and the cells that they are to be sorted into.
#[derive(Clone, Copy, Debug)]
pub struct MeanCells<'a> {
    /// The cells: means are finite, and no search depends on their order within one.
    pub shape: GridShape,
    /// Positions.
    pub space: &'a [[f32; 3]],
    /// Colours.
    pub color: &'a [[f32; 3]],
    /// Weights.
    pub weight: &'a [f32],
    /// Components of which anything is not as it was handed over last, in any order; `None` if all may.
    pub moved: Option<&'a [u32]>,
}

/// Points of a frame, normalised.
#[derive(Clone, Copy, Debug)]
pub struct PointColumns<'a> {
    /// Positions and colours, column by column.
    pub columns: [&'a [f32]; 6],
    /// Tile `t` holds the points `tiles[t]..tiles[t + 1]`, at most [`MAX_TILE_POINTS`].
    pub tiles: &'a [u32],
}

/// How points are scored (`train.md`, E-step).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassRule {
    /// Candidates per point, 1 to [`MAX_DEVICE_CANDIDATES`] and at most the number of means.
    pub candidates: usize,
    /// What a squared distance of colours counts beside one of positions.
    pub color_ratio: f32,
    /// By how much more than the least score a component surely receives nothing. A tile in which one is
    /// nearer, without being equal, is left to the processor.
    pub open_gap: f32,
    /// By how many candidates share a point equally, from one on: the responsibility of each.
    pub equal_share: [f32; MAX_DEVICE_CANDIDATES],
    /// Likewise, by how much their effective distance is below their score.
    pub equal_gain: [f32; MAX_DEVICE_CANDIDATES],
}

/// What a device found.
#[derive(Clone, Copy, Debug)]
pub struct DevicePass<'a> {
    /// Effective distance of every point; of tiles that are left to the processor anything.
    pub q: &'a [f32],
    /// Tiles that are left to the processor, in any order.
    pub open: &'a [u32],
    /// Sums of the others, in any order, as
    /// [`TileRecord::from_words`](crate::model::conjugate::statistics::TileRecord::from_words) reads them.
    pub records: &'a [[u32; RECORD_WORDS]],
}
