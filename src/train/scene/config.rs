//! Settings of the scene preset.

use super::photometric::rule::PhotometricRule;
use super::spacing::NearSpacing;
use super::sum_form::SumForm;
use crate::model::scene::opacity::DensityOpacity;
use crate::model::scene::splat_rule::SplatRule;
use crate::train::setting::{ConfigError, MAX_COMPONENTS};
use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Bytes that a component takes of the model at most: its sums and counts of visibility (176), its
/// seed and the next of the same bucket (16), and up to two buckets (4 each). Budgets in megabytes are
/// counted by it, and so is the memory that a run is expected to take. What a run reports as the
/// model's bytes is measured: a little less, and more where merged components keep their seeds.
pub const COMPONENT_BYTES: usize = 200;

/// Most components where a user sets no budget: [`COMPONENT_BYTES`] times as many are 400 MB.
pub const DEFAULT_MAX_COMPONENTS: usize = 2_000_000;

/// Where components are born.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum BirthRule {
    /// At the first point that has no seed within the structural scale.
    Seeds,
    /// At the centre of the cell of a fixed cubic lattice that a point falls into.
    Lattice,
    /// The same with the body-centred cubic lattice.
    BodyCentred,
}

impl BirthRule {
    /// Whether the model depends on nothing but which frames were seen.
    pub fn is_order_invariant(self) -> bool {
        self != Self::Seeds
    }
}

/// How the returns that a component could have given are counted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum VisibilityRule {
    /// By projecting every component into every frame: what is seen or seen through counts.
    Projected,
    /// By the frames in which it received points. Depends on the frame alone.
    Returned,
}

/// Every setting of the engine that shapes a scene.
///
/// ```
/// use vbgs_studio::train::scene::config::SceneConfig;
///
/// assert!(SceneConfig::fine(0.02).check().is_ok());
/// let error = SceneConfig::fine(f64::NAN).check().err();
/// assert_eq!(error.map(|e| e.setting), Some("scale"));
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SceneConfig {
    /// Where components are born.
    pub births: BirthRule,
    /// Structural scale `h`: largest distance of a point from its seed (side of a lattice's cell),
    /// world units.
    pub h: f64,
    /// Seeds closer together where views come near; `None` where the structural scale is the same everywhere.
    // Left out where it is off, so that files of scenes without it are what they were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub near: Option<NearSpacing>,
    /// Half-widths of its depth's noise within which a point without a seed looks for one along its ray; 0 where
    /// none does.
    // Left out where it is off, so that files of scenes without it are what they were.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub ray_search: f64,
    /// Whether points are moved along their rays towards their component's plane.
    pub refine: bool,
    /// Whether each frame's pose is corrected to fit the scene.
    #[serde(default)]
    pub align: bool,
    /// Whether each frame's exposure is fitted to the scene's.
    pub gain: bool,
    /// How hits and misses are counted.
    #[serde(rename = "looks")]
    pub visibility: VisibilityRule,
    /// How sums are kept.
    pub sums: SumForm,
    /// Most components in use, at any moment; of a lattice, which keeps up to eight times as many, most
    /// that are drawn.
    #[serde(rename = "most")]
    pub max_components: usize,
    /// How sums become splats.
    #[serde(rename = "native")]
    pub splat_rule: SplatRule,
    /// How splats learn from photographs; `None` if they do not.
    // Left out where it is off, so that files of scenes without it are what they were.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photometric: Option<PhotometricRule>,
    /// Whether frames are placed by the scene itself, whatever their recorded poses.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub track: bool,
}

