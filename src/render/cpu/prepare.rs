//! From splats to records, in f64 and once per splat, so that the f32 of the inner loop starts from
//! correctly rounded numbers.

use super::conic::Conic;
use super::lanes::EXP2_MIN;
use super::record::{Frame, Gradient, Listing, Record, Records, Rect};
use super::shade::{self, Shade};
use super::view::{Placed, View};
use super::{exact, projected};
use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::splats::Splat;
use crate::render::{Lens, Method, Paint};
use glam::DVec2;
use rayon::prelude::*;
use std::f64::consts::LOG2_E;

/// Splats per parallel task: small enough to balance 10⁴ splats, large enough to hide the
/// scheduling.
pub(super) const CHUNK: usize = 2048;

/// What a chunk held; its visible records come first in its part of the lists.
#[derive(Clone, Copy, Default)]
pub(super) struct ChunkCount {
    pub n_visible: usize,
    pub n_invalid: usize,
}

/// A splat in the image, in f64.
pub(super) struct Drawn {
    pub centre: DVec2,
    pub conic: Conic,
    /// See [`Record`].
    pub reach: f64,
    /// See [`Listing`].
    pub key: f64,
    pub opacity: f64,
    /// `k²` of the alpha cut.
    pub extent_squared: f64,
    pub rect: Rect,
}

/// Whether a view needs the colour gradients of its splats.
pub(super) fn has_gradients(splats: SplatView<'_>, view: &View) -> bool {
    !splats.appearance().is_empty() && view.look.paint == Paint::Stored
}

/// Fills the records of every chunk and counts them.
pub(super) fn prepare(
    splats: SplatView<'_>,
    view: &View,
    out: &mut Records,
    listings: &mut Vec<Listing>,
    counts: &mut Vec<ChunkCount>,
) {
    let n = splats.splats().len();
    let n_chunks = n.div_ceil(CHUNK);
    grow(&mut out.records, n);
    grow(listings, n);
    grow(&mut out.gradients, if has_gradients(splats, view) { n } else { 0 });
    grow(&mut out.frames, if view.method.lens() == Lens::Fisheye { n } else { 0 });
    let mut gradients = out.gradients.chunks_mut(CHUNK);
    let mut frames = out.frames.chunks_mut(CHUNK);
    counts.clear();
    counts.resize(n_chunks, ChunkCount::default());
    let tasks: Vec<Chunk<'_>> = splats
        .splats()
        .chunks(CHUNK)
        .zip(out.records.chunks_mut(CHUNK).zip(listings.chunks_mut(CHUNK)))
        .enumerate()
        .map(|(chunk, (splats_of, (records, listings)))| Chunk {
            splats: splats_of,
            appearance: splats.appearance().get(chunk * CHUNK..).unwrap_or(&[]),
            records,
            listings,
            gradients: gradients.next().unwrap_or(&mut []),
            frames: frames.next().unwrap_or(&mut []),
        })
        .collect();
    tasks.into_par_iter().zip(counts.par_iter_mut()).with_max_len(1).for_each(
        |(mut chunk, count)| {
            *count = chunk.fill(view);
        },
    );
}

fn grow<T: Clone + Default>(list: &mut Vec<T>, n: usize) {
    if n == 0 {
        list.clear();
    } else if list.len() < n {
        list.resize(n, T::default());
    }
}

/// A run of splats and where their records go.
struct Chunk<'a> {
    splats: &'a [Splat],
    /// Starts with those of `splats`, or is empty.
    appearance: &'a [Appearance],
    records: &'a mut [Record],
    listings: &'a mut [Listing],
    gradients: &'a mut [Gradient],
    frames: &'a mut [Frame],
}

impl Chunk<'_> {
    /// Packs the visible splats into the front of the lists, in order.
    fn fill(&mut self, view: &View) -> ChunkCount {
        let mut count = ChunkCount::default();
        for (i, splat) in self.splats.iter().enumerate() {
            if splat.opacity <= 0.0 {
                continue;
            }
            let appearance = self.appearance.get(i);
            if !splat.is_valid() || appearance.is_some_and(|a| !a.is_valid()) {
                count.n_invalid += 1;
                continue;
            }
            if let Some(placed) = view.place(splat) {
                let visible = self.draw(view, i, placed, count.n_visible);
                count.n_visible += usize::from(visible);
            }
        }
        count
    }

    /// Writes splat `i` to place `to`; whether any pixel sees it.
    fn draw(&mut self, view: &View, i: usize, placed: Placed, to: usize) -> bool {
        let appearance = self.appearance.get(i);
        let color = shade::color(view, &self.splats[i], &placed, appearance);
        let shade = match (self.gradients.get_mut(to), appearance) {
            (Some(place), Some(appearance)) => Some((place, Shade::new(appearance, view))),
            _ => None,
        };
        let drawn = match view.method {
            Method::Projected(support) => {
                if let Some((place, shade)) = shade {
                    *place = projected::gradient(&shade, &placed, view);
                }
                projected::draw(view, &placed, support)
            }
            Method::Exact(settings) if settings.lens == Lens::Pinhole => {
                if let Some((place, shade)) = shade {
                    *place = shade.gradient(&exact::pinhole_tangent(&placed, &view.intrinsics));
                }
                exact::pinhole(view, placed, settings)
            }
            Method::Exact(settings) => {
                if let Some((place, shade)) = shade {
                    *place = shade.gradient(&exact::fisheye_tangent(&placed));
                }
                exact::fisheye(view, placed, settings).map(|(drawn, frame)| {
                    self.frames[to] = frame;
                    drawn
                })
            }
        };
        let Some((record, key)) = drawn.and_then(|drawn| drawn.record(color)) else { return false };
        self.listings[to] = Listing::new(key, &record.rect);
        self.records[to] = record;
        true
    }
}

impl Drawn {
    /// The record and its key; `None` if f32 cannot hold them.
    fn record(&self, color: [f32; 3]) -> Option<(Record, f32)> {
        // exp(−½ D²) = 2^−(½ log₂e · D²).
        let unit = (0.5 * LOG2_E).sqrt();
        let Conic { p_x, p_y, q_y, half_l, w } = self.conic;
        let record = Record {
            u: self.centre.x as f32,
            v: self.centre.y as f32,
            p_x: (unit * p_x) as f32,
            p_y: (unit * p_y) as f32,
            q_y: (unit * q_y) as f32,
            half_l: half_l.as_vec2().to_array(),
            w: (w / (unit * unit)) as f32,
            cut: ((-0.5 * LOG2_E * self.extent_squared) as f32).max(EXP2_MIN),
            opacity: self.opacity as f32,
            color,
            reach: self.reach as f32,
            rect: self.rect,
        };
        let Record { u, v, p_x, p_y, q_y, half_l: [l_x, l_y], w, reach, .. } = record;
        let key = self.key as f32;
        [u, v, p_x, p_y, q_y, l_x, l_y, w, reach, key]
            .iter()
            .all(|value| value.is_finite())
            .then_some((record, key))
    }
}
