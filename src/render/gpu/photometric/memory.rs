//! Buffers of the comparison, which grow on demand.

use super::layout::{Frame, MEASURED_BYTES, PIXEL_BYTES, PLACE_BYTES, SPLAT_BYTES, SUM_BYTES};
use crate::render::gpu::constants::N_QUARTERS;
use crate::render::gpu::error::GpuError;
use crate::render::gpu::growing::{
    GrowingBuffers, GrowthError, IN, OUT, READBACK_STAGING, UPLOAD_STAGING,
};
use wgpu::BufferUsages as Usage;

const WORD: u64 = size_of::<u32>() as u64;

/// Contents of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Frame,
    Splats,
    Places,
    Starts,
    Entries,
    Photograph,
    /// Per chosen pixel, between the walks.
    Pixels,
    /// Per tile: squared error and number of pixels.
    Errors,
    /// Per splat-tile pair: whether a pixel shows the splat.
    Shown,
    /// Per splat-tile pair.
    PartialSums,
    /// Per splat.
    Totals,
    /// Staging buffer for uploads.
    Upload,
    /// Staging buffer for results.
    Readback,
}

/// All parts in order, with label and usage.
const PARTS: [(Part, &str, Usage); 13] = [
    (Part::Frame, "comparison", Usage::UNIFORM.union(Usage::COPY_DST)),
    (Part::Splats, "compared splats", IN),
    (Part::Places, "locations of sums", IN),
    (Part::Starts, "first splats of tiles", IN),
    (Part::Entries, "splats of tiles", IN),
    (Part::Photograph, "photograph", IN),
    (Part::Pixels, "compared pixels", Usage::STORAGE),
    (Part::Errors, "errors of tiles", OUT),
    (Part::Shown, "visible splats of tiles", IN),
    (Part::PartialSums, "sums by tile", Usage::STORAGE),
    (Part::Totals, "sums by splat", OUT),
    (Part::Upload, "upload of comparison", UPLOAD_STAGING),
    (Part::Readback, "readback of sums", READBACK_STAGING),
];

/// Sizes of a comparison.
#[derive(Clone, Copy, Debug)]
pub(super) struct ComparisonSizes {
    pub(super) splats: u64,
    pub(super) tiles: u64,
    /// Number of splat-tile pairs.
    pub(super) entries: u64,
    /// Number of pixels in the chosen rows of the photograph.
    pub(super) pixels: u64,
    /// Number of chosen pixels per tile.
    pub(super) lanes: u64,
}

impl ComparisonSizes {
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

/// Parts to upload, in the order of [`Part::Upload`].
pub(super) const UPLOADED: [Part; 6] =
    [Part::Frame, Part::Splats, Part::Places, Part::Starts, Part::Entries, Part::Photograph];

/// All buffers, each as large as the largest size requested so far.
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

    /// Ensures the sizes of all buffers.
    ///
    /// # Errors
    /// [`GpuError::ComparisonTooLarge`], [`GpuError::NoMemoryToCompare`].
    pub(super) fn ensure_capacity(
        &mut self,
        device: &wgpu::Device,
        load: &ComparisonSizes,
    ) -> Result<(), GpuError> {
        for (number, (part, ..)) in PARTS.into_iter().enumerate() {
            let room = self.buffers.ensure_capacity(device, number, load.bytes(part));
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
