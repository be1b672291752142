//! Interface between point fitting and a device that searches seeds and sums points.
//!
//! A device gives the processor's result to the bit: it adds, subtracts and multiplies in f32 only, in the
//! processor's order, and adds whole quanta, which are independent of the order. Everything else is left to
//! the processor.

use super::sums::N_SUMS;
use crate::model::inspection::DeviceError;

/// Words of a surface point as stored in a frame: position, colour, normal, direction, each as three f32
/// followed by one integer.
pub const POINT_WORDS: usize = 16;
/// Marks a point without seed or slot.
pub const NO_SEED: u32 = u32::MAX;
/// Marks a point whose seed the processor must find.
pub const LEFT_TO_PROCESSOR: u32 = u32::MAX - 1;

/// Finds the seeds of points and sums points about the seeds of their components.
pub trait PointsDevice: Send + Sync {
    /// Returns the device's name for reports.
    fn name(&self) -> String;

    /// Uploads the seeds of a scene for the following searches.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or out of memory.
    fn set_seeds(&mut self, seeds: &Seeds<'_>) -> Result<(), DeviceError>;

    /// Uploads the points of a frame for the following searches and sums.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or out of memory.
    fn set_points(&mut self, points: &[[u32; POINT_WORDS]]) -> Result<(), DeviceError>;

    /// Returns, per point, its nearest seed within the scale, the first of equals; [`NO_SEED`] if there is
    /// none, [`LEFT_TO_PROCESSOR`] if the processor has to search.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, out of memory or times out.
    fn nearest(&mut self) -> Result<&[u32], DeviceError>;

    /// Returns, per slot, the sums of its points in whole quanta.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, out of memory or times out.
    fn sums(&mut self, asked: &SlotSums<'_>) -> Result<&[[i32; N_SUMS]], DeviceError>;
}

/// Seeds of a scene, world units from its origin. Seeds never move; new ones are appended.
#[derive(Clone, Copy, Debug)]
pub struct Seeds<'a> {
    /// Maximum distance of a point from its seed, world units.
    pub h: f32,
    /// `1 / h` as used by the seed grid, whose cells have that width.
    pub per_cell: f32,
    /// Distance from the origin, in cells, beyond which no seeds exist.
    pub max_cells: f32,
    /// All seeds.
    pub positions: &'a [[f32; 3]],
    /// True if the seeds differ from those of the last upload or are hashed at another scale.
    pub are_new: bool,
}

/// Points to be summed and their parameters (`scene.md`, Component sums).
#[derive(Clone, Copy, Debug)]
pub struct SlotSums<'a> {
    /// Per point, its slot ([`NO_SEED`] if it is not summed) and the bits of its shift along the ray, world
    /// units (f32).
    pub points: &'a [[u32; 2]],
    /// Per slot, the seed about which it is summed, world units from the origin, and a 0.
    pub seeds: &'a [[f32; 4]],
    /// Structural scales per world unit.
    pub per_h: f32,
    /// Factor on each colour channel.
    pub gain: [f32; 3],
    /// Pixels per point, a power of two.
    pub weight: f32,
}
