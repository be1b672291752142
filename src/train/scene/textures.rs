//! Textures of components, learned from photographs (`textures.md`).

use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::{Image, split_by_sizes};
use crate::math::measured_pixel::{MASKED, MeasuredPixel};
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::texels::{
    COLOR_ONE, MAX_COLOR, Observed, OpenTexels, PRODUCT_ONE, Products, TextureSums, WEIGHT_ONE,
};
use crate::model::splat::appearance::SplatView;
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{MAX_LEVEL, PATCH, Texture, Textures};
use crate::observation::surface::Photograph;
use crate::render::cpu::CpuRenderer;
use crate::render::cpu::photometric::RowSubset;
use crate::render::cpu::surfaces::{ShownSurface, SurfaceTile, TileRun};
use crate::render::{RenderMethod, RenderOptions, TILE};
use crate::train::scene::accumulate::{ComponentParts, PARTS};
use crate::train::scene::photometric::TrainingView;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Half the side of a texture's lattice, in units of the structural scale.
const REACH: f64 = 1.2;
/// Pitch of the texels in pixels of the nearest view.
const PITCH: f64 = 1.0;
/// Level of the lattice from which a component gets a texture: 16 texels a side.
const MIN_LEVEL: u8 = 2;
/// Number of pixels above which a photograph is reduced.
const MOST_PIXELS: usize = 320_000;
/// Pixels of a photograph that add to textures, at most: of larger ones every second row of tiles adds, others
/// in the next frame.
const MOST_ADDED: usize = 160_000;
/// Both numbers for a photograph with at least [`FINER`] pixels per depth pixel, which shows more than splats can.
const MOST_FINE_PIXELS: usize = 750_000;
const FINER: f64 = 2.0;
/// Pixels of a photograph by which textures are judged, at most.
const MOST_JUDGED: usize = 100_000;
/// Blending weight below which a splat shows too little of a pixel.
const MIN_WEIGHT: f32 = 0.1;
/// Coverage of a pixel below which the scene is incomplete there.
const MIN_COVERED: f32 = 0.5;
/// Coverage of a photograph's pixel (its alpha) below which its colour is mixed with a background.
const MIN_OPAQUE: f32 = 0.99;
/// Value of a colour channel from which the sensor is saturated.
const SATURATED: u8 = 252;
/// Number of visible splats by which components are divided into parts of similar work.
const SAMPLED: usize = 1024;
/// Number of runs of tiles per thread, so that threads finish at about the same time.
const RUNS_PER_THREAD: usize = 2;
/// Mark of a listed component without a texture.
const LISTED: u32 = u32::MAX;
/// Number of consecutive components per task that begins textures.
const BEGUN_BY_TASK: usize = 256;

/// Learner of textures: the state holds their sums, the learner what is derived from them.
#[derive(Default)]
pub(in crate::train::scene) struct TextureLearner {
    renderer: CpuRenderer,
    /// What the runs of tiles of the latest photographs add; their memory is reused.
    observed: Vec<Lists<Observed>>,
    products: Vec<Lists<Products>>,
    /// Texture as drawn of every component; empty where it has changed since it was last drawn.
    drawn: Vec<OnceLock<Arc<Texture>>>,
}

/// A photograph and how it was taken.
#[derive(Clone, Copy)]
pub(in crate::train::scene) struct Taken<'a> {
    pub photograph: &'a Photograph,
    /// Camera of the photograph.
    pub camera: Camera,
    pub near: f64,
    /// Factor from the photograph's colours to the scene's.
    pub gain: [f32; 3],
    pub margin: [f32; 2],
    /// Number of pixels of the photograph per pixel of the depth image, at least 1.
    pub per_depth_pixel: f64,
    /// Number of frames before this one.
    pub frame: u64,
}

impl Taken<'_> {
    /// True if the photograph shows more than splats can.
    pub fn is_fine(&self) -> bool {
        self.per_depth_pixel >= FINER
    }
}

