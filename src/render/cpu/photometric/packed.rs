//! Prepared view in the memory layout of a GPU: packed words, splats in their original order.

use super::super::buckets::Buckets;
use super::super::prepare::CHUNK;
use super::super::record::{ConicRecord, Gradient};
use super::target::PreparedView;
use crate::math::image::split_by_sizes;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::ops::Range;

/// Projected splat as read by the kernels of the GPU.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(in crate::render) struct PackedSplat {
    centre: [f32; 2],
    /// Coefficients of `alpha = opacity·2^−(p² + q²)` at the offset `(x, y)` from the centre, px:
    /// `p = p[0]·x + p[1]·y`, `q = q_y·y`.
    p: [f32; 2],
    q_y: f32,
    /// Smallest exponent of 2 that passes the alpha cut.
    cut: f32,
    opacity: f32,
    color: [f32; 3],
    /// Change of each colour channel per px of offset.
    across: [[f32; 2]; 3],
    /// Depth change per px, world units; `depth` is the depth at the centre.
    depth_across: [f32; 2],
    depth: f32,
    padding: u32,
}

/// Location of a splat's sums in the list of sums of all splat-tile pairs. The pairs of a splat are
/// ordered by tile row, then by tile column.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(in crate::render) struct PackedSumLocation {
    /// Number of pairs of all preceding splats.
    first: u32,
    /// First tile column, plus first tile row times 2¹⁶.
    corner: u32,
    /// Number of tile columns, plus number of tile rows times 2¹⁶.
    size: u32,
}

/// View in the memory layout of a GPU. Buffers are reused between views.
#[derive(Default)]
pub(in crate::render) struct PackedView {
    runs: Vec<Run>,
    /// Records in each row of tiles, listed by tile column.
    rows: Vec<Buckets>,
    /// Visible splats in their original order.
    pub(in crate::render) splats: Vec<PackedSplat>,
    /// Location of each splat's sums.
    pub(in crate::render) places: Vec<PackedSumLocation>,
    /// Start of each tile's entries, followed by the total number of entries.
    pub(in crate::render) starts: Vec<u32>,
    /// Indices into `splats`, tile by tile, nearest first.
    pub(in crate::render) entries: Vec<u32>,
}

/// Splats with consecutive records.
struct Run {
    records: Range<usize>,
    /// Number of visible splats in preceding runs.
    rank: usize,
    /// Number of splat-tile pairs in preceding runs.
    first: usize,
}

impl PackedView {
    /// Converts a view of `columns` × `rows` tiles to the memory layout of a GPU.
    pub(in crate::render) fn fill(
        &mut self,
        view: &PreparedView<'_>,
        (columns, rows): (usize, usize),
    ) {
        let records = &view.lists.records.records;
        self.find_runs(view);
        self.rows.resize_with(rows, Buckets::default);
        // One row per task, because rows differ widely in their number of splats.
        self.rows.par_iter_mut().enumerate().with_max_len(1).for_each(|(row, lists)| {
            let listed = view.lists.rows.get(row).iter().copied();
            lists.fill(columns, listed, |i| records[i as usize].rect.tile_columns());
        });
        rayon::join(
            || pack_splats(view, &self.runs, &mut self.splats, &mut self.places),
            || pack_lists(&self.runs, &self.rows, &mut self.starts, &mut self.entries),
        );
    }

    fn find_runs(&mut self, view: &PreparedView<'_>) {
        let records = &view.lists.records.records;
        let runs = view.lists.visible_runs().map(|records| Run {
            records: records.start as usize..records.end as usize,
            rank: 0,
            first: 0,
        });
        self.runs.clear();
        self.runs.extend(runs);
        // `first` temporarily holds the run's own pair count; the loop below turns it into a prefix sum.
        self.runs.par_iter_mut().for_each(|run| {
            run.first = records[run.records.clone()].iter().map(n_tiles).sum();
        });
        let (mut rank, mut first) = (0, 0);
        for run in &mut self.runs {
            run.rank = rank;
            rank += run.records.len();
            first += std::mem::replace(&mut run.first, first);
        }
    }
}

fn pack_splats(
    view: &PreparedView<'_>,
    runs: &[Run],
    splats: &mut Vec<PackedSplat>,
    places: &mut Vec<PackedSumLocation>,
) {
    let all = &view.lists.records;
    splats.resize(view.n_drawn(), PackedSplat::zeroed());
    places.resize(view.n_drawn(), PackedSumLocation::zeroed());
    let sizes = || runs.iter().map(|run| run.records.len());
    let tasks = split_by_sizes(splats, sizes())
        .into_par_iter()
        .zip(split_by_sizes(places, sizes()))
        .zip(runs);
    // Runs differ in their number of visible splats.
    tasks.with_max_len(1).for_each(|((splats, places), run)| {
        let mut first = run.first;
        for ((i, splat), place) in run.records.clone().zip(splats).zip(places) {
            let (record, gradient) = (&all.records[i], all.gradients.get(i));
            *splat = packed(record, &gradient.copied().unwrap_or_default());
            *place = placed(record, first);
            first += n_tiles(record);
        }
    });
}

fn pack_lists(runs: &[Run], rows: &[Buckets], starts: &mut Vec<u32>, entries: &mut Vec<u32>) {
    starts.clear();
    starts.push(0);
    let mut before = 0;
    for row in rows {
        let (ends, records) = row.lists();
        starts.extend(ends.iter().map(|end| (before + end) as u32));
        before += records.len();
    }
    entries.resize(before, 0);
    let of_rows = split_by_sizes(entries, rows.iter().map(|row| row.lists().1.len()));
    of_rows.into_par_iter().zip(rows).with_max_len(1).for_each(|(entries, row)| {
        for (entry, &record) in entries.iter_mut().zip(row.lists().1) {
            // Each chunk has one run, which starts at the chunk's first index.
            let run = &runs[record as usize / CHUNK];
            *entry = (run.rank + record as usize - run.records.start) as u32;
        }
    });
}

fn n_tiles(record: &ConicRecord) -> usize {
    record.rect.tile_columns().len() * record.rect.tile_rows().len()
}

fn packed(record: &ConicRecord, gradient: &Gradient) -> PackedSplat {
    PackedSplat {
        centre: [record.u, record.v],
        p: [record.p_x, record.p_y],
        q_y: record.q_y,
        cut: record.min_exponent,
        opacity: record.opacity,
        color: record.color,
        across: gradient.across,
        depth_across: record.linear,
        depth: record.reach,
        padding: 0,
    }
}

fn placed(record: &ConicRecord, first: usize) -> PackedSumLocation {
    let (columns, rows) = (record.rect.tile_columns(), record.rect.tile_rows());
    let pair = |low: usize, high: usize| (low | high << 16) as u32;
    PackedSumLocation {
        first: first as u32,
        corner: pair(columns.start, rows.start),
        size: pair(columns.len(), rows.len()),
    }
}
