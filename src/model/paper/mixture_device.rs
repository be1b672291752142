//! Interface between mixture training and a device that computes the passes of training.
//!
//! For every tile that a device completes, its results are bit-identical to those of the CPU: it only
//! adds, subtracts and multiplies in f32, in the same order as the CPU. Tiles that require more (an
//! exponential, a logarithm, a NaN coordinate) are left to the CPU.

use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::inspection::DeviceError;

/// Maximum number of candidates per point on a device.
pub const MAX_DEVICE_CANDIDATES: usize = 4;
/// Maximum number of points per tile.
pub const MAX_TILE_POINTS: usize = 64;

/// Computes the passes over a frame: search, E-step and sums of every tile.
pub trait MixtureDevice: Send + Sync {
    /// Returns the device's name for reports.
    fn name(&self) -> String;

    /// Uploads the components' initial means for the following passes: all of them at first, later only
    /// those that were replaced.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or out of memory.
    fn set_means(&mut self, means: &MeanCells<'_>) -> Result<(), DeviceError>;

    /// Uploads the points of a frame for the following passes.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or out of memory.
    fn set_points(&mut self, points: &PointColumns<'_>) -> Result<(), DeviceError>;

    /// Scores the uploaded points against the uploaded means. If `with_sums` is true, also sums the
    /// points of every tile by component.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, out of memory or times out; the pass then has no result.
    fn pass(&mut self, rule: &PassRule, with_sums: bool) -> Result<DevicePass<'_>, DeviceError>;
}

/// Geometry of the grid into which the initial means are sorted, normalised coordinates.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GridShape {
    /// Lower corner of the first cell; border cells extend to infinity.
    pub lo: [f32; 3],
    /// Edge length of a cell.
    pub cell: f32,
    /// Number of cells per unit length.
    pub per_unit: f32,
    /// Number of cells along each axis; the first index varies fastest.
    pub dims: [usize; 3],
}

impl GridShape {
    /// Number of cells.
    pub fn n_cells(&self) -> usize {
        self.dims.iter().product()
    }
}

/// Initial means by component, in normalised coordinates, and the grid into which they are sorted.
#[derive(Clone, Copy, Debug)]
pub struct MeanCells<'a> {
    /// Geometry of the grid. All means are finite; the search does not depend on their order within a
    /// cell.
    pub shape: GridShape,
    /// Positions of the means.
    pub space: &'a [[f32; 3]],
    /// Colours of the means.
    pub color: &'a [[f32; 3]],
    /// Log weights of the components, scaled so that they can be added to squared distances.
    pub weight: &'a [f32],
    /// Components that changed since the last upload, in any order; `None` if all may have changed.
    pub changed_components: Option<&'a [u32]>,
}

/// Points of a frame, normalised.
#[derive(Clone, Copy, Debug)]
pub struct PointColumns<'a> {
    /// Positions and colours of the points, one column per coordinate.
    pub columns: [&'a [f32]; 6],
    /// Tile `t` holds the points `tiles[t]..tiles[t + 1]`, at most [`MAX_TILE_POINTS`].
    pub tiles: &'a [u32],
}

/// Parameters of the scoring of points (`training.md`, E-step).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PassRule {
    /// Number of candidates per point: 1 to [`MAX_DEVICE_CANDIDATES`], at most the number of means.
    pub candidates: usize,
    /// Weight of a squared colour distance relative to a squared distance of positions.
    pub color_ratio: f32,
    /// Score difference from the best candidate beyond which a component's share changes no bit of any
    /// sum. A tile is left to the CPU if a candidate within this difference has a score unequal to the
    /// best one.
    pub certain_gap: f32,
    /// Entry `i`: responsibility of each candidate if `i + 1` candidates have equal scores.
    pub equal_share: [f32; MAX_DEVICE_CANDIDATES],
    /// Entry `i`: difference between score and effective distance if `i + 1` candidates have equal
    /// scores.
    pub equal_gain: [f32; MAX_DEVICE_CANDIDATES],
}

/// Result of a pass on a device.
#[derive(Clone, Copy, Debug)]
pub struct DevicePass<'a> {
    /// Effective distance of every point, which encodes the point's ELBO; undefined for tiles left to
    /// the CPU.
    pub q: &'a [f32],
    /// Indices of the tiles left to the CPU, in any order.
    pub open: &'a [u32],
    /// Sums of the tiles that the device completed, in any order, in the format of
    /// [`TileRecord::from_words`](crate::model::conjugate::statistics::TileRecord::from_words).
    pub records: &'a [[u32; RECORD_WORDS]],
}