impl TextureLearner {
    /// Adds a photograph to the textures of the splats that it shows. `changed` lists the components whose
    /// splats have changed since the last call, `h` is the structural scale in world units, `budget` the
    /// memory for textures in bytes.
    pub fn learn(
        &mut self,
        state: &mut PhotometricState,
        changed: &[u32],
        h: f64,
        budget: usize,
        taken: &Taken<'_>,
    ) {
        let [most, most_added] =
            if taken.is_fine() { [MOST_FINE_PIXELS; 2] } else { [MOST_PIXELS, MOST_ADDED] };
        let pixels = taken.photograph.colors.data.len();
        let factor = (pixels as f64 / most as f64).sqrt().ceil().max(1.0) as usize;
        let intrinsics = reduced_intrinsics(&taken.photograph.intrinsics, factor);
        let camera = Camera { intrinsics, ..taken.camera };
        self.begin(state, changed, h, &camera);
        if !state.has_textures() {
            return;
        }
        // Fewer rows instead of a smaller picture would show as stripes until all rows have been seen.
        let reduced = (factor > 1).then(|| reduced(taken.photograph, factor));
        let photograph = reduced.as_ref().unwrap_or(taken.photograph);
        let taken = &Taken { photograph, camera, ..*taken };
        let shown = tile_rows(&camera.intrinsics, most_added, taken.frame);
        let mut runs = std::mem::take(&mut self.observed);
        let parts = self.visit(state, &camera, taken.near, &shown, &mut runs, |tile, to| {
            list_observed(tile, taken, &state.textures, to);
        });
        self.change(&mut state.textures, &parts, &runs, TextureSums::open, OpenTexels::add);
        self.observed = runs;
        if state.coarsen_textures_to(budget) {
            self.forget_drawn();
        }
    }

    /// Compares textures with a photograph before its photometric step, as if they had not learned it.
    /// `photograph` has the colours of the scene's exposure.
    pub fn judge(
        &mut self,
        state: &mut PhotometricState,
        view: &TrainingView,
        photograph: &Image<MeasuredPixel>,
    ) {
        let shown = tile_rows(&view.camera.intrinsics, MOST_JUDGED, view.frame);
        let mut runs = std::mem::take(&mut self.products);
        let parts = self.visit(state, &view.camera, view.near, &shown, &mut runs, |tile, to| {
            list_products(tile, view.rows, photograph, &state.textures, to);
        });
        self.change(
            &mut state.textures,
            &parts,
            &runs,
            |texture| {
                texture.fade();
                texture
            },
            |texture, products| texture.add_products(products),
        );
        self.products = runs;
    }

    /// Draws the textured splats of a view and calls `list` for the tiles of the rows in `shown`. Replaces `runs` by
    /// the lists of each run of tiles, by parts of the components. Returns these parts.
    fn visit<T: Send>(
        &mut self,
        state: &PhotometricState,
        camera: &Camera,
        near: f64,
        shown: &[usize],
        runs: &mut Vec<Lists<T>>,
        list: impl Fn(&SurfaceTile<'_>, &mut ListsByPart<'_, T>) + Sync,
    ) -> ComponentParts {
        runs.par_iter_mut().flatten().for_each(|list| {
            // Views differ, so each list would retain the memory of the view that filled it most.
            list.shrink_to(2 * list.len());
            list.clear();
        });
        let splats = SplatView::new(&state.splats, &state.appearance);
        let lattice = |splat: usize| Some(state.textures.get(splat)?.as_ref()?.lattice);
        let plain = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let options = RenderOptions { near, ..plain };
        let splats = splats.filter(|_| state.has_textures());
        let view =
            splats.and_then(|splats| self.renderer.surfaces(splats, &lattice, camera, &options));
        let Some(view) = view else { return ComponentParts::default() };
        let parts = ComponentParts::new(&view.sampled(SAMPLED), state.textures.len());
        let tiles = tile_runs(shown, camera.intrinsics.width as usize);
        runs.resize_with(tiles.len(), || std::array::from_fn(|_| Vec::new()));
        let runs = runs.iter_mut().map(|lists| ListsByPart { parts: &parts, lists });
        view.visit(tiles.into_iter().zip(runs), list);
        parts
    }

