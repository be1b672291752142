//! Converts image-plane moments to gradients and Gauss-Newton blocks of the parameters, eight splats at a
//! time, one per lane (`photographs.md`, Lift).

use super::lift::{
    BY_MEAN, BY_SHAPE, COLOR_BY_MEAN, DIRECTION, N_LINEAR, PLANE_VECTORS, SplatLanes,
};
use super::moments::{
    COLOR, COLOR_CURVATURE, CURVATURE, GRADIENT, ImageSums, N_IMAGE_SUMS, N_QUADRATIC, WEIGHT,
    moment,
};
use super::target::PreparedView;
use crate::math::cholesky::at;
use crate::math::simd::{LANES, Vector, gather_rows};
use crate::model::scene::photometric::{N_COLOR, N_COLOR_PRECISION, N_FORM, N_FORM_PRECISION};
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use rayon::prelude::*;
use std::ops::Range;

/// Gradients and Gauss-Newton blocks of the parameters of eight splats, one per lane, from one
/// photograph.
#[derive(Clone, Copy, Debug)]
pub struct ParameterSums<V> {
    /// Gradient of `−½Σρr²` with respect to the ten form parameters: mean, log-scales, rotation and
    /// log-opacity. `r` is the residual of a pixel and `ρ` its weight.
    pub gradient: [V; N_FORM],
    /// Gauss-Newton block of the form parameters: lower triangle, row by row.
    pub curvature: [V; N_FORM_PRECISION],
    /// Gradient of the same objective as in [`ParameterSums::gradient`] with respect to the colour
    /// coefficients of red, green and blue.
    pub color: [[V; N_COLOR]; 3],
    /// Gauss-Newton block of one channel's colour coefficients, equal for all channels: lower triangle,
    /// row by row.
    pub color_curvature: [V; N_COLOR_PRECISION],
}

/// Exponents of the whitened offsets `p` and `q` in each feature (monomial) of the derivatives of
/// `ln α`.
const FEATURES: [(usize, usize); N_QUADRATIC] = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)];
/// Index in [`ImageSums`] of the curvature moment for the product of each pair of features.
const PRODUCTS: [[usize; N_QUADRATIC]; N_QUADRATIC] = {
    let mut places = [[0; N_QUADRATIC]; N_QUADRATIC];
    // `for` loops are not allowed in constants.
    let mut f = 0;
    while f < N_QUADRATIC {
        let mut g = 0;
        while g < N_QUADRATIC {
            let ((i, j), (k, l)) = (FEATURES[f], FEATURES[g]);
            places[f][g] = CURVATURE + moment(i + k, j + l);
            g += 1;
        }
        f += 1;
    }
    places
};
/// Index of the log-opacity among the form parameters (see [`ParameterSums::gradient`]).
const OPACITY: usize = N_FORM - 1;

impl<V: Vector> ParameterSums<V> {
    /// Computes the gradients and blocks of eight splats from their linearisations and image sums.
    #[inline(always)]
    pub(super) fn new(linear: &[V; N_LINEAR], sums: &[V; N_IMAGE_SUMS]) -> Self {
        let zero = V::splat(0.0);
        let mut found = Self {
            gradient: [zero; N_FORM],
            curvature: [zero; N_FORM_PRECISION],
            color: [[zero; N_COLOR]; 3],
            color_curvature: [zero; N_COLOR_PRECISION],
        };
        for parameter in 0..N_FORM {
            found.add_form(parameter, &features(linear, parameter), linear, sums);
        }
        found.add_moving_color(linear, sums);
        found.add_color(linear, sums);
        found
    }

    /// Adds the gradient with respect to form parameter `row` (see [`ParameterSums::gradient`]) and this
    /// parameter's row of the Gauss-Newton block. `of_row` holds the derivative of `ln α` with respect
    /// to the parameter, as coefficients of `1, p, q, p², pq, q²`.
    #[inline(always)]
    fn add_form(
        &mut self,
        row: usize,
        of_row: &[V; N_QUADRATIC],
        linear: &[V; N_LINEAR],
        sums: &[V; N_IMAGE_SUMS],
    ) {
        // The product of the row with the moments is shared by all columns.
        let mut through = [V::splat(0.0); N_QUADRATIC];
        // Features outside this range have coefficient 0.
        for f in range(row) {
            self.gradient[row] = self.gradient[row] + of_row[f] * sums[GRADIENT + f];
            for (g, through) in through.iter_mut().enumerate() {
                *through = *through + of_row[f] * sums[PRODUCTS[f][g]];
            }
        }
        for column in 0..=row {
            let of_column = features(linear, column);
            let mut sum = V::splat(0.0);
            for g in range(column) {
                sum = sum + through[g] * of_column[g];
            }
            self.curvature[at(row, column)] = sum;
        }
    }

    /// Adds the effect of the mean on colour: view-dependent and spatially varying colours change as
    /// the mean moves.
    #[inline(always)]
    fn add_moving_color(&mut self, linear: &[V; N_LINEAR], sums: &[V; N_IMAGE_SUMS]) {
        // One curvature serves all channels: the blending weight is the same in each.
        let bend = sums[COLOR_CURVATURE];
        for k in 0..3 {
            let pull = sums[COLOR + 3 * k];
            for i in 0..3 {
                let a = linear[COLOR_BY_MEAN + 3 * k + i];
                self.gradient[i] = self.gradient[i] + a * pull;
                for j in 0..=i {
                    let b = linear[COLOR_BY_MEAN + 3 * k + j];
                    self.curvature[at(i, j)] = self.curvature[at(i, j)] + a * b * bend;
                }
            }
        }
    }

