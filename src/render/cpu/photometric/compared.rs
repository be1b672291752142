//! A photograph that was compared with a picture, and what that says of each splat.

use super::super::lists::ViewLists;
use super::super::view::CpuView;
use super::blocks::ParameterSums;
use super::lift::{N_LINEAR, linearize};
use super::sums::{ImageSums, N_IMAGE_SUMS, WEIGHT};
use crate::math::simd::{LANES, Vector};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;

/// What a photograph says of the splats of a view.
pub struct Compared<'a> {
    pub(super) view: CpuView,
    pub(super) lists: &'a ViewLists,
    /// By record.
    pub(super) totals: &'a [ImageSums],
    /// Sum of squared differences between photograph and picture, over the channels of covered pixels.
    pub squared_error: f64,
    /// Covered pixels that count.
    pub pixels: f64,
}

/// A splat that pixels show.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SeenSplat {
    /// Its number among the splats.
    pub id: u32,
    record: u32,
}

impl Compared<'_> {
    /// Splats whose blending weights add to more than `weight` over the pixels (px), by number.
    pub fn seen(&self, weight: f32) -> Vec<SeenSplat> {
        let ids = &self.lists.records.ids;
        let seen = |&record: &u32| self.totals[record as usize][WEIGHT] > weight;
        let record = self.lists.in_order().filter(seen);
        record.map(|record| SeenSplat { id: ids[record as usize], record }).collect()
    }

    /// The sums by parameters of up to eight splats, one in each lane and as they were drawn; lanes
    /// without a splat are 0.
    #[inline(always)]
    pub fn lift<V: Vector>(&self, splats: &[(SeenSplat, Splat, Appearance)]) -> ParameterSums<V> {
        let mut linear = [[0.0; LANES]; N_LINEAR];
        let mut sums = [[0.0; LANES]; N_IMAGE_SUMS];
        for (lane, (seen, splat, appearance)) in splats.iter().take(LANES).enumerate() {
            let gradients = &self.lists.records.gradients;
            let gradient = gradients.get(seen.record as usize).copied().unwrap_or_default();
            let of_splat = linearize(&self.view, splat, appearance, &gradient);
            let of_splat = of_splat.unwrap_or([0.0; N_LINEAR]);
            for (lanes, value) in linear.iter_mut().zip(of_splat) {
                lanes[lane] = value;
            }
            for (lanes, value) in sums.iter_mut().zip(self.totals[seen.record as usize]) {
                lanes[lane] = value;
            }
        }
        ParameterSums::new(&load(&linear), &load(&sums))
    }
}

#[inline(always)]
fn load<V: Vector, const N: usize>(rows: &[[f32; LANES]; N]) -> [V; N] {
    let mut lanes = [V::splat(0.0); N];
    for (lanes, row) in lanes.iter_mut().zip(rows) {
        *lanes = V::load(row);
    }
    lanes
}
