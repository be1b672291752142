//! Settings of the scene preset.

use super::photometric::rule::PhotometricRule;
use crate::math::measured_pixel::MeasuredPixel;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::splat_rule::{DensityOpacity, SplatRule};
use crate::model::splat::splats::MAX_LENGTH;
use crate::observation::surface::SurfacePoint;
use crate::train::outcome::{MemoryEstimate, PIXEL_BYTES};
use crate::train::setting::{ConfigError, MAX_COMPONENTS};
use serde::{Deserialize, Serialize};

/// Memory of a component, in bytes, for budgets in megabytes and memory estimates. It covers the sums
/// and visibility counts (176) and the seed with its part of the seed grid. The reported model size is
/// measured and may differ, especially if merged components retain their seeds.
pub const COMPONENT_BYTES: usize = 200;

/// Default budget: maximum number of components of a scene, 400 MB at [`COMPONENT_BYTES`] each.
pub const DEFAULT_MAX_COMPONENTS: usize = 2_000_000;

/// Default memory for textures, in megabytes.
pub const DEFAULT_TEXTURE_MB: u32 = 200;
/// Maximum memory for textures, in megabytes.
pub const MAX_TEXTURE_MB: u32 = 100_000;

/// Settings of the scene engine.
///
/// ```
/// use vbgs_studio::train::scene::config::SceneConfig;
///
/// assert!(SceneConfig::fine(0.02).check().is_ok());
/// let error = SceneConfig::fine(f64::NAN).check().err();
/// assert_eq!(error.map(|e| e.setting), Some("scale (`--scale`)"));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneConfig {
    /// Structural scale `h`, world units: maximum distance of a point from its component's seed, the
    /// point at which that component was created.
    pub h: f64,
    /// Maximum distance along a point's ray at which a seed is searched for, in half-widths of the
    /// depth noise; 0 disables the search.
    // Skipped if off, so that files of scenes without it are unchanged.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ray_search: f64,
    /// True if measured points are moved along their rays towards the plane of their component.
    pub refine: bool,
    /// True if each frame's pose is aligned to the scene.
    #[serde(default)]
    pub align: bool,
    /// True if each frame's exposure is fitted to the scene's.
    pub gain: bool,
    /// Maximum number of components in use at any time.
    #[serde(rename = "most")]
    pub max_components: usize,
    /// Rule that converts the sums of a component to its splat.
    #[serde(rename = "native")]
    pub splat_rule: SplatRule,
    /// Parameters of photometric training; `None` if it is off.
    // Skipped if off, so that files of scenes without it are unchanged.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photometric: Option<PhotometricRule>,
    /// Memory for textures, in megabytes; 0 if textures are off. They need photographs.
    #[serde(default, skip_serializing_if = "is_none")]
    pub texture_mb: u32,
    /// Number of doublings of the pitch of textures at the beginning. Only benchmarks change it.
    #[serde(default, skip_serializing_if = "is_none")]
    pub texture_steps: u32,
    /// True if photographs have the poses of their points. Only benchmarks change it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub photographs_at_points: bool,
    /// True if camera poses are found by tracking against the scene. Recorded poses are then ignored.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub track: bool,
}

/// Value of [`SceneConfig::ray_search`] for real cameras, half-widths of the depth noise (`scene.md`,
/// Ray search).
pub const RAY_SEARCH: f64 = 4.0;

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

fn is_none(value: &u32) -> bool {
    *value == 0
}

impl SceneConfig {
    /// Returns settings for 8-bit depth, with structural scale `h` in world units (`scene.md`, Settings
    /// by sensor).
    pub fn fine(h: f64) -> Self {
        Self {
            h,
            ray_search: 0.0,
            refine: true,
            align: false,
            gain: false,
            max_components: DEFAULT_MAX_COMPONENTS,
            splat_rule: SplatRule {
                // These opacities require flat tops: with plain Gaussians surfaces become transparent and 2
                // dB are lost (`model.md`, Density opacity).
                opacity: DensityOpacity { tau: 3.2, rho0: 0.7, doubt: 20.0, least: 0.3 },
                least_points: 5.0,
                // 1.2 before crack filling existed: wider splats blur the picture.
                scale: 1.12,
                full_coverage: 0.9,
                flat_top: true,
                least_scale: 0.05,
                prior_scale: 0.3,
                prior_points: 2.0,
                gradient: true,
                gradient_ridge: 0.005,
                directional: true,
                directional_ridge: [0.01, 0.2],
            },
            photometric: None,
            texture_mb: 0,
            texture_steps: 0,
            photographs_at_points: false,
            track: false,
        }
    }

    /// Returns settings for computed depth, with structural scale `h` in world units. Such depth covers
    /// every visible surface. High opacities are therefore safe and keep surfaces closed in near views.
    pub fn exact(h: f64) -> Self {
        let mut exact = Self::fine(h);
        exact.splat_rule.opacity.tau = 4.5;
        exact
    }

    /// Returns settings for real depth cameras, with structural scale `h` in world units. The settings
    /// correct or tolerate errors of pose, depth and exposure (`scene.md`, Settings by sensor).
    pub fn coarse(h: f64) -> Self {
        let fine = Self::fine(h);
        let splat_rule = SplatRule {
            opacity: DensityOpacity { tau: 6.0, rho0: 3.0, ..fine.splat_rule.opacity },
            // 1.6 before crack filling existed; filling from half coverage closes what wider splats closed.
            scale: 1.35,
            full_coverage: 0.5,
            least_scale: 0.15,
            gradient_ridge: 0.016,
            ..fine.splat_rule
        };
        Self { ray_search: RAY_SEARCH, align: true, gain: true, splat_rule, ..fine }
    }

