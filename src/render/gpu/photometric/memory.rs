//! Buffers of the comparison, which grow with what is compared.

use super::layout::{Frame, MEASURED_BYTES, PIXEL_BYTES, PLACE_BYTES, SPLAT_BYTES, SUM_BYTES};
use crate::render::gpu::constants::N_QUARTERS;
use crate::render::gpu::error::GpuError;
use crate::render::gpu::growing::{GrowingBuffers, GrowthError, IN, OUT, WAY_IN, WAY_OUT};
use wgpu::BufferUsages as Usage;

const WORD: u64 = size_of::<u32>() as u64;

/// What a buffer holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Frame,
    Splats,
    Places,
    Starts,
    Entries,
    Photograph,
    /// By chosen pixel, between the walks.
    Pixels,
    /// By tile: squared difference and pixels.
    Errors,
    /// By pair of splat and tile.
    Shown,
    /// By pair of splat and tile.
    PartialSums,
    /// By splat.
    Totals,
    /// What goes to the GPU, on its way.
    Upload,
    /// What comes back.
    Readback,
}

/// Every part with its name and use, in their order.
const PARTS: [(Part, &str, Usage); 13] = [
    (Part::Frame, "comparison", Usage::UNIFORM.union(Usage::COPY_DST)),
    (Part::Splats, "compared splats", IN),
    (Part::Places, "places of sums", IN),
    (Part::Starts, "first splats of tiles", IN),
    (Part::Entries, "splats of tiles", IN),
    (Part::Photograph, "photograph", IN),
    (Part::Pixels, "compared pixels", Usage::STORAGE),
    (Part::Errors, "differences of tiles", OUT),
    (Part::Shown, "splats that tiles show", IN),
    (Part::PartialSums, "sums by tile", Usage::STORAGE),
    (Part::Totals, "sums by splat", OUT),
    (Part::Upload, "comparison on its way", WAY_IN),
    (Part::Readback, "sums on their way", WAY_OUT),
];

/// How much a comparison holds.
#[derive(Clone, Copy, Debug)]
pub(super) struct Load {
    pub(super) splats: u64,
    pub(super) tiles: u64,
    /// Pairs of splat and tile.
    pub(super) entries: u64,
    /// Of the photograph, in its chosen rows.
    pub(super) pixels: u64,
    /// Chosen pixels of a tile.
    pub(super) lanes: u64,
}

impl Load {
    /// Bytes of a part.
    pub(super) fn bytes(&self, part: Part) -> u64 {
        let Self { splats, tiles, entries, pixels, lanes } = *self;
        match part {
            Part::Frame => size_of::<Frame>() as u64,
            Part::Splats => splats * SPLAT_BYTES as u64,
            Part::Places => splats * PLACE_BYTES as u64,
            Part::Starts => (tiles + 1) * WORD,
            Part::Entries | Part::Shown => entries * WORD,
            Part::Photograph => pixels * MEASURED_BYTES as u64,
            Part::Pixels => tiles * lanes * PIXEL_BYTES as u64,
            Part::Errors => tiles * 8,
            Part::PartialSums => entries * u64::from(N_QUARTERS) * 16,
            Part::Totals => splats * SUM_BYTES as u64,
            Part::Upload => UPLOADED.iter().map(|&part| self.bytes(part)).sum(),
            Part::Readback => self.bytes(Part::Errors) + self.bytes(Part::Totals),
        }
    }
}

/// Parts that are uploaded, in the order in which they lie in [`Part::Upload`].
pub(super) const UPLOADED: [Part; 6] =
    [Part::Frame, Part::Splats, Part::Places, Part::Starts, Part::Entries, Part::Photograph];

/// The buffers, each as large as anything asked of it so far.
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

    /// Makes room.
    ///
    /// # Errors
    /// [`GpuError::ComparisonTooLarge`], [`GpuError::NoMemoryToCompare`].
    pub(super) fn make_room(&mut self, device: &wgpu::Device, load: &Load) -> Result<(), GpuError> {
        for (number, (part, ..)) in PARTS.into_iter().enumerate() {
            let room = self.buffers.make_room(device, number, load.bytes(part));
            room.map_err(|error| match error {
                GrowthError::TooLarge { needed_mib, limit_mib } => {
                    GpuError::ComparisonTooLarge { needed_mib, limit_mib }
                }
                GrowthError::Refused { mib } => GpuError::NoMemoryToCompare { mib },
            })?;
        }
        Ok(())
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
