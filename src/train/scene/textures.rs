//! Textures of components, learned from photographs (`textures.md`).

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::texels::{
    COLOR_ONE, MAX_COLOR, Observed, PRODUCT_ONE, Products, TextureSums, WEIGHT_ONE,
};
use crate::model::splat::appearance::SplatView;
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{MAX_LEVEL, PATCH, Texture, Textures};
use crate::observation::surface::Photograph;
use crate::render::cpu::CpuRenderer;
use crate::render::cpu::photometric::RowSubset;
use crate::render::cpu::surfaces::{ShownSurface, SurfaceRow};
use crate::render::{RenderMethod, RenderOptions, TILE};
use crate::train::scene::photometric::TrainingView;
use glam::DVec3;
use rayon::prelude::*;
use std::sync::{Arc, OnceLock};

/// Half the side of a texture's lattice, in units of the structural scale.
const REACH: f64 = 1.2;
/// Pitch of the texels in pixels of the nearest view.
const PITCH: f64 = 1.0;
/// Pixels of a photograph that add to textures, at most: larger photographs add every n-th row of tiles, other
/// rows in every frame.
const MOST_PIXELS: usize = 400_000;
/// Blending weight below which a splat shows too little of a pixel.
const MIN_WEIGHT: f32 = 0.1;
/// Coverage of a pixel below which the scene is incomplete there.
const MIN_COVERED: f32 = 0.5;
/// Coverage of a photograph's pixel (its alpha) below which its colour is mixed with a background.
const MIN_OPAQUE: f32 = 0.99;
/// Value of a colour channel from which the sensor is saturated.
const SATURATED: u8 = 252;
/// Number of lists that the pixels of a row of tiles are divided into, by component.
const PARTS: usize = 32;

/// Learner of textures: the state holds their sums, the learner what is derived from them.
#[derive(Default)]
pub(in crate::train::scene) struct TextureLearner {
    renderer: CpuRenderer,
    /// Texture as drawn of every component; empty where it has changed since it was last drawn.
    drawn: Vec<OnceLock<Arc<Texture>>>,
}

/// A photograph and how it was taken.
pub(in crate::train::scene) struct Taken<'a> {
    pub photograph: &'a Photograph,
    /// Camera of the photograph.
    pub camera: Camera,
    pub near: f64,
    /// Factor from the photograph's colours to the scene's.
    pub gain: [f32; 3],
    pub margin: [f32; 2],
    /// Number of frames before this one.
    pub frame: u64,
}

/// Rows of tiles of a photograph that add to textures: one of `stride`, others in every frame.
#[derive(Clone, Copy)]
struct TileRows {
    stride: usize,
    first: usize,
}

impl TileRows {
    fn of(pixels: usize, frame: u64) -> Self {
        let stride = pixels.div_ceil(MOST_PIXELS).next_power_of_two();
        Self { stride, first: frame as usize % stride }
    }

    fn contains(self, row: usize) -> bool {
        row % self.stride == self.first
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
        self.begin(state, changed, h, &taken.camera);
        let shown = TileRows::of(taken.photograph.colors.data.len(), taken.frame);
        let rows = self.visit(state, &taken.camera, taken.near, shown, |row| {
            observations(row, taken, &state.textures)
        });
        self.change(&mut state.textures, &rows, |texture, _, observed| texture.add(observed));
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
        let shown = TileRows::of(photograph.data.len(), view.frame);
        let rows = self.visit(state, &view.camera, view.near, shown, |row| {
            products(row, view.rows, photograph, &state.textures)
        });
        self.change(&mut state.textures, &rows, |texture, is_first, products| {
            if is_first {
                texture.fade();
            }
            texture.add_products(products);
        });
    }