    /// Adds the gradient and the Gauss-Newton block of the colour coefficients. A channel's colour is
    /// `c + W·d + G·e(p, q)`, linear in its seven coefficients `c`, `W` and `G`. `d` is the viewing
    /// direction and `e` the displacement on the splat's plane.
    #[inline(always)]
    fn add_color(&mut self, linear: &[V; N_LINEAR], sums: &[V; N_IMAGE_SUMS]) {
        let one = V::splat(1.0);
        let fixed = [one, linear[DIRECTION], linear[DIRECTION + 1], linear[DIRECTION + 2]];
        for k in 0..3 {
            let pulls = &sums[COLOR + 3 * k..];
            for (i, factor) in fixed.into_iter().enumerate() {
                self.color[k][i] = factor * pulls[0];
            }
            for i in 0..3 {
                self.color[k][4 + i] =
                    linear[PLANE_VECTORS + i] * pulls[1] + linear[PLANE_VECTORS + 3 + i] * pulls[2];
            }
        }
        let bends = &sums[COLOR_CURVATURE..];
        for i in 0..4 {
            for j in 0..=i {
                self.color_curvature[at(i, j)] = fixed[i] * fixed[j] * bends[0];
            }
        }
        for i in 0..3 {
            let (by_p, by_q) = (linear[PLANE_VECTORS + i], linear[PLANE_VECTORS + 3 + i]);
            let shift = by_p * bends[1] + by_q * bends[2];
            for (j, factor) in fixed.into_iter().enumerate() {
                self.color_curvature[at(4 + i, j)] = factor * shift;
            }
            let (with_p, with_q) =
                (by_p * bends[3] + by_q * bends[4], by_p * bends[4] + by_q * bends[5]);
            for j in 0..=i {
                self.color_curvature[at(4 + i, 4 + j)] =
                    with_p * linear[PLANE_VECTORS + j] + with_q * linear[PLANE_VECTORS + 3 + j];
            }
        }
    }
}

/// Returns the derivative of `ln α` with respect to a form parameter (see [`ParameterSums::gradient`]),
/// as coefficients of `1, p, q, p², pq, q²`.
#[inline(always)]
fn features<V: Vector>(linear: &[V; N_LINEAR], parameter: usize) -> [V; N_QUADRATIC] {
    let mut features = [V::splat(0.0); N_QUADRATIC];
    match parameter {
        OPACITY => features[0] = V::splat(1.0),
        0..3 => features[1..].copy_from_slice(&linear[BY_MEAN + 5 * parameter..][..5]),
        _ => features[3..].copy_from_slice(&linear[BY_SHAPE + 3 * (parameter - 3)..][..3]),
    }
    features
}

/// Returns the range, in [`FEATURES`], of the features whose coefficients can differ from 0 for a form
/// parameter.
const fn range(parameter: usize) -> Range<usize> {
    match parameter {
        OPACITY => 0..1,
        0..3 => 1..N_QUADRATIC,
        _ => 3..N_QUADRATIC,
    }
}

/// Sums over the pixels of a photograph for each splat of a view.
pub struct PhotometricSums<'a> {
    pub(super) view: PreparedView<'a>,
    pub(super) sums: &'a [ImageSums],
    pub(super) order: SumOrder,
    /// Sum of squared differences between photograph and rendering, over all channels of covered pixels.
    pub squared_error: f64,
    /// Number of covered pixels, over which `squared_error` is summed.
    pub pixels: f64,
}

#[derive(Clone, Copy)]
pub(super) enum SumOrder {
    /// The sums of a splat are at the index of its record.
    ByRecord,
    /// Only visible splats have sums, in splat order.
    BySplat,
}

/// Splat that is visible in at least one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VisibleSplat {
    /// Index among the splats of the view.
    pub id: u32,
    record: u32,
    sum_index: u32,
}

impl<'a> PhotometricSums<'a> {
    /// Wraps sums computed by another device: [`PreparedView::n_drawn`] entries in splat order.
    pub fn from_splat_sums(
        view: PreparedView<'a>,
        sums: &'a [ImageSums],
        squared_error: f64,
        pixels: f64,
    ) -> Self {
        Self { view, sums, order: SumOrder::BySplat, squared_error, pixels }
    }

    /// Returns, in splat order, the splats whose blending weights, summed over the compared pixels,
    /// exceed `weight`.
    pub fn visible_splats(&self, weight: f32) -> Vec<VisibleSplat> {
        let lists = self.view.lists;
        let seen = |(rank, record): (u32, u32)| {
            // The CPU sums by record. Other devices sum by splat, without gaps between chunks.
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
        // A run has at most one chunk of records, too few for a task of its own.
        let runs = runs.into_par_iter().with_min_len(4);
        runs.flat_map_iter(|(rank, run)| (rank..).zip(run).filter_map(seen)).collect()
    }

    /// Computes the parameter sums of up to eight splats, one per lane. `splats` must be unchanged
    /// since they were rendered. Lanes without a splat are 0.
    #[inline(always)]
    pub fn parameter_sums<V: Vector>(
        &self,
        splats: &[(VisibleSplat, Splat, Appearance)],
    ) -> ParameterSums<V> {
        let view = &self.view.view;
        let mut lanes = SplatLanes::new();
        // Lanes without a splat read zeros, so their results are 0.
        let mut sums = [&[0.0; N_IMAGE_SUMS]; LANES];
        for (lane, (seen, splat, appearance)) in splats.iter().take(LANES).enumerate() {
            // Views without colour gradients store none; the default gradient is 0.
            let gradients = &self.view.lists.records.gradients;
            let gradient = gradients.get(seen.record as usize).copied().unwrap_or_default();
            lanes.set(lane, view, (splat, appearance), &gradient);
            sums[lane] = &self.sums[seen.sum_index as usize];
        }
        ParameterSums::new(&lanes.linearize(view), &gather_rows(sums))
    }
}
