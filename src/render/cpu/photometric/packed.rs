//! A prepared view as another device reads it: plain words without gaps, splats in their order.

use super::super::buckets::Buckets;
use super::super::prepare::CHUNK;
use super::super::record::{ConicRecord, Gradient};
use super::view::PreparedView;
use crate::math::pieces::pieces;
use bytemuck::{Pod, Zeroable};
use rayon::prelude::*;
use std::ops::Range;

/// What a walk needs of a splat.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(in crate::render) struct PackedSplat {
    /// Projected centre, px.
    centre: [f32; 2],
    /// Factor of the exponent: `p = p·(x, y)`, `q = q_y·y`, and the exponent of 2 is `−(p² + q²)`.
    p: [f32; 2],
    q_y: f32,
    /// Smallest exponent that is drawn.
    cut: f32,
    opacity: f32,
    color: [f32; 3],
    /// Change of colour by channel, per px.
    across: [[f32; 2]; 3],
    /// Change of depth per px, and depth at the centre, world units.
    depth_across: [f32; 2],
    depth: f32,
    padding: u32,
}

/// Where the sums of a splat lie among those of all pairs of splat and tile: tile by tile, row by row.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(in crate::render) struct PackedPlace {
    /// Pairs of the splats before.
    first: u32,
    /// Its first column of tiles; its first row, times 2¹⁶.
    corner: u32,
    /// Its columns of tiles; its rows, times 2¹⁶.
    size: u32,
}

/// A view in plain words. Keeps its buffers between views.
#[derive(Default)]
pub(in crate::render) struct PackedView {
    runs: Vec<Run>,
    /// By row of tiles: records by column.
    rows: Vec<Buckets>,
    /// Visible splats, in their order.
    pub(in crate::render) splats: Vec<PackedSplat>,
    /// Where their sums lie.
    pub(in crate::render) places: Vec<PackedPlace>,
    /// First entry of each tile, and at the end their number.
    pub(in crate::render) starts: Vec<u32>,
    /// Tile after tile its splats, by their number among the visible ones, nearest first.
    pub(in crate::render) entries: Vec<u32>,
}

/// Splats whose records lie side by side.
struct Run {
    records: Range<usize>,
    /// Visible splats before.
    rank: usize,
    /// Pairs of splat and tile before.
    first: usize,
}

impl PackedView {
    /// Becomes a view of so many columns and rows of tiles.
    pub(in crate::render) fn fill(
        &mut self,
        view: &PreparedView<'_>,
        (columns, rows): (usize, usize),
    ) {
        let records = &view.lists.records.records;
        self.find_runs(view);
        self.rows.resize_with(rows, Buckets::default);
        // One row a task: rows differ much in how many splats they hold.
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
        let runs = view.lists.runs().map(|records| Run {
            records: records.start as usize..records.end as usize,
            rank: 0,
            first: 0,
        });
        self.runs.clear();
        self.runs.extend(runs);
        // Pairs of the run itself first, then of those before.
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
    places: &mut Vec<PackedPlace>,
) {
    let all = &view.lists.records;
    splats.resize(view.n_drawn(), PackedSplat::zeroed());
    places.resize(view.n_drawn(), PackedPlace::zeroed());
    let sizes = || runs.iter().map(|run| run.records.len());
    let tasks = pieces(splats, sizes()).into_par_iter().zip(pieces(places, sizes())).zip(runs);
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
    let of_rows = pieces(entries, rows.iter().map(|row| row.lists().1.len()));
    of_rows.into_par_iter().zip(rows).with_max_len(1).for_each(|(entries, row)| {
        for (entry, &record) in entries.iter_mut().zip(row.lists().1) {
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
        cut: record.cut,
        opacity: record.opacity,
        color: record.color,
        across: gradient.across,
        depth_across: record.linear,
        depth: record.reach,
        padding: 0,
    }
}

fn placed(record: &ConicRecord, first: usize) -> PackedPlace {
    let (columns, rows) = (record.rect.tile_columns(), record.rect.tile_rows());
    let pair = |low: usize, high: usize| (low | high << 16) as u32;
    PackedPlace {
        first: first as u32,
        corner: pair(columns.start, rows.start),
        size: pair(columns.len(), rows.len()),
    }
}
