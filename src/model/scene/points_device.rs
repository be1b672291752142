//! The seam between learning a scene's points and whatever device finds their seeds and sums them.
//!
//! A device finds what the processor finds, to the bit: it adds, subtracts and multiplies in f32
//! alone, in the processor's order, and adds whole quanta, which may come in any order. What needs
//! more it leaves to the processor.

use super::sums::N_SUMS;
use crate::model::device_error::DeviceError;

/// Words of a point of a surface as a frame holds it: position, a number, colour, a number, normal, a
/// number, direction, a number; bits of f32, but for numbers.
pub const POINT_WORDS: usize = 16;
/// Stands for no seed, and for no slot.
pub const NO_SEED: u32 = u32::MAX;
/// Stands for whatever seed the processor finds.
pub const OPEN: u32 = u32::MAX - 1;

/// Finds the seeds of points and sums points about the seeds of their components.
pub trait PointsDevice: Send + Sync {
    /// What it runs on, for reports.
    fn name(&self) -> String;

    /// Takes over the seeds of a scene for the searches to come.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or has no room for so many.
    fn set_seeds(&mut self, seeds: &Seeds<'_>) -> Result<(), DeviceError>;

    /// Takes over the points of a frame for the searches and sums to come.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost or has no room for so many points.
    fn set_points(&mut self, points: &[[u32; POINT_WORDS]]) -> Result<(), DeviceError>;

    /// By point its nearest seed within the scale, of equals the first; [`NO_SEED`] where there is
    /// none, [`OPEN`] where the processor has to look.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, has no memory or does not answer.
    fn nearest(&mut self) -> Result<&[u32], DeviceError>;

    /// By slot the sums of its points, in whole quanta.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, has no memory or does not answer.
    fn sums(&mut self, asked: &SlotSums<'_>) -> Result<&[[i32; N_SUMS]], DeviceError>;
}

/// Seeds of a scene, world units from its origin. They never move; new ones come behind the others.
#[derive(Clone, Copy, Debug)]
pub struct Seeds<'a> {
    /// How far a point may be from its seed at most, world units.
    pub h: f32,
    /// `1 / h` as the grid of seeds has it: cells are so wide.
    pub per_cell: f32,
    /// Cells from the origin from which on no place has a seed.
    pub max_cells: f32,
    /// All seeds.
    pub positions: &'a [[f32; 3]],
    /// Whether they are others than those handed over before, or filed by another scale.
    pub are_new: bool,
}

/// Which points are to be summed, and how (`scene.md`, Component sums).
#[derive(Clone, Copy, Debug)]
pub struct SlotSums<'a> {
    /// By point its slot, [`NO_SEED`] where it is not summed, and the bits of how far it moves along its
    /// ray, world units.
    pub points: &'a [[u32; 2]],
    /// By slot the seed that its sums are about, world units from the origin, and a 0.
    pub seeds: &'a [[f32; 4]],
    /// Structural scales a world unit.
    pub per_h: f32,
    /// Factor on each channel.
    pub gain: [f32; 3],
    /// Pixels that a point stands for, a power of two.
    pub weight: f32,
}