    /// Returns the photometric rule for the configured kind of splats; `None` if photometric training is
    /// off.
    pub fn photometric_rule(&self) -> Option<PhotometricRule> {
        // A plain splat has no gradient that could be trained.
        self.photometric.map(|rule| rule.of_splats(&self.splat_rule))
    }

    /// Returns the memory for textures, in bytes.
    pub fn texture_bytes(&self) -> usize {
        self.texture_mb as usize * 1_000_000
    }

    /// Returns the maximum number of seeds. It exceeds the number of components, since merged components
    /// retain their seeds.
    pub fn most_seeds(&self) -> usize {
        self.max_components.saturating_mul(8)
    }

    /// Returns the settings unchanged, or an error for the first setting out of range.
    pub fn check(self) -> Result<Self, ConfigError> {
        let refuse = |setting, expected: String, found: String| {
            Err(ConfigError { setting, expected, found })
        };
        let (budget, h, coverage) = (self.max_components, self.h, self.splat_rule.full_coverage);
        if !(1..=MAX_COMPONENTS).contains(&budget) {
            let expected = format!("1 to {MAX_COMPONENTS} components");
            return refuse("budget (`--budget`)", expected, budget.to_string());
        }
        if !(h > 0.0 && h <= f64::from(MAX_LENGTH)) {
            let expected = format!("a length above 0, at most {MAX_LENGTH:e}");
            return refuse("scale (`--scale`)", expected, h.to_string());
        }
        if !(coverage > 0.0 && coverage <= 1.0) {
            let expected = "a coverage above 0, at most 1".to_owned();
            return refuse("closing", expected, coverage.to_string());
        }
        Ok(self)
    }
}

/// Additional bytes per component while a checkpoint is written: copies of sums and seed, an index, and
/// spare capacity. Measured on Lego with 96,000 to 616,000 components: the peak grows by 429 bytes per
/// component, of which the model takes 199. Splats for export are created after the copy is dropped and
/// take less memory.
const SCENE_COPY_BYTES: usize = 230;
/// Additional bytes per component for photometric training: rendering record, sums over pixels, and
/// step. Copies of the photometric state are not included.
const PHOTOGRAPH_SPLAT_BYTES: usize = 480;
/// Bytes per pixel of a photograph in memory: colours and depths.
const PHOTOGRAPH_PIXEL_BYTES: usize = size_of::<[u8; 4]>() + size_of::<f32>();
/// Bytes for lists and sums while a rendered picture is compared with a photograph, independent of its
/// size.
const PHOTOGRAPH_BYTES: u64 = 58_000_000;
/// Memory of textures in multiples of their budget. While a checkpoint is written, training changes copies of
/// its textures. Lists of patches have spare capacity, and pictures hold two generations of drawn texels, of a
/// quarter of the size each.
pub const TEXTURE_COPIES: u64 = 3;
/// Bytes for the program, its threads and decoders, without per-pixel buffers.
const SCENE_PROGRAM_BYTES: u64 = 16_000_000;
const DECODER_PIXEL_BYTES: usize = 30;
/// Bytes per point for its component, its shift along the ray and its squared distance from the seed.
const SCENE_POINT_BYTES: usize = 16;

impl SceneConfig {
    /// Estimates the memory of a training run with the maximum number of components. Each frame has
    /// `pixels` pixels, and `frames_at_once` frames are in memory.
    pub fn memory(&self, pixels: usize, frames_at_once: usize) -> MemoryEstimate {
        // A checkpoint contains a copy of the photometric state, and so does the final picture if photographs
        // are buffered. Pixels of buffered photographs are shared by all copies.
        let waiting = self.photometric.map_or(0, |rule| rule.waiting_bytes(pixels));
        let [of_splat, of_pixel] = match self.photometric {
            Some(rule) => {
                let copies = if rule.shuffle_buffer > 0 { 3 } else { 2 };
                let of_splat = copies * PhotometricState::BYTES + PHOTOGRAPH_SPLAT_BYTES;
                // One photograph is compared at a time.
                let of_pixel = frames_at_once * PHOTOGRAPH_PIXEL_BYTES + size_of::<MeasuredPixel>();
                [of_splat, of_pixel]
            }
            None => [0; 2],
        };
        let of_photographs = self.photometric.map_or(0, |_| PHOTOGRAPH_BYTES) + waiting as u64;
        let fixed = of_photographs + SCENE_PROGRAM_BYTES;
        let per_component = COMPONENT_BYTES + SCENE_COPY_BYTES + of_splat;
        let of_textures =
            self.photometric.map_or(0, |_| TEXTURE_COPIES * self.texture_bytes() as u64);
        let point = size_of::<SurfacePoint>() + size_of::<f32>();
        let of_points = pixels
            * (frames_at_once * point
                + SCENE_POINT_BYTES
                + PIXEL_BYTES
                + DECODER_PIXEL_BYTES
                + of_pixel);
        MemoryEstimate {
            model: (self.max_components as u64).saturating_mul(per_component as u64),
            frames: fixed + of_points as u64,
            textures: of_textures,
        }
    }
}