    /// Calls `begin` once for every texture that has listed items, and `change` with its result for every item.
    fn change<'s, T: Sync, O>(
        &mut self,
        textures: &'s mut [Option<Arc<TextureSums>>],
        parts: &ComponentParts,
        runs: &[Lists<T>],
        begin: impl Fn(&'s mut TextureSums) -> O + Sync,
        change: impl Fn(&mut O, &T) + Sync,
    ) {
        self.drawn.resize_with(textures.len(), OnceLock::new);
        let drawn = split_by_sizes(&mut self.drawn, parts.sizes());
        let tasks = split_by_sizes(textures, parts.sizes()).into_par_iter().zip(drawn);
        tasks.zip(parts.firsts()).enumerate().with_max_len(1).for_each(
            |(part, ((mut rest, drawn), &first))| {
                let items = || runs.iter().flat_map(|lists| &lists[part]);
                // One more than the number of each listed component in `changed`, so that the memory of others, zeroed
                // by the system, is not touched.
                let (mut numbers, mut listed) = (vec![0u32; rest.len()], Vec::new());
                for (component, _) in items() {
                    let row = *component as usize - first;
                    if std::mem::replace(&mut numbers[row], LISTED) == 0 {
                        listed.push(row);
                    }
                }
                listed.sort_unstable();
                // `Arc::make_mut` counts references atomically, which would take longer than adding an item.
                let mut changed = Vec::with_capacity(listed.len());
                let mut begun = 0;
                for row in listed {
                    let skipped = row - std::mem::replace(&mut begun, row + 1);
                    rest = rest.split_off_mut(skipped..).unwrap_or_default();
                    let texture = rest.split_off_first_mut().and_then(Option::as_mut);
                    let Some(texture) = texture.map(Arc::make_mut) else { continue };
                    changed.push(begin(texture));
                    drawn[row].take();
                    numbers[row] = changed.len() as u32;
                }
                for (component, item) in items() {
                    let number = numbers[*component as usize - first].wrapping_sub(1);
                    if let Some(texture) = changed.get_mut(number as usize) {
                        change(texture, item);
                    }
                }
            },
        );
    }

    /// Begins textures for changed splats that have none, lays lattices anew whose splat has moved, and refines
    /// textures that the camera sees near.
    fn begin(&mut self, state: &mut PhotometricState, changed: &[u32], h: f64, camera: &Camera) {
        let PhotometricState { splats, textures, texture_steps, .. } = state;
        textures.resize(splats.len(), None);
        self.drawn.resize_with(splats.len(), OnceLock::new);
        let reach = REACH * h;
        let per_depth = PITCH * f64::from(1u32 << (*texture_steps).min(16)) / camera.intrinsics.fx;
        let begin = |id: usize, texture: &mut Option<Arc<TextureSums>>, drawn: &mut OnceLock<_>| {
            let splat = &splats[id];
            if !splat.is_drawable() {
                drawn.take();
                *texture = None;
                return;
            }
            let Some(depth) = depth_of(splat, camera) else { return };
            let level = (2.0 * reach / (depth * per_depth * PATCH as f64)).log2().floor();
            let level = level.clamp(0.0, MAX_LEVEL.into()) as u8;
            // Splats of few pixels show what the photograph shows.
            if level < MIN_LEVEL && texture.is_none() {
                return;
            }
            let texture =
                texture.get_or_insert_with(|| Arc::new(TextureSums::new(splat, reach as f32)));
            let (is_finer, is_off) = (texture.lattice.level < level, !texture.fits(splat));
            if is_finer || is_off {
                let texture = Arc::make_mut(texture);
                if is_off {
                    texture.lay_anew(splat, reach as f32);
                }
                texture.refine(level);
                drawn.take();
            }
        };
        let tasks = textures.par_chunks_mut(BEGUN_BY_TASK);
        let tasks = tasks.zip(self.drawn.par_chunks_mut(BEGUN_BY_TASK)).enumerate();
        tasks.for_each(|(task, (textures, drawn))| {
            let first = task * BEGUN_BY_TASK;
            let at = |end: usize| changed.partition_point(|&id| (id as usize) < end);
            for &id in &changed[at(first)..at(first + textures.len())] {
                let row = id as usize - first;
                begin(id as usize, &mut textures[row], &mut drawn[row]);
            }
        });
    }

