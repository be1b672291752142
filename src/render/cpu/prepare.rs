//! Converts splats to records. Computed in f64 once per splat, so that the f32 inner loop starts from
//! correctly rounded values.

use super::record::{ConicRecord, DepthEntry, Gradient, Records, TangentFrame};
use super::shade::{self, ColorGradient};
use super::textures::{LatticeOf, SurfacePlane};
use super::view::{CameraSplat, CpuView};
use super::{exact, projected};
use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::splats::Splat;
use crate::render::options::{Lens, Paint, RenderMethod};
use rayon::prelude::*;

// Splats per parallel task: small enough to balance 10⁴ splats, large enough to hide scheduling
// overhead.
pub(super) const CHUNK: usize = 512;

/// Numbers of visible and invalid splats in a chunk. The chunk's visible records are at the front of its
/// slice of each list.
#[derive(Clone, Copy, Default)]
pub(super) struct ChunkCount {
    pub n_visible: usize,
    pub n_invalid: usize,
}

pub(super) fn prepare(
    splats: SplatView<'_>,
    view: &CpuView,
    lattices: Option<LatticeOf<'_>>,
    out: &mut Records,
    listings: &mut Vec<DepthEntry>,
    counts: &mut Vec<ChunkCount>,
) {
    let n = splats.splats().len();
    let n_chunks = n.div_ceil(CHUNK);
    grow(&mut out.records, n);
    grow(&mut out.ids, n);
    grow(listings, n);
    // Other paints ignore the appearance.
    let has_gradients = !splats.appearance().is_empty() && view.style.paint == Paint::Stored;
    grow(&mut out.gradients, if has_gradients { n } else { 0 });
    grow(&mut out.frames, if view.method.lens() == Lens::Fisheye { n } else { 0 });
    grow(&mut out.planes, if lattices.is_some() { n } else { 0 });
    let mut planes = out.planes.chunks_mut(CHUNK);
    let mut gradients = out.gradients.chunks_mut(CHUNK);
    let mut frames = out.frames.chunks_mut(CHUNK);
    counts.clear();
    counts.resize(n_chunks, ChunkCount::default());
    let mut ids = out.ids.chunks_mut(CHUNK);
    let tasks: Vec<Chunk<'_>> = splats
        .splats()
        .chunks(CHUNK)
        .zip(out.records.chunks_mut(CHUNK).zip(listings.chunks_mut(CHUNK)))
        .enumerate()
        .map(|(chunk, (splats_of, (records, listings)))| Chunk {
            splats: splats_of,
            appearance: splats.appearance().get(chunk * CHUNK..).unwrap_or(&[]),
            first: (chunk * CHUNK) as u32,
            ids: ids.next().unwrap_or(&mut []),
            records,
            depth_entries: listings,
            gradients: gradients.next().unwrap_or(&mut []),
            frames: frames.next().unwrap_or(&mut []),
            planes: planes.next().unwrap_or(&mut []),
            lattices,
        })
        .collect();
    // rayon would merge chunks into one task, but their numbers of visible splats differ widely.
    tasks.into_par_iter().zip(counts.par_iter_mut()).with_max_len(1).for_each(
        |(mut chunk, count)| {
            *count = chunk.pack_visible(view);
        },
    );
}

fn grow<T: Clone + Default>(list: &mut Vec<T>, n: usize) {
    // An empty list marks a view without these values.
    // A longer one never shrinks: later views may need it, and counts limit what is read.
    if n == 0 {
        list.clear();
    } else if list.len() < n {
        list.resize(n, T::default());
    }
}

/// Chunk of splats, and its slice of each output list.
struct Chunk<'a> {
    splats: &'a [Splat],
    /// Appearances of the splats from the chunk's first one on; empty for a scene without appearance.
    appearance: &'a [Appearance],
    /// Index of the chunk's first splat.
    first: u32,
    ids: &'a mut [u32],
    records: &'a mut [ConicRecord],
    depth_entries: &'a mut [DepthEntry],
    gradients: &'a mut [Gradient],
    frames: &'a mut [TangentFrame],
    planes: &'a mut [SurfacePlane],
    lattices: Option<LatticeOf<'a>>,
}

impl Chunk<'_> {
    /// Writes the records of the visible splats, in order, to the front of the chunk's lists. Returns
    /// the numbers of visible and invalid splats.
    fn pack_visible(&mut self, view: &CpuView) -> ChunkCount {
        let mut count = ChunkCount::default();
        for (i, splat) in self.splats.iter().enumerate() {
            // Empty slots of the model are not invalid splats and are not counted.
            if splat.opacity <= 0.0 {
                continue;
            }
            let appearance = self.appearance.get(i);
            if !splat.is_valid() || appearance.is_some_and(|a| !a.is_valid()) {
                count.n_invalid += 1;
                continue;
            }
            if let Some(placed) = view.to_camera(splat) {
                let visible = self.write_record(view, i, placed, count.n_visible);
                count.n_visible += usize::from(visible);
            }
        }
        count
    }

    /// Writes the record of splat `i` at index `to`. Returns false if the splat is invisible.
    fn write_record(&mut self, view: &CpuView, i: usize, placed: CameraSplat, to: usize) -> bool {
        let (splats, appearance) = (self.splats, self.appearance.get(i));
        let color = |placed: &CameraSplat| shade::color(view, &splats[i], placed, appearance);
        let shade = match (self.gradients.get_mut(to), appearance) {
            (Some(place), Some(appearance)) => Some((place, ColorGradient::new(appearance, view))),
            _ => None,
        };
        let recorded = match view.method {
            RenderMethod::Projected => {
                // Colour is computed last, because many splats turn out to be invisible.
                let drawn = projected::draw(view, &placed);
                drawn.and_then(|drawn| {
                    if let Some((place, shade)) = shade {
                        *place = projected::gradient(&shade, &placed, view);
                    }
                    drawn.record(color(&placed))
                })
            }
            RenderMethod::Exact(settings) => {
                let drawn = exact::draw(view, &placed, settings);
                drawn.and_then(|(drawn, tangent)| {
                    if let Some((place, shade)) = shade {
                        *place = shade.gradient(&tangent);
                    }
                    if settings.lens == Lens::Fisheye {
                        let rows = [tangent.steps[0], tangent.steps[1], tangent.x0];
                        self.frames[to].rows = rows.map(|row| row.as_vec3().to_array());
                    }
                    drawn.record(color(&placed))
                })
            }
        };
        let Some((record, key)) = recorded else { return false };
        self.depth_entries[to] = DepthEntry::new(key, &record.rect);
        self.records[to] = record;
        self.ids[to] = self.first + i as u32;
        if let (Some(plane), Some(lattices)) = (self.planes.get_mut(to), self.lattices) {
            let number = self.first as usize + i;
            *plane = lattices(number).map_or_else(SurfacePlane::default, |lattice| {
                SurfacePlane::new(view, number, &splats[i], &placed, appearance, &lattice)
            });
        }
        true
    }
}
