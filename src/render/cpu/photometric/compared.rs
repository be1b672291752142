//! Result of comparing a photograph with the rendered splats.

use super::blocks::ParameterSums;
use super::lift::SplatLanes;
use super::sums::{ImageSums, N_IMAGE_SUMS, WEIGHT};
use super::view::PreparedView;
use crate::math::simd::{LANES, Vector, gather_rows};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use rayon::prelude::*;
use std::ops::Range;

/// Sums over the pixels of a photograph, per splat of a view.
pub struct PhotometricSums<'a> {
    pub(super) view: PreparedView<'a>,
    pub(super) sums: &'a [ImageSums],
    pub(super) order: SumOrder,
    /// Sum of squared differences between photograph and rendering, over all channels of covered pixels.
    pub squared_error: f64,
    /// Number of covered pixels, which `squared_error` sums over.
    pub pixels: f64,
}

#[derive(Clone, Copy)]
pub(super) enum SumOrder {
    /// Same index as the splat's record.
    ByRecord,
    /// In splat order, only for the visible splats.
    BySplat,
}

/// Splat that is visible in at least one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VisibleSplat {
    /// Index among the splats of the view.
    pub id: u32,
    record: u32,
    /// Index of its sums.
    sum_index: u32,
}

impl<'a> PhotometricSums<'a> {
    /// Wraps the result of another device: sums in splat order, [`PreparedView::n_drawn`] entries.
    pub fn from_splat_sums(
        view: PreparedView<'a>,
        sums: &'a [ImageSums],
        squared_error: f64,
        pixels: f64,
    ) -> Self {
        Self { view, sums, order: SumOrder::BySplat, squared_error, pixels }
    }

    /// Splats whose blending weights sum to more than `weight` over the pixels (px), in splat order.
    pub fn visible_splats(&self, weight: f32) -> Vec<VisibleSplat> {
        let lists = self.view.lists;
        let seen = |(rank, record): (u32, u32)| {
            let place = match self.order {
                SumOrder::ByRecord => record,
                SumOrder::BySplat => rank,
            };
            let id = lists.records.ids[record as usize];
            let is_seen = self.sums[place as usize][WEIGHT] > weight;
            is_seen.then_some(VisibleSplat { id, record, sum_index: place })
        };
        let mut n_before = 0;
        let ranked = |run: Range<u32>| {
            let rank = n_before;
            n_before += run.len() as u32;
            (rank, run)
        };
        let runs: Vec<_> = lists.visible_runs().map(ranked).collect();
        let runs = runs.into_par_iter().with_min_len(4);
        runs.flat_map_iter(|(rank, run)| (rank..).zip(run).filter_map(seen)).collect()
    }

    /// Parameter sums of up to eight splats, one per lane. `splats` must be as they were when rendered; lanes
    /// without a splat are 0.
    #[inline(always)]
    pub fn parameter_sums<V: Vector>(
        &self,
        splats: &[(VisibleSplat, Splat, Appearance)],
    ) -> ParameterSums<V> {
        let view = &self.view.view;
        let mut lanes = SplatLanes::new();
        let mut sums = [&[0.0; N_IMAGE_SUMS]; LANES];
        for (lane, (seen, splat, appearance)) in splats.iter().take(LANES).enumerate() {
            let gradients = &self.view.lists.records.gradients;
            let gradient = gradients.get(seen.record as usize).copied().unwrap_or_default();
            lanes.set(lane, view, (splat, appearance), &gradient);
            sums[lane] = &self.sums[seen.sum_index as usize];
        }
        ParameterSums::new(&lanes.linearize(view), &gather_rows(sums))
    }
}
