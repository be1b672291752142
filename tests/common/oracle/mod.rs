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
use splat::Placed;
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
}

/// Splats of a view, sorted nearest first.
#[derive(Clone, Debug)]
enum Sorted {
    Projected(Vec<Projected>),
    Exact(Lens, Vec<Exact>),
}

/// Contribution of a splat at one point of the image.
struct Contribution {
    /// Alpha before the cut.
    alpha: f64,
    depth: f64,
    color: DVec3,
}

impl Oracle {
    /// Prepares and sorts the splats; leaves out invalid and hidden ones.
    pub fn new(splats: &[SplatF64], camera: &Camera, options: &RenderOptions) -> Self {
        let placed = splats.iter().filter_map(|splat| Placed::new(splat, camera, options));
        let k = &camera.intrinsics;
        Self {
            intrinsics: *k,
            background: DVec3::from_array(options.background.map(f64::from)),
            finish: Finish::NONE,
            alpha_cut: ALPHA_CUT,
            transmittance_stop: TRANSMITTANCE_STOP,
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
        Self { finish, ..Self::new(&wide, camera, options) }
    }

    /// Returns the view with other thresholds, to find the values that f32 rounding allows in a pixel on a
    /// threshold (`rendering.md`, Tolerances).
    pub fn with_thresholds(&self, alpha_cut: f64, transmittance_stop: f64) -> Self {
        Self { alpha_cut, transmittance_stop, ..self.clone() }
    }

    /// Samples one pixel, in O(splats).
    pub fn pixel(&self, column: usize, row: usize) -> Sample {
        self.at(DVec2::new(column as f64 + 0.5, row as f64 + 0.5))
    }

    /// Samples any point of the image plane, in continuous pixels, also outside the image.
    pub fn at(&self, point: DVec2) -> Sample {
        match &self.splats {
            Sorted::Projected(splats) => {
                self.blend(splats.iter().filter_map(|splat| splat.at(point)))
            }
            Sorted::Exact(lens, splats) => {
                let ray = exact::ray(*lens, &self.intrinsics, point);
                self.blend(ray.iter().flat_map(|ray| splats.iter().map(|splat| splat.along(*ray))))
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

    /// Blends front to back (`rendering.md`, Blending).
    fn blend(&self, contributions: impl Iterator<Item = Contribution>) -> Sample {
        let mut transmittance = 1.0;
        let (mut color, mut depth, mut n_blended) = (DVec3::ZERO, 0.0, 0);
        for splat in contributions.filter(|splat| splat.alpha >= self.alpha_cut) {
            let next = transmittance * (1.0 - splat.alpha);
            if next < self.transmittance_stop {
                break;
            }
            color += splat.color * (splat.alpha * transmittance);
            depth += splat.depth * (splat.alpha * transmittance);
            transmittance = next;
            n_blended += 1;
        }
        let open = 1.0 - transmittance;
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

/// Sorts by ascending key; equal keys keep their order.
fn nearest_first<T>(splats: impl Iterator<Item = T>, key: impl Fn(&T) -> f64) -> Vec<T> {
    let mut sorted: Vec<T> = splats.collect();
    sorted.sort_by(|a, b| key(a).total_cmp(&key(b)));
    sorted
}
