//! Buffers of a pass, which grow with frames and models.

use super::layout::{Frame, Index, Mean};
use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::render::gpu::constants::STRIP_CELLS;
use crate::render::gpu::error::GpuError;
use crate::render::gpu::growing::{GrowingBuffers, IN, OUT, READBACK_STAGING, UPLOAD_STAGING};
use wgpu::BufferUsages as Usage;

const WORD: u64 = size_of::<u32>() as u64;
/// Bytes per point: six coordinates.
const POINT_BYTES: u64 = 24;
/// Bytes per mean: position and component, or colour and weight.
const MEAN_BYTES: u64 = 16;
pub(super) const RECORD_BYTES: u64 = RECORD_WORDS as u64 * WORD;
/// Words before the list of open tiles: the numbers of records and of open tiles.
pub(super) const HEAD_WORDS: u64 = 2;

/// Contents of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Frame,
    Points,
    Tiles,
    Starts,
    Means,
    Appearance,
    Distances,
    Records,
    Outcome,
    Index,
    Moved,
    Components,
    Places,
    Strips,
    /// Staging buffer for points and tiles.
    Upload,
    /// Staging buffer for moved means.
    MeanUpload,
    /// Staging buffer for results.
    Readback,
}

/// All parts in order, with label (also used in messages) and usage.
const PARTS: [(Part, &str, Usage); 17] = [
    (Part::Frame, "settings of a pass", Usage::UNIFORM.union(Usage::COPY_DST)),
    (Part::Points, "points of a frame", IN),
    (Part::Tiles, "tiles of a frame", IN),
    (Part::Starts, "cells of means", IN),
    (Part::Means, "means of components", Usage::STORAGE),
    (Part::Appearance, "colours of components", Usage::STORAGE),
    (Part::Distances, "scores of points", OUT),
    (Part::Records, "sums of tiles", OUT),
    (Part::Outcome, "open tiles", OUT.union(Usage::COPY_DST)),
    (Part::Index, "settings of an index", Usage::UNIFORM.union(Usage::COPY_DST)),
    (Part::Moved, "moved means", IN),
    (Part::Components, "components", Usage::STORAGE),
    (Part::Places, "positions in cells", Usage::STORAGE),
    (Part::Strips, "sums of cells", Usage::STORAGE),
    (Part::Upload, "uploaded points", UPLOAD_STAGING),
    (Part::MeanUpload, "uploaded means", UPLOAD_STAGING),
    (Part::Readback, "sums read back", READBACK_STAGING),
];

/// Sizes of a pass.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PassSizes {
    pub(super) points: u64,
    pub(super) tiles: u64,
    pub(super) means: u64,
    /// Means to upload with the next pass.
    pub(super) moved: u64,
    pub(super) cells: u64,
    /// Capacity for records.
    pub(super) records: u64,
}

impl PassSizes {
    pub(super) fn bytes(&self, part: Part) -> u64 {
        let Self { points, tiles, means, moved, cells, records } = *self;
        let mean = size_of::<Mean>() as u64;
        match part {
            Part::Frame => size_of::<Frame>() as u64,
            Part::Points => points * POINT_BYTES,
            Part::Tiles => (tiles + 1) * WORD,
            Part::Starts => (cells + 1) * WORD,
            Part::Means | Part::Appearance => means * MEAN_BYTES,
            Part::Distances => points * WORD,
            Part::Records => records * RECORD_BYTES,
            Part::Outcome => (HEAD_WORDS + tiles) * WORD,
            Part::Upload => self.all(&OF_FRAME),
            Part::MeanUpload => self.all(&OF_MEANS),
            Part::Index => size_of::<Index>() as u64,
            Part::Moved => moved * mean,
            Part::Components => means * mean,
            Part::Places => means * WORD,
            Part::Strips => (cells + 1).div_ceil(STRIP_CELLS.into()) * WORD,
            Part::Readback => self.all(&READ),
        }
    }

    fn all(&self, parts: &[Part]) -> u64 {
        parts.iter().map(|&part| self.bytes(part)).sum()
    }
}

/// Parts uploaded with a frame, in the order of [`Part::Upload`].
pub(super) const OF_FRAME: [Part; 2] = [Part::Points, Part::Tiles];
/// Parts uploaded after means have moved, in the order of [`Part::MeanUpload`].
pub(super) const OF_MEANS: [Part; 1] = [Part::Moved];
/// Index of the means, and intermediate buffers of its construction.
pub(super) const OF_INDEX: [Part; 6] =
    [Part::Starts, Part::Means, Part::Appearance, Part::Components, Part::Places, Part::Strips];
/// Parts read back, in the order of [`Part::Readback`].
pub(super) const READ: [Part; 3] = [Part::Outcome, Part::Distances, Part::Records];

#[derive(Debug)]
pub(super) struct Memory {
    buffers: GrowingBuffers,
}

impl Memory {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let buffers = PARTS.map(|(_, label, usage)| (label, usage));
        Self { buffers: GrowingBuffers::new(device, buffers) }
    }

    pub(super) fn buffer(&self, part: Part) -> &wgpu::Buffer {
        self.buffers.get(part as usize)
    }

    /// Ensures the size of some parts, whose contents may be lost. Returns true if any buffer was replaced.
    ///
    /// # Errors
    /// [`GpuError::PassTooLarge`], [`GpuError::NoMemoryForPass`].
    pub(super) fn ensure_capacity(
        &mut self,
        device: &wgpu::Device,
        load: &PassSizes,
        parts: &[Part],
    ) -> Result<bool, GpuError> {
        let needed = parts.iter().map(|&part| (part as usize, load.bytes(part)));
        self.buffers.ensure_pass_capacity(device, needed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_lie_at_their_places() {
        for (at, (part, ..)) in PARTS.into_iter().enumerate() {
            assert_eq!(part as usize, at);
        }
    }
}
