//! Reference renderers for the tests of the fast ones: f64, without tiles or SIMD, every splat in every
//! pixel, by the defining formulas (`rendering.md`, Projected renderer, and the sections after it). They
//! share no arithmetic with the fast renderers: the exact one evaluates the whitened ray, not the rational
//! conic.

mod exact;
mod projected;
mod shade;
mod splat;

pub use splat::{AppearanceF64, SplatF64};

use exact::Exact;
use glam::{DVec2, DVec3};
use projected::Projected;
use rayon::prelude::*;
use shade::Surface;
use splat::Placed;
use std::collections::HashMap;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::image::Image;
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::finish::Finish;
use vbgs_studio::render::{ALPHA_CUT, Lens, RenderMethod, RenderOptions, TRANSMITTANCE_STOP};

/// Result of one pixel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sample {
    /// Colour over the background, clamped to `[0, 1]`, and coverage.
    pub rgba: [f64; 4],
    /// Mean depth in world units with the blending weights, 0 where coverage is 0. Projected: view depth `z`
    /// of the centres. Exact: distance along the ray to the points of maximum response; it is negative behind
    /// the camera, which only [`vbgs_studio::render::Response::Line`] includes.
    pub depth: f64,
    /// Number of blended splats.
    pub n_blended: usize,
}

/// Splats prepared for one view, to be sampled at any pixel.
#[derive(Clone, Debug)]
pub struct Oracle {
    intrinsics: Intrinsics,
    background: DVec3,
    finish: Finish,
    alpha_cut: f64,
    transmittance_stop: f64,
    splats: Sorted,
    /// Textured surfaces by splat.
    surfaces: HashMap<usize, Surface>,
    look_up: LookUp,
}

/// Choices in reading textures that rounding may turn, within a band of the thresholds.
#[derive(Clone, Copy, Debug, Default)]
struct LookUp {
    /// True if the splat with the third largest weight replaces the second one of almost equal weight.
    takes_third: bool,
    /// Distance by which lattices end outside of their border, texels. Also the relative change of the least
    /// cosine between ray and normal.
    beyond: f64,
}

/// Splats of a view, sorted nearest first.
#[derive(Clone, Debug)]
enum Sorted {
    Projected(Vec<Projected>),
    Exact(Lens, Vec<Exact>),
}

/// Contribution of a splat at one point of the image.
struct Contribution {
    /// Number of the splat in the scene.
    number: usize,
    /// Alpha before the cut.
    alpha: f64,
    depth: f64,
    color: DVec3,
}

impl Oracle {
    /// Prepares and sorts the splats; leaves out invalid and hidden ones.
    pub fn new(splats: &[SplatF64], camera: &Camera, options: &RenderOptions) -> Self {
        let splats = splats.iter().enumerate();
        let placed = splats.filter_map(|splat| Placed::new(splat, camera, options));
        let k = &camera.intrinsics;
        Self {
            intrinsics: *k,
            background: DVec3::from_array(options.background.map(f64::from)),
            finish: Finish::NONE,
            alpha_cut: ALPHA_CUT,
            transmittance_stop: TRANSMITTANCE_STOP,
            surfaces: HashMap::new(),
            look_up: LookUp::default(),
            splats: match options.method {
                RenderMethod::Projected => {
                    let splats = placed.filter_map(|splat| Projected::new(&splat, k));
                    Sorted::Projected(nearest_first(splats, |splat| splat.depth))
                }
                RenderMethod::Exact(settings) => {
                    let splats = placed.map(|splat| Exact::new(&splat, k, settings));
                    Sorted::Exact(settings.lens, nearest_first(splats, |splat| splat.distance))
                }
            },
        }
    }