    /// Marks all textures as changed.
    pub fn forget_drawn(&mut self) {
        self.drawn.iter_mut().for_each(|drawn| drop(drawn.take()));
    }

    /// Returns the textures to draw; `None` if there are none.
    pub fn drawn(&self, state: &PhotometricState) -> Option<Arc<Textures>> {
        if !state.has_textures() {
            return None;
        }
        let draw = |(id, texture): (usize, &Option<Arc<TextureSums>>)| {
            let texture = texture.as_ref()?;
            let draw = || Arc::new(texture.drawn());
            // The list is shorter after a checkpoint was opened, before the next photograph.
            Some(self.drawn.get(id).map_or_else(draw, |drawn| drawn.get_or_init(draw).clone()))
        };
        Some(Arc::new(state.textures.par_iter().enumerate().with_min_len(64).map(draw).collect()))
    }
}

/// Returns a photograph whose pixels are the means of `factor` × `factor` pixels, with the depths of their
/// centres. A channel that is saturated in one of them is saturated.
fn reduced(photograph: &Photograph, factor: usize) -> Photograph {
    let Image { width, height, .. } = *photograph.colors;
    let (columns, rows) = (width / factor, height / factor);
    let mean = |[x, y]: [usize; 2]| {
        let (mut sum, mut most, mut is_masked) = ([0; 4], [0; 4], false);
        for row in y * factor..(y + 1) * factor {
            let pixels = &photograph.colors.data[row * width + x * factor..][..factor];
            for pixel in pixels {
                is_masked |= *pixel == MASKED;
                for channel in 0..4 {
                    sum[channel] += u32::from(pixel[channel]);
                    most[channel] = pixel[channel].max(most[channel]);
                }
            }
        }
        let n = (factor * factor) as u32;
        let mut mean = sum.map(|sum| ((sum + n / 2) / n) as u8);
        for channel in (0..3).filter(|&channel| most[channel] >= SATURATED) {
            mean[channel] = u8::MAX;
        }
        if is_masked { MASKED } else { mean }
    };
    let at = |i: usize| [i % columns, i / columns];
    let n = columns * rows;
    let colors = (0..n).into_par_iter().with_min_len(1024).map(|i| mean(at(i))).collect();
    let depth = |i: usize| {
        let [x, y] = at(i).map(|v| v * factor + factor / 2);
        photograph.depths.data[y * width + x]
    };
    let depths = (0..n).into_par_iter().with_min_len(1024).map(depth).collect();
    Photograph {
        intrinsics: reduced_intrinsics(&photograph.intrinsics, factor),
        colors: Image::from_vec(columns, rows, colors).into(),
        depths: Image::from_vec(columns, rows, depths),
        // The other fields one by one: a clone would copy all depths.
        offset: photograph.offset,
        rotation: photograph.rotation,
        gain: photograph.gain,
        has_coverage: photograph.has_coverage,
    }
}

/// Returns the intrinsics of a [`reduced`] photograph.
fn reduced_intrinsics(k: &Intrinsics, factor: usize) -> Intrinsics {
    let per = 1.0 / factor as f64;
    Intrinsics {
        width: k.width / factor as u32,
        height: k.height / factor as u32,
        fx: k.fx * per,
        fy: k.fy * per,
        cx: k.cx * per,
        cy: k.cy * per,
    }
}

/// Returns every n-th row of tiles of a photograph, others in every frame, with about `most` pixels in all.
fn tile_rows(intrinsics: &Intrinsics, most: usize, frame: u64) -> Vec<usize> {
    let [width, height] = [intrinsics.width, intrinsics.height].map(|n| n as usize);
    let stride = (width * height).div_ceil(most).next_power_of_two();
    (frame as usize % stride..height.div_ceil(TILE)).step_by(stride).collect()
}

/// Returns the depth of a splat's mean along the optical axis, world units; `None` behind the camera.
fn depth_of(splat: &Splat, camera: &Camera) -> Option<f64> {
    let mean = DVec3::from_array(splat.mean.map(f64::from));
    let depth = (camera.pose.rotation().transpose() * (mean - camera.pose.centre())).z;
    (depth > 0.0).then_some(depth)
}