/// How far noise takes points of real cameras, half-widths (`scene.md`, Ray search).
pub const RAY_SEARCH: f64 = 4.0;

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl SceneConfig {
    /// For exact or 8-bit depth, with structural scale `h` (`scene.md`, Settings by sensor).
    pub fn fine(h: f64) -> Self {
        Self {
            births: BirthRule::Seeds,
            h,
            near: None,
            ray_search: 0.0,
            refine: true,
            align: false,
            gain: false,
            visibility: VisibilityRule::Projected,
            sums: SumForm::Mixed,
            max_components: DEFAULT_MAX_COMPONENTS,
            splat_rule: SplatRule {
                // With plain Gaussians such opacities turn surfaces transparent, at a cost of 2 dB:
                // they belong to flat tops (`model.md`, Density opacity).
                opacity: DensityOpacity { tau: 3.2, rho0: 0.7, doubt: 20.0, least: 0.3 },
                least_points: 5.0,
                // 1.2 before cracks were filled in finished pixels: width blurs what splats show.
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
            track: false,
        }
    }

    /// For computed depth: its surfaces return all that they can, so nothing speaks against opacities
    /// that keep them closed where a view comes near.
    pub fn exact(h: f64) -> Self {
        let mut exact = Self::fine(h);
        exact.splat_rule.opacity.tau = 4.5;
        exact
    }

    /// For real depth cameras, whose poses, depth and exposure err more than the structural scale
    /// resolves (`scene.md`, Settings by sensor).
    pub fn coarse(h: f64) -> Self {
        let fine = Self::fine(h);
        let splat_rule = SplatRule {
            opacity: DensityOpacity { tau: 6.0, rho0: 3.0, ..fine.splat_rule.opacity },
            // 1.6 before cracks were filled; half the coverage closes what wider splats closed.
            scale: 1.35,
            full_coverage: 0.5,
            least_scale: 0.15,
            gradient_ridge: 0.016,
            ..fine.splat_rule
        };
        Self {
            near: Some(NearSpacing::ROOM),
            ray_search: RAY_SEARCH,
            align: true,
            gain: true,
            splat_rule,
            ..fine
        }
    }

    /// Whether frames are looked at a second time, and moved with what they taught (`scene.md`, A second look):
    /// where recorded poses are corrected, and exposures: without these, frames drift after their brightness.
    pub fn looks_twice(&self) -> bool {
        self.align && !self.track && self.gain
    }

    /// How splats learn from photographs, given what they are.
    pub fn photometric_rule(&self) -> Option<PhotometricRule> {
        self.photometric.map(|rule| rule.of_splats(&self.splat_rule))
    }

    /// Seeds at most: merged components keep theirs, and a lattice is merged only when it is drawn.
    pub fn most_seeds(&self) -> usize {
        self.max_components.saturating_mul(8)
    }

    /// These settings, or the first that is out of range.
    pub fn check(self) -> Result<Self, ConfigError> {
        if !(1..=MAX_COMPONENTS).contains(&self.max_components) {
            return Err(ConfigError {
                setting: "budget",
                expected: format!("1 to {MAX_COMPONENTS} components"),
                found: self.max_components.to_string(),
            });
        }
        if !(self.h.is_finite() && self.h > 0.0) {
            return Err(ConfigError {
                setting: "scale",
                expected: "a positive length".to_owned(),
                found: self.h.to_string(),
            });
        }
        let of_seeds = [
            ("near_detail", self.near.is_some(), "alike"),
            ("ray_search", self.ray_search != 0.0, "where they are"),
        ];
        let asked = of_seeds.into_iter().find(|(_, is_on, _)| *is_on);
        if let Some((setting, _, how)) = asked.filter(|_| self.births.is_order_invariant()) {
            return Err(ConfigError {
                setting,
                expected: format!("off with --births {}, whose cells are {how}", self.births),
                found: "on".to_owned(),
            });
        }
        let coverage = self.splat_rule.full_coverage;
        if !(coverage > 0.0 && coverage <= 1.0) {
            return Err(ConfigError {
                setting: "closing",
                expected: "a coverage above 0, at most 1".to_owned(),
                found: coverage.to_string(),
            });
        }
        Ok(self)
    }
}
