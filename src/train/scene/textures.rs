//! Textures of components, learned from photographs (`textures.md`).

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::texels::{
    COLOR_ONE, MAX_COLOR, Observed, PRODUCT_ONE, TextureSums, WEIGHT_ONE,
};
use crate::model::splat::appearance::SplatView;
use crate::model::splat::splats::Splat;
use crate::model::splat::texture::{MAX_LEVEL, PATCH, Texture, Textures};
use crate::observation::surface::Photograph;
use crate::render::cpu::CpuRenderer;
use crate::render::cpu::surfaces::{ShownSurface, SurfaceRow};
use crate::render::{RenderMethod, RenderOptions, TILE};
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
const MIN_WEIGHT: f32 = 0.05;
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
        let pixels = taken.photograph.colors.data.len();
        let stride = pixels.div_ceil(MOST_PIXELS).next_power_of_two();
        let first = taken.frame as usize % stride;
        let options = RenderOptions {
            near: taken.near,
            ..RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3])
        };
        let PhotometricState { splats, appearance, textures, .. } = state;
        let Some(view) = SplatView::new(splats, appearance) else { return };
        let size = textures.len().div_ceil(PARTS).max(1);
        let known = &*textures;
        let lattice = |splat: usize| Some(known.get(splat)?.as_ref()?.lattice);
        let rows = self.renderer.visit_surfaces(
            view,
            &lattice,
            &taken.camera,
            &options,
            |row| row % stride == first,
            |row| observations(row, taken, known, size),
        );
        let tasks = textures.par_chunks_mut(size).zip(self.drawn.par_chunks_mut(size));
        tasks.enumerate().with_max_len(1).for_each(|(part, (textures, drawn))| {
            for (component, observed) in rows.iter().flat_map(|row| &row[part]) {
                let at = *component as usize - part * size;
                if let Some(texture) = &mut textures[at] {
                    Arc::make_mut(texture).add(observed);
                    drawn[at].take();
                }
            }
        });
        self.keep_within(state, budget);
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

    /// Doubles the pitch of all textures until they take at most `budget` bytes.
    fn keep_within(&mut self, state: &mut PhotometricState, budget: usize) {
        while state.texture_bytes() > budget {
            let is_coarsest = |texture: &Arc<TextureSums>| texture.lattice.level == 0;
            if state.textures.iter().flatten().all(is_coarsest) {
                return;
            }
            state.texture_steps += 1;
            state.textures.par_iter_mut().flatten().for_each(|texture| {
                Arc::make_mut(texture).coarsen();
            });
            self.forget_drawn();
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
            Some(match self.drawn.get(id) {
                Some(drawn) => drawn.get_or_init(|| Arc::new(texture.drawn())).clone(),
                // After a checkpoint was opened, before the next photograph.
                None => Arc::new(texture.drawn()),
            })
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

/// Lists what a row of tiles of the photograph adds to textures, divided by component: `size` components in
/// each list.
fn observations(
    row: &SurfaceRow<'_>,
    taken: &Taken<'_>,
    textures: &[Option<Arc<TextureSums>>],
    size: usize,
) -> Vec<Vec<(u32, Observed)>> {
    let Image { width, height, .. } = *taken.photograph.colors;
    let mut lists = vec![Vec::new(); PARTS];
    for y in row.top..(row.top + TILE).min(height) {
        let raw = &taken.photograph.colors.data[y * width..][..width];
        let pixels = taken.photograph.measured_row(y, taken.margin);
        for (x, (pixel, raw)) in pixels.zip(raw).enumerate() {
            if raw[..3].iter().any(|&c| c >= SATURATED) || pixel.coverage < MIN_OPAQUE {
                continue;
            }
            let (drawn, covered) = row.drawn(x, y);
            if covered < MIN_COVERED {
                continue;
            }
            let color = [0, 1, 2].map(|c| pixel.color[c] * taken.gain[c]);
            for surface in row.at(x, y).into_iter().flatten() {
                // The photograph may show another surface than the one that the splat is part of.
                let apart = (surface.depth - pixel.depth).abs() * pixel.per_tolerance;
                let id = surface.splat as usize;
                if surface.weight >= MIN_WEIGHT
                    && apart <= 1.0
                    && let Some(texture) = textures.get(id).and_then(Option::as_ref)
                    && let Some(observed) = observed(texture, &surface, color, drawn)
                {
                    lists[id / size].push((surface.splat, observed));
                }
            }
        }
    }
    lists
}

/// Returns what a pixel adds to the texture of a surface that it shows; `None` outside of the lattice. `color`
/// is the photograph's, `drawn` what the splats draw without textures.
fn observed(
    texture: &TextureSums,
    surface: &ShownSurface,
    color: [f32; 3],
    drawn: [f32; 3],
) -> Option<Observed> {
    let side = texture.lattice.side();
    let [x, y] = surface.place;
    let inside = |v: f32| v >= 0.0 && v < side as f32;
    if !(inside(x) && inside(y)) {
        return None;
    }
    // This photograph is not part of the texture yet, so its prediction is tested fairly.
    let predicted = texture.samples(surface.place).map(|sample| {
        let mut products = [0.0; 2];
        for c in 0..3 {
            let correction = sample.color[c] - sample.share * (drawn[c] - surface.shift[c]);
            products[0] += correction * (color[c] - drawn[c]);
            products[1] += correction * correction;
        }
        products.map(|product| (surface.weight * product * PRODUCT_ONE).round() as i32)
    });
    let limited = |c: f32| (c.clamp(-MAX_COLOR, MAX_COLOR) * COLOR_ONE).round() as i16;
    Some(Observed {
        texel: (y as usize * side + x as usize) as u16,
        weight: (surface.weight.min(1.0) * WEIGHT_ONE).round() as u16,
        color: [0, 1, 2].map(|c| limited(color[c] - surface.shift[c])),
        predicted,
    })
}