/// Divides rows of tiles of a photograph into runs of tiles, if there are fewer rows than threads need.
fn tile_runs(rows: &[usize], width: usize) -> Vec<TileRun> {
    let n_columns = width.div_ceil(TILE);
    let n_runs = (RUNS_PER_THREAD * rayon::current_num_threads()).div_ceil(rows.len().max(1));
    let columns = n_columns.div_ceil(n_runs).max(1);
    let run =
        |row: usize, left: usize| TileRun { row, columns: left..(left + columns).min(n_columns) };
    let runs_of = |&row: &usize| (0..n_columns).step_by(columns).map(move |left| run(row, left));
    rows.iter().flat_map(runs_of).collect()
}

/// Items with their components, by parts of the components.
type Lists<T> = [Vec<(u32, T)>; PARTS];

/// Lists of a run of tiles.
struct ListsByPart<'a, T> {
    parts: &'a ComponentParts,
    lists: &'a mut Lists<T>,
}

impl<T> ListsByPart<'_, T> {
    #[inline(always)]
    fn push(&mut self, component: u32, item: T) {
        if let Some(part) = self.parts.part_of(component) {
            self.lists[part].push((component, item));
        }
    }
}

/// Lists what a tile of the photograph adds to textures.
fn list_observed(
    tile: &SurfaceTile<'_>,
    taken: &Taken<'_>,
    textures: &[Option<Arc<TextureSums>>],
    lists: &mut ListsByPart<'_, Observed>,
) {
    let Image { width, height, .. } = *taken.photograph.colors;
    let [left, top] = tile.first;
    let columns = left..(left + TILE).min(width);
    for y in top..(top + TILE).min(height) {
        let raw = &taken.photograph.colors.data[y * width..][columns.clone()];
        let pixels = taken.photograph.measured_row(y, columns.clone(), taken.margin);
        for (x, (pixel, raw)) in pixels.zip(raw).enumerate() {
            let at = [x, y - top];
            if raw[..3].iter().any(|&c| c >= SATURATED) || !is_shown(tile, at, &pixel) {
                continue;
            }
            let ([r, g, b], gain) = (pixel.color, taken.gain);
            let color = [r * gain[0], g * gain[1], b * gain[2]];
            for which in 0..2 {
                let Some((surface, texture)) = surface(tile, at, which, &pixel, textures) else {
                    continue;
                };
                if let Some(observed) = observed(texture, &surface, color) {
                    lists.push(surface.splat, observed);
                }
            }
        }
    }
}

/// Lists the products of a tile for [`TextureSums::add_products`].
fn list_products(
    tile: &SurfaceTile<'_>,
    compared: RowSubset,
    photograph: &Image<MeasuredPixel>,
    textures: &[Option<Arc<TextureSums>>],
    lists: &mut ListsByPart<'_, Products>,
) {
    let [left, top] = tile.first;
    let rows = top..(top + TILE).min(photograph.height);
    let columns = left..(left + TILE).min(photograph.width);
    let is_compared = |y: &usize| *y as u32 % compared.stride() == compared.first();
    for y in rows.filter(is_compared) {
        let pixels = &photograph.data[y * photograph.width..][columns.clone()];
        for (x, pixel) in pixels.iter().enumerate() {
            let at = [x, y - top];
            if !is_shown(tile, at, pixel) {
                continue;
            }
            let drawn = tile.color(at);
            for which in 0..2 {
                let Some((surface, texture)) = surface(tile, at, which, pixel, textures) else {
                    continue;
                };
                let Some(own) = observed(texture, &surface, pixel.color) else { continue };
                let mut products = Products::default();
                let samples = texture.samples_without(surface.place, &own);
                for (products, sample) in products.iter_mut().zip(samples) {
                    let (mut cross, mut power) = (0.0, 0.0);
                    for (channel, &drawn) in drawn.iter().enumerate() {
                        let replaced = sample.share * (drawn - surface.shift[channel]);
                        let correction = sample.color[channel] - replaced;
                        cross += correction * (pixel.color[channel] - drawn);
                        power += correction * correction;
                    }
                    let unit = surface.weight * PRODUCT_ONE;
                    *products = [(unit * cross) as i32, (unit * power) as i32];
                }
                lists.push(surface.splat, products);
            }
        }
    }
}

