//! A photograph that was compared with a picture, and what that says of each splat.

use super::blocks::ParameterSums;
use super::lift::SplatLanes;
use super::sums::{ImageSums, N_IMAGE_SUMS, WEIGHT};
use super::view::PreparedView;
use crate::math::simd::{LANES, Vector, gather_rows};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use rayon::prelude::*;
use std::ops::Range;

/// What a photograph says of the splats of a view.
pub struct Compared<'a> {
    pub(super) view: PreparedView<'a>,
    pub(super) sums: &'a [ImageSums],
    pub(super) order: SumOrder,
    /// Sum of squared differences between photograph and picture, over the channels of covered pixels.
    pub squared_error: f64,
    /// Covered pixels that count.
    pub pixels: f64,
}

/// Where the sums of a splat lie.
#[derive(Clone, Copy)]
pub(super) enum SumOrder {
    /// At the place of its record.
    ByRecord,
    /// In the order of splats, of those alone that the view shows.
    BySplat,
}

/// A splat that pixels show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeenSplat {
    /// Its number among the splats.
    pub id: u32,
    record: u32,
    /// Where its sums lie.
    place: u32,
}

impl<'a> Compared<'a> {
    /// What another device found: sums in the order of splats, as many as [`PreparedView::n_drawn`].
    pub fn by_splat(
        view: PreparedView<'a>,
        sums: &'a [ImageSums],
        squared_error: f64,
        pixels: f64,
    ) -> Self {
        Self { view, sums, order: SumOrder::BySplat, squared_error, pixels }
    }

    /// Splats whose blending weights add to more than `weight` over the pixels (px), by number.
    pub fn seen(&self, weight: f32) -> Vec<SeenSplat> {
        let lists = self.view.lists;
        let seen = |(rank, record): (u32, u32)| {
            let place = match self.order {
                SumOrder::ByRecord => record,
                SumOrder::BySplat => rank,
            };
            let id = lists.records.ids[record as usize];
            let is_seen = self.sums[place as usize][WEIGHT] > weight;
            is_seen.then_some(SeenSplat { id, record, place })
        };
        let mut n_before = 0;
        let ranked = |run: Range<u32>| {
            let rank = n_before;
            n_before += run.len() as u32;
            (rank, run)
        };
        let runs: Vec<_> = lists.runs().map(ranked).collect();
        let runs = runs.into_par_iter().with_min_len(4);
        runs.flat_map_iter(|(rank, run)| (rank..).zip(run).filter_map(seen)).collect()
    }

    /// The sums by parameters of up to eight splats, one in each lane and as they were drawn; lanes
    /// without a splat are 0.
    #[inline(always)]
    pub fn lift<V: Vector>(&self, splats: &[(SeenSplat, Splat, Appearance)]) -> ParameterSums<V> {
        let view = &self.view.view;
        let mut lanes = SplatLanes::new();
        let mut sums = [&[0.0; N_IMAGE_SUMS]; LANES];
        for (lane, (seen, splat, appearance)) in splats.iter().take(LANES).enumerate() {
            let gradients = &self.view.lists.records.gradients;
            let gradient = gradients.get(seen.record as usize).copied().unwrap_or_default();
            lanes.set(lane, view, (splat, appearance), &gradient);
            sums[lane] = &self.sums[seen.place as usize];
        }
        ParameterSums::new(&lanes.linearize(view), &gather_rows(sums))
    }
}
