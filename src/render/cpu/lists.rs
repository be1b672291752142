//! What a view shows of splats, nearest first: every walk over its pixels starts from it.

use super::prepare::{self, ChunkCount};
use super::record::{DepthEntry, Records};
use super::rows::RowLists;
use super::view::CpuView;
use crate::model::splat::appearance::SplatView;
use crate::render::constants::TILE;
use std::ops::Range;

/// The records of a view and their order. Keeps its buffers between views.
#[derive(Default)]
pub(super) struct ViewLists {
    pub records: Records,
    listings: Vec<DepthEntry>,
    counts: Vec<ChunkCount>,
    /// Visible records by row of tiles, nearest first. Rows rather than tiles: the lists stay short
    /// even when every splat covers the image, and each row bins its own tiles in parallel.
    pub rows: RowLists,
}

impl ViewLists {
    /// Fills the records; the number of broken splats.
    pub(super) fn prepare(&mut self, splats: SplatView<'_>, view: &CpuView) -> usize {
        prepare::prepare(splats, view, &mut self.records, &mut self.listings, &mut self.counts);
        self.counts.iter().map(|count| count.n_invalid).sum()
    }

    /// Lists the visible records by row of tiles, of an image so many pixels high.
    pub(super) fn bin(&mut self, height: usize) {
        let runs: Vec<Range<u32>> = self.runs().collect();
        self.rows.fill(height.div_ceil(TILE), &runs, &self.listings);
    }

    /// Orders the list of every row by depth.
    pub(super) fn sort(&mut self) {
        self.rows.sort(&self.listings);
    }

    /// Number of visible records.
    pub(super) fn n_visible(&self) -> usize {
        self.counts.iter().map(|count| count.n_visible).sum()
    }

    /// The visible records in the order of their splats as runs: one for each [`prepare::CHUNK`] of splats, which
    /// begins there.
    pub(super) fn runs(&self) -> impl Iterator<Item = Range<u32>> {
        let firsts = (0..).step_by(prepare::CHUNK);
        self.counts.iter().zip(firsts).map(|(count, first)| first..first + count.n_visible as u32)
    }
}
