//! Visible splats of a view, sorted by depth per row of tiles. Input of every pixel loop.

use super::prepare::{self, ChunkCount};
use super::record::{DepthEntry, Records};
use super::rows::RowLists;
use super::view::CpuView;
use crate::model::splat::appearance::SplatView;
use crate::render::constants::TILE;
use std::ops::Range;

/// Records of a view and their order. Buffers are reused between views.
#[derive(Default)]
pub(super) struct ViewLists {
    pub records: Records,
    depth_entries: Vec<DepthEntry>,
    counts: Vec<ChunkCount>,
    /// Visible records per row of tiles, nearest first. Lists per row remain short even if every splat
    /// covers the image, and rows bin their own tiles in parallel.
    pub rows: RowLists,
}

impl ViewLists {
    /// Fills the records. Returns the number of invalid splats.
    pub(super) fn prepare(&mut self, splats: SplatView<'_>, view: &CpuView) -> usize {
        prepare::prepare(
            splats,
            view,
            &mut self.records,
            &mut self.depth_entries,
            &mut self.counts,
        );
        self.counts.iter().map(|count| count.n_invalid).sum()
    }

    /// Lists the visible records per row of tiles; `height` is the image height in pixels.
    pub(super) fn bin(&mut self, height: usize) {
        let runs: Vec<Range<u32>> = self.visible_runs().collect();
        self.rows.fill(height.div_ceil(TILE), &runs, &self.depth_entries);
    }

    /// Sorts every row's list by depth.
    pub(super) fn sort(&mut self) {
        self.rows.sort(&self.depth_entries);
    }

    pub(super) fn n_visible(&self) -> usize {
        self.counts.iter().map(|count| count.n_visible).sum()
    }

    /// Ranges of visible records in the order of their splats. Each [`prepare::CHUNK`] of splats has one
    /// range, which starts at the chunk's first index.
    pub(super) fn visible_runs(&self) -> impl Iterator<Item = Range<u32>> {
        let firsts = (0..).step_by(prepare::CHUNK);
        self.counts.iter().zip(firsts).map(|(count, first)| first..first + count.n_visible as u32)
    }
}
