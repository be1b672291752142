//! Interface between point fitting and a device that finds seeds and sums points.
//!
//! The results of a device are bit-identical to those of the CPU. It only adds, subtracts and
//! multiplies in f32, in the same order as the CPU. It also adds whole quanta, whose sum does not
//! depend on the order. Everything else is left to the CPU.

use super::sums::N_SUMS;
use crate::model::inspection::DeviceError;

/// Number of 32-bit words of a surface point as stored in a frame: position, colour, normal and
/// direction, each as three f32 followed by one integer.
pub const POINT_WORDS: usize = 16;
/// Marks a point without a seed (creation point of a component) or without a slot (see [`SlotSums`]).
pub const NO_SEED: u32 = u32::MAX;
/// Marks a point whose seed the CPU has to find.
pub const LEFT_TO_PROCESSOR: u32 = u32::MAX - 1;

/// Finds the seed of each point (the nearest creation point of a component), and sums the points about
/// their seeds.
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

    /// Returns, for each point, the index of the nearest seed within the structural scale; the lowest
    /// index if several are equally near. [`NO_SEED`] means that there is none; [`LEFT_TO_PROCESSOR`]
    /// means that the CPU has to find it.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, out of memory or times out.
    fn nearest(&mut self) -> Result<&[u32], DeviceError>;

    /// Returns the sums of each slot's points, in whole quanta. A slot collects the points that are
    /// summed about one seed.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, out of memory or times out.
    fn sums(&mut self, asked: &SlotSums<'_>) -> Result<&[[i32; N_SUMS]], DeviceError>;
}

/// Seeds of a scene (the points at which components were created), world units from the scene's origin.
/// Seeds never move; new ones are appended.
#[derive(Clone, Copy, Debug)]
pub struct Seeds<'a> {
    /// Structural scale: the maximum distance of a point from its seed, world units.
    pub h: f32,
    /// Reciprocal of `h`, used by the grid of seeds, whose cells are `h` wide.
    pub per_cell: f32,
    /// Distance from the origin, in cells along each axis, beyond which there are no seeds.
    pub max_cells: f32,
    /// Positions of all seeds.
    pub positions: &'a [[f32; 3]],
    /// True if all seeds may have changed since the last upload, false if seeds have only been
    /// appended.
    pub are_new: bool,
}

/// Points to be summed and their parameters (`scene.md`, Component sums).
#[derive(Clone, Copy, Debug)]
pub struct SlotSums<'a> {
    /// Slot of each point, and the bits of the point's shift along its ray (f32, world units). The slot
    /// is [`NO_SEED`] if the point is not summed.
    pub points: &'a [[u32; 2]],
    /// Seed of each slot, world units from the origin, followed by a 0.
    pub seeds: &'a [[f32; 4]],
    /// Reciprocal of the structural scale, per world unit.
    pub per_h: f32,
    /// Factor on each colour channel of the points.
    pub gain: [f32; 3],
    /// Number of pixels that a point represents, a power of two.
    pub weight: f32,
}