    /// Draws the textured splats of a view and returns what `list` returns for the rows of tiles in `shown`.
    fn visit<T: Send>(
        &mut self,
        state: &PhotometricState,
        camera: &Camera,
        near: f64,
        shown: TileRows,
        list: impl Fn(&SurfaceRow<'_>) -> T + Sync,
    ) -> Vec<T> {
        let Some(splats) = SplatView::new(&state.splats, &state.appearance) else {
            return Vec::new();
        };
        let lattice = |splat: usize| Some(state.textures.get(splat)?.as_ref()?.lattice);
        let plain = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let options = RenderOptions { near, ..plain };
        let shown = |row| shown.contains(row);
        self.renderer.visit_surfaces(splats, &lattice, camera, &options, shown, list)
    }

    /// Calls `change` for all listed items, with the texture and whether it is the texture's first item.
    fn change<T: Sync>(
        &mut self,
        textures: &mut [Option<Arc<TextureSums>>],
        rows: &[Lists<T>],
        change: impl Fn(&mut TextureSums, bool, &T) + Sync,
    ) {
        let size = part_size(textures.len());
        self.drawn.resize_with(textures.len(), OnceLock::new);
        let tasks = textures.par_chunks_mut(size).zip(self.drawn.par_chunks_mut(size));
        tasks.enumerate().with_max_len(1).for_each(|(part, (textures, drawn))| {
            let mut seen = vec![false; textures.len()];
            for (component, item) in rows.iter().flat_map(|row| &row[part]) {
                let at = *component as usize - part * size;
                let Some(texture) = &mut textures[at] else { continue };
                let is_first = !std::mem::replace(&mut seen[at], true);
                if is_first {
                    drawn[at].take();
                }
                change(Arc::make_mut(texture), is_first, item);
            }
        });
    }

    /// Begins textures for changed splats that have none, lays lattices anew whose splat has moved, and refines
    /// textures that the camera sees near.
    fn begin(&mut self, state: &mut PhotometricState, changed: &[u32], h: f64, camera: &Camera) {
        let PhotometricState { splats, textures, texture_steps, .. } = state;
        textures.resize(splats.len(), None);
        self.drawn.resize_with(splats.len(), OnceLock::new);
        let reach = REACH * h;
        let per_depth = PITCH * f64::from(1u32 << (*texture_steps).min(16)) / camera.intrinsics.fx;
        for &id in changed {
            let (splat, texture) = (&splats[id as usize], &mut textures[id as usize]);
            if !splat.is_drawable() {
                self.drawn[id as usize].take();
                *texture = None;
                continue;
            }
            let Some(depth) = depth_of(splat, camera) else { continue };
            let level = (2.0 * reach / (depth * per_depth * PATCH as f64)).log2().floor();
            let level = level.clamp(0.0, MAX_LEVEL.into()) as u8;
            let texture =
                texture.get_or_insert_with(|| Arc::new(TextureSums::new(splat, reach as f32)));
            let (is_finer, is_off) = (texture.lattice.level < level, !texture.fits(splat));
            if is_finer || is_off {
                let texture = Arc::make_mut(texture);
                if is_off {
                    texture.lay_anew(splat, reach as f32);
                }
                texture.refine(level);
                self.drawn[id as usize].take();
            }
        }
    }

    /// Marks all textures as changed.
    pub fn forget_drawn(&mut self) {
        self.drawn.iter_mut().for_each(|drawn| drop(drawn.take()));
    }

    /// Returns the textures to draw; `None` if there are none.
    pub fn drawn(&self, state: &PhotometricState) -> Option<Arc<Textures>> {
        if state.textures.iter().all(Option::is_none) {
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

/// Returns the depth of a splat's mean along the optical axis, world units; `None` behind the camera.
fn depth_of(splat: &Splat, camera: &Camera) -> Option<f64> {
    let mean = DVec3::from_array(splat.mean.map(f64::from));
    let depth = (camera.pose.rotation().transpose() * (mean - camera.pose.centre())).z;
    (depth > 0.0).then_some(depth)
}

/// Items with their components, divided by component into [`PARTS`] lists.
type Lists<T> = Vec<Vec<(u32, T)>>;

/// Returns the number of components of a list, except that the last may have fewer.
fn part_size(n_components: usize) -> usize {
    n_components.div_ceil(PARTS).max(1)
}

/// Lists what a row of tiles of the photograph adds to textures.
fn observations(
    row: &SurfaceRow<'_>,
    taken: &Taken<'_>,
    textures: &[Option<Arc<TextureSums>>],
) -> Lists<Observed> {
    let size = part_size(textures.len());
    let Image { width, height, .. } = *taken.photograph.colors;
    let mut lists = vec![Vec::new(); PARTS];
    for y in row.top..(row.top + TILE).min(height) {
        let raw = &taken.photograph.colors.data[y * width..][..width];
        let pixels = taken.photograph.measured_row(y, taken.margin);
        for (x, (pixel, raw)) in pixels.zip(raw).enumerate() {
            if raw[..3].iter().any(|&c| c >= SATURATED) {
                continue;
            }
            let color = [0, 1, 2].map(|c| pixel.color[c] * taken.gain[c]);
            for (surface, texture) in surfaces(row, [x, y], &pixel, textures).into_iter().flatten()
            {
                if let Some(observed) = observed(texture, &surface, color) {
                    lists[surface.splat as usize / size].push((surface.splat, observed));
                }
            }
        }
    }
    lists
}

/// Lists the products of a row of tiles for [`TextureSums::add_products`].
fn products(
    row: &SurfaceRow<'_>,
    compared: RowSubset,
    photograph: &Image<MeasuredPixel>,
    textures: &[Option<Arc<TextureSums>>],
) -> Lists<Products> {
    let size = part_size(textures.len());
    let mut lists = vec![Vec::new(); PARTS];
    let rows = row.top..(row.top + TILE).min(photograph.height);
    let is_compared = |y: &usize| *y as u32 % compared.stride() == compared.first();
    for y in rows.filter(is_compared) {
        let pixels = &photograph.data[y * photograph.width..][..photograph.width];
        for (x, pixel) in pixels.iter().enumerate() {
            for (surface, texture) in surfaces(row, [x, y], pixel, textures).into_iter().flatten() {
                let Some(own) = observed(texture, &surface, pixel.color) else { continue };
                let (drawn, _) = row.drawn(x, y);
                let samples = texture.samples_without(surface.place, &own);
                let products = samples.map(|sample| {
                    let of_channel = |c: usize| {
                        let replaced = sample.share * (drawn[c] - surface.shift[c]);
                        let correction = sample.color[c] - replaced;
                        [correction * (pixel.color[c] - drawn[c]), correction * correction]
                    };
                    let [r, g, b] = [0, 1, 2].map(of_channel);
                    let products = [0, 1].map(|i| r[i] + g[i] + b[i]);
                    products.map(|sum| (surface.weight * sum * PRODUCT_ONE).round() as i32)
                });
                lists[surface.splat as usize / size].push((surface.splat, products));
            }
        }
    }
    lists
}

/// Returns the surfaces that a pixel of a photograph shows, with their textures.
fn surfaces<'a>(
    row: &SurfaceRow<'_>,
    [x, y]: [usize; 2],
    pixel: &MeasuredPixel,
    textures: &'a [Option<Arc<TextureSums>>],
) -> [Option<(ShownSurface, &'a TextureSums)>; 2] {
    // False for the unknown coverage of photographs without alpha, which is not a number.
    if pixel.coverage < MIN_OPAQUE || row.drawn(x, y).1 < MIN_COVERED {
        return [None; 2];
    }
    row.at(x, y).map(|surface| {
        let surface = surface?;
        // The photograph may show another surface than the one that the splat is part of.
        let apart = (surface.depth - pixel.depth).abs() * pixel.per_tolerance;
        let texture = textures.get(surface.splat as usize)?.as_deref()?;
        (surface.weight >= MIN_WEIGHT && apart <= 1.0).then_some((surface, texture))
    })
}

/// Returns what a pixel of colour `color` adds to the texture of a surface that it shows; `None` outside of
/// the lattice.
fn observed(texture: &TextureSums, surface: &ShownSurface, color: [f32; 3]) -> Option<Observed> {
    let side = texture.lattice.side();
    let [x, y] = surface.place;
    let inside = |v: f32| v >= 0.0 && v < side as f32;
    if !(inside(x) && inside(y)) {
        return None;
    }
    let limited = |c: f32| (c.clamp(-MAX_COLOR, MAX_COLOR) * COLOR_ONE).round() as i16;
    Some(Observed {
        texel: (y as usize * side + x as usize) as u16,
        weight: (surface.weight.min(1.0) * WEIGHT_ONE).round() as u16,
        color: [0, 1, 2].map(|c| limited(color[c] - surface.shift[c])),
    })
}