/// True if a photograph's pixel shows surfaces of the scene, without background.
#[inline(always)]
fn is_shown(tile: &SurfaceTile<'_>, at: [usize; 2], pixel: &MeasuredPixel) -> bool {
    // Photographs without alpha have unknown coverage, which is not a number and fails the comparison.
    let is_mixed = pixel.coverage < MIN_OPAQUE;
    !is_mixed && tile.coverage(at) >= MIN_COVERED
}

/// Returns a surface that a pixel of a photograph shows, with its texture; `which` is 0 for the one with the
/// largest weight.
#[inline(always)]
fn surface<'a>(
    tile: &SurfaceTile<'_>,
    at: [usize; 2],
    which: usize,
    pixel: &MeasuredPixel,
    textures: &'a [Option<Arc<TextureSums>>],
) -> Option<(ShownSurface, &'a TextureSums)> {
    let surface = tile.at(at, which, MIN_WEIGHT)?;
    // The photograph may show another surface than the one that the splat is part of.
    let apart = (surface.depth - pixel.depth).abs() * pixel.per_tolerance;
    let texture = textures.get(surface.splat as usize)?.as_deref()?;
    (apart <= 1.0).then_some((surface, texture))
}

/// Returns what a pixel of colour `color` adds to the texture of a surface that it shows; `None` outside of
/// the lattice.
#[inline(always)]
fn observed(texture: &TextureSums, surface: &ShownSurface, color: [f32; 3]) -> Option<Observed> {
    let [x, y] = surface.place;
    let side = texture.lattice.side() as f32;
    if !(x >= 0.0 && y >= 0.0 && x < side && y < side) {
        return None;
    }
    let mut limited = [0; 3];
    for (limited, (color, shift)) in limited.iter_mut().zip(color.into_iter().zip(surface.shift)) {
        // Rounded by a cast of a positive number; `round` is a call of a function.
        let positive = ((color - shift).clamp(-MAX_COLOR, MAX_COLOR) + MAX_COLOR) * COLOR_ONE;
        *limited = (positive + 0.5) as i16 - (MAX_COLOR * COLOR_ONE) as i16;
    }
    Some(Observed {
        texel: texture.lattice.number_of([x as usize, y as usize]),
        weight: (surface.weight.min(1.0) * WEIGHT_ONE + 0.5) as u16,
        color: limited,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn reduced_pixels_are_means_unless_saturated() {
        let color = |i: usize| [i as u8, 10, if i == 9 { 255 } else { 20 }, 255];
        let photograph = Photograph {
            intrinsics: Intrinsics::from_horizontal_fov(5, 4, 0.8),
            offset: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            colors: Image::from_vec(5, 4, (0..20).map(color).collect()).into(),
            gain: [1.0; 3],
            depths: Image::from_vec(5, 4, (0..20).map(|i| i as f32).collect()),
            has_coverage: false,
        };
        let half = reduced(&photograph, 2);
        assert_eq!((half.colors.width, half.colors.height), (2, 2));
        // The fifth column is left out. Pixels 0, 1, 5 and 6 have the mean 3.
        assert_eq!(half.colors.data[0], [3, 10, 20, 255]);
        assert_eq!(half.colors.data[3], [15, 10, 20, 255]);
        assert_eq!(half.depths.data, [6.0, 8.0, 16.0, 18.0]);
        // The ray through the middle of four pixels is that of the pixel they become.
        let (whole, part) = (photograph.intrinsics, half.intrinsics);
        let middle = (whole.ray(2, 0) + whole.ray(3, 1)) / 2.0;
        assert!(part.ray(1, 0).distance(middle) < 1e-12);
        let bright = Photograph {
            colors: Image::from_vec(5, 4, vec![[251; 4]; 20]).into(),
            ..photograph.clone()
        };
        assert_eq!(reduced(&bright, 2).colors.data[0], [251; 4]);
        let mut data = bright.colors.data.clone();
        data[6][1] = SATURATED;
        let one = Photograph { colors: Image::from_vec(5, 4, data).into(), ..photograph };
        assert_eq!(reduced(&one, 2).colors.data[0], [251, 255, 251, 251]);
    }
}