    /// Creates the oracle from the input of the fast renderers.
    pub fn of<'a>(
        view: impl Into<SplatView<'a>>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Self {
        let view: SplatView<'a> = view.into();
        let appearance = |i| view.appearance().get(i).map(AppearanceF64::from);
        let wide = view.splats().iter().enumerate();
        let wide: Vec<SplatF64> =
            wide.map(|(i, splat)| SplatF64 { appearance: appearance(i), ..splat.into() }).collect();
        let finish = Finish::new(view.finishing(), camera, options);
        let textures = view.finishing().textures.iter().flat_map(|textures| textures.iter());
        let textured = textures.zip(&wide).enumerate();
        let surfaces = textured.filter_map(|(number, (texture, splat))| {
            Some((number, Surface::new(splat, texture.as_ref()?, camera, options)?))
        });
        Self { finish, surfaces: surfaces.collect(), ..Self::new(&wide, camera, options) }
    }

    /// Returns the view with other thresholds, to find the values that f32 rounding allows in a pixel on a
    /// threshold (`rendering.md`, Tolerances).
    pub fn with_thresholds(&self, alpha_cut: f64, transmittance_stop: f64) -> Self {
        Self { alpha_cut, transmittance_stop, ..self.clone() }
    }

    /// Returns the view with every choice in reading textures that rounding by `band` allows.
    pub fn texture_branches(&self, band: f64) -> Vec<Self> {
        if self.surfaces.is_empty() {
            return vec![self.clone()];
        }
        let choices =
            [false, true].into_iter().flat_map(|third| [0.0, -band, band].map(|b| (third, b)));
        choices
            .map(|(takes_third, beyond)| Self {
                look_up: LookUp { takes_third, beyond },
                ..self.clone()
            })
            .collect()
    }

    /// Samples one pixel, in O(splats).
    pub fn pixel(&self, column: usize, row: usize) -> Sample {
        self.at(DVec2::new(column as f64 + 0.5, row as f64 + 0.5))
    }

    /// Samples any point of the image plane, in continuous pixels, also outside the image.
    pub fn at(&self, point: DVec2) -> Sample {
        match &self.splats {
            Sorted::Projected(splats) => {
                let ray = exact::ray(Lens::Pinhole, &self.intrinsics, point);
                self.blend(splats.iter().filter_map(|splat| splat.at(point)), ray)
            }
            Sorted::Exact(lens, splats) => {
                let ray = exact::ray(*lens, &self.intrinsics, point);
                let along = ray.iter().flat_map(|ray| splats.iter().map(|splat| splat.along(*ray)));
                self.blend(along, ray)
            }
        }
    }

    /// Samples the whole image.
    pub fn render(&self) -> Image<Sample> {
        let (width, height) = (self.intrinsics.width as usize, self.intrinsics.height as usize);
        let pixels = (0..width * height).into_par_iter();
        let data = pixels.map(|i| self.pixel(i % width, i / width)).collect();
        Image::from_vec(width, height, data)
    }

    /// Blends front to back (`rendering.md`, Blending). `ray` is in camera axes.
    fn blend(
        &self,
        contributions: impl Iterator<Item = Contribution>,
        ray: Option<DVec3>,
    ) -> Sample {
        let mut weights = Vec::new();
        let mut transmittance = 1.0;
        let (mut color, mut depth, mut n_blended) = (DVec3::ZERO, 0.0, 0);
        for splat in contributions.filter(|splat| splat.alpha >= self.alpha_cut) {
            let next = transmittance * (1.0 - splat.alpha);
            if next < self.transmittance_stop {
                break;
            }
            weights.push((splat.alpha * transmittance, splat.number));
            color += splat.color * (splat.alpha * transmittance);
            depth += splat.depth * (splat.alpha * transmittance);
            transmittance = next;
            n_blended += 1;
        }
        let open = 1.0 - transmittance;
        if let Some(ray) = ray.filter(|_| open > 0.0 && !self.surfaces.is_empty()) {
            color = self.textured(color, open, weights, ray);
        }
        let coverage = (open / f64::from(self.finish.full_coverage)).min(1.0);
        let closed = if open > 0.0 { color * (coverage / open) } else { color };
        let exposure = DVec3::from_array(self.finish.exposure.map(f64::from));
        let over = closed * exposure + self.background * (1.0 - coverage);
        let [r, g, b] = over.clamp(DVec3::ZERO, DVec3::ONE).to_array();
        Sample {
            rgba: [r, g, b, coverage],
            depth: if open > 0.0 { depth / open } else { 0.0 },
            n_blended,
        }
    }
}

impl Oracle {
    /// Adds the textures of the two splats with the largest weights to a premultiplied colour.
    fn textured(
        &self,
        color: DVec3,
        coverage: f64,
        mut weights: Vec<(f64, usize)>,
        ray: DVec3,
    ) -> DVec3 {
        weights.sort_by(|a, b| b.0.total_cmp(&a.0));
        let is_tie = weights.len() > 2 && weights[2].0 > weights[1].0 * (1.0 - TIE);
        if is_tie && self.look_up.takes_third {
            weights.swap(1, 2);
        }
        let owners = weights.iter().take(2).filter_map(|(w, id)| Some((w, self.surfaces.get(id)?)));
        let changes = owners.map(|(weight, surface)| {
            *weight * surface.correction(ray, color / coverage, self.look_up.beyond)
        });
        (color + changes.sum::<DVec3>()).max(DVec3::ZERO)
    }
}

/// Relative difference of weights that f32 may turn around.
const TIE: f64 = 1e-4;

/// Sorts by ascending key; equal keys keep their order.
fn nearest_first<T>(splats: impl Iterator<Item = T>, key: impl Fn(&T) -> f64) -> Vec<T> {
    let mut sorted: Vec<T> = splats.collect();
    sorted.sort_by(|a, b| key(a).total_cmp(&key(b)));
    sorted
}
