//! Every setting that shapes a training run, checked before any work.

mod precision;
mod settings;
mod stored;

pub use precision::{Operations, Precision, UpdateWidth, Width};
pub use settings::{Batch, Candidates, IndexKind, Init, Preset, ReassignPolicy, StatisticsForm};

use crate::model::conjugate::posterior::Conversion;
use crate::model::conjugate::prior::Hyper;
use crate::model::splat::splats::CovarianceForm;
use crate::train::setting::{ConfigError, MAX_COMPONENTS};
use serde::{Deserialize, Serialize};

/// A checked configuration. Built by [`PaperConfig::paper`] and [`PaperConfig::with`], or read from
/// a file; settings that an older file lacks are the paper's.
///
/// ```
/// use vbgs_studio::train::paper::config::{PaperOverrides, PaperConfig};
///
/// let few = PaperOverrides { components: Some(5000), ..PaperOverrides::default() };
/// assert_eq!(PaperConfig::paper().with(&few)?.components, 5000);
/// let none = PaperOverrides { components: Some(0), ..PaperOverrides::default() };
/// let error = PaperConfig::paper().with(&none).err().ok_or("accepted")?;
/// assert_eq!(error.setting, "--components");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self", default = "PaperConfig::paper")]
pub struct PaperConfig {
    /// Seed of every random stream.
    pub seed: u64,
    /// Number of components, the paper's N.
    pub components: usize,
    /// Candidate components per point.
    pub candidates: Candidates,
    /// Points that pass through the engine at once.
    pub batch: Batch,
    /// Whether responsibilities are materialised.
    pub statistics: StatisticsForm,
    /// How candidates are found.
    pub index: IndexKind,
    /// Initial means.
    pub init: Init,
    /// Reassignment policy.
    pub reassign: ReassignPolicy,
    /// Share of the unused components that may move per frame.
    pub reassign_fraction: f64,
    /// Least number of badly explained points the sampler chooses among.
    pub low_elbo_floor: usize,
    /// Arithmetic of the hot loops, by name.
    pub precision: Precision,
    /// Arithmetic of the hot loops, operation by operation.
    pub operations: Operations,
    /// How the posterior becomes splats.
    pub conversion: Conversion,
}

/// Settings a user may override, from a RON file or the command line; `None` keeps the preset's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename = "PaperOverrides", default, deny_unknown_fields)]
pub struct PaperOverrides {
    /// See [`PaperConfig::seed`].
    pub seed: Option<u64>,
    /// See [`PaperConfig::components`].
    pub components: Option<usize>,
    /// See [`PaperConfig::candidates`].
    pub candidates: Option<Candidates>,
    /// See [`PaperConfig::batch`].
    pub batch: Option<Batch>,
    /// See [`PaperConfig::statistics`].
    pub statistics: Option<StatisticsForm>,
    /// See [`PaperConfig::index`].
    pub index: Option<IndexKind>,
    /// See [`PaperConfig::init`].
    pub init: Option<Init>,
    /// See [`PaperConfig::reassign`].
    pub reassign: Option<ReassignPolicy>,
    /// See [`PaperConfig::reassign_fraction`].
    pub reassign_fraction: Option<f64>,
    /// See [`PaperConfig::precision`].
    pub precision: Option<Precision>,
    /// See [`PaperConfig::operations`]; makes the precision [`Precision::Custom`].
    pub operations: Option<Operations>,
    /// Decomposition of the covariance; `legacy-cholesky` switches to the reference's exporter.
    pub covariance_form: Option<CovarianceForm>,
    /// Factor on the splats' standard deviations.
    pub scale_factor: Option<f64>,
}

impl PaperOverrides {
    /// These settings where present, `fallback`'s elsewhere.
    pub fn or(self, fallback: Self) -> Self {
        Self {
            seed: self.seed.or(fallback.seed),
            components: self.components.or(fallback.components),
            candidates: self.candidates.or(fallback.candidates),
            batch: self.batch.or(fallback.batch),
            statistics: self.statistics.or(fallback.statistics),
            index: self.index.or(fallback.index),
            init: self.init.or(fallback.init),
            reassign: self.reassign.or(fallback.reassign),
            reassign_fraction: self.reassign_fraction.or(fallback.reassign_fraction),
            precision: self.precision.or(fallback.precision),
            // A precision by name wins over operations that lie deeper.
            operations: self
                .operations
                .or(fallback.operations.filter(|_| self.precision.is_none())),
            covariance_form: self.covariance_form.or(fallback.covariance_form),
            scale_factor: self.scale_factor.or(fallback.scale_factor),
        }
    }
}

fn refuse<T>(setting: &'static str, expected: String, found: String) -> Result<T, ConfigError> {
    Err(ConfigError { setting, expected, found })
}

/// Most candidates per point; beyond this the dense E-step is meant.
pub const MAX_CANDIDATES: usize = 1024;

impl PaperConfig {
    /// The published algorithm: N = 100,000, C = 4, random start, reassignment before the fit.
    pub fn paper() -> Self {
        Self {
            seed: 0,
            components: 100_000,
            candidates: Candidates::Nearest(4),
            batch: Batch::Frame,
            statistics: StatisticsForm::Fused,
            index: IndexKind::Grid,
            init: Init::Random,
            reassign: ReassignPolicy::Padded,
            reassign_fraction: 0.05,
            low_elbo_floor: 1024,
            precision: Precision::Mixed,
            operations: Operations::MIXED,
            conversion: Conversion::right(),
        }
    }

    /// This configuration with `overrides` applied, or the first setting that is out of range.
    pub fn with(mut self, overrides: &PaperOverrides) -> Result<Self, ConfigError> {
        self.seed = overrides.seed.unwrap_or(self.seed);
        self.components = overrides.components.unwrap_or(self.components);
        self.candidates = overrides.candidates.unwrap_or(self.candidates);
        self.init = overrides.init.unwrap_or(self.init);
        self.reassign = overrides.reassign.unwrap_or(self.reassign);
        self.reassign_fraction = overrides.reassign_fraction.unwrap_or(self.reassign_fraction);
        self.batch = overrides.batch.unwrap_or(self.batch);
        self.statistics = overrides.statistics.unwrap_or(self.statistics);
        self.index = overrides.index.unwrap_or(self.index);
        self.set_precision(overrides)?;
        if overrides.covariance_form == Some(CovarianceForm::LegacyCholesky) {
            self.conversion = Conversion::legacy();
        }
        self.conversion.scale_factor =
            overrides.scale_factor.unwrap_or(self.conversion.scale_factor);
        self.check()
    }

    fn set_precision(&mut self, overrides: &PaperOverrides) -> Result<(), ConfigError> {
        let named = |precision| match precision {
            Precision::F64 => Some(Operations::F64),
            Precision::Mixed => Some(Operations::MIXED),
            Precision::F32 => Some(Operations::F32),
            Precision::Custom => None,
        };
        (self.precision, self.operations) = match (overrides.precision, overrides.operations) {
            (None, None) => return Ok(()),
            (None | Some(Precision::Custom), Some(operations)) => (Precision::Custom, operations),
            (Some(precision), None) if let Some(operations) = named(precision) => {
                (precision, operations)
            }
            (Some(precision), Some(operations)) if named(precision) == Some(operations) => {
                (precision, operations)
            }
            (Some(Precision::Custom), None) => {
                return refuse(
                    "precision",
                    "f64, mixed or f32, or `operations` in a settings file".into(),
                    "custom alone".into(),
                );
            }
            (Some(precision), _) => {
                return refuse(
                    "operations",
                    format!("none beside `precision: {precision:?}`, which sets them all"),
                    "both".into(),
                );
            }
        };
        Ok(())
    }

    fn check(self) -> Result<Self, ConfigError> {
        if !(1..=MAX_COMPONENTS).contains(&self.components) {
            return refuse(
                "components",
                format!("1 to {MAX_COMPONENTS}"),
                self.components.to_string(),
            );
        }
        if let Candidates::Nearest(c) = self.candidates
            && !(1..=MAX_CANDIDATES).contains(&c)
        {
            return refuse("candidates", format!("1 to {MAX_CANDIDATES}, or dense"), c.to_string());
        }
        if self.batch == Batch::Points(0) {
            return refuse("batch", "1 point or more, or frame".into(), "0".into());
        }
        if self.index == IndexKind::KdTree && self.operations.distance == Width::F32 {
            return refuse(
                "index",
                "grid, or precision f64: the tree measures distances in f64".into(),
                "kd-tree with distances in f32".into(),
            );
        }
        if self.candidates == Candidates::Dense && self.index == IndexKind::KdTree {
            return refuse(
                "index",
                "grid with candidates dense, which searches nothing".into(),
                "kd-tree".into(),
            );
        }
        if !(0.0..=1.0).contains(&self.reassign_fraction) {
            return refuse(
                "reassign_fraction",
                "0 to 1".into(),
                self.reassign_fraction.to_string(),
            );
        }
        if !(self.conversion.scale_factor > 0.0 && self.conversion.scale_factor <= 100.0) {
            let found = self.conversion.scale_factor.to_string();
            return refuse("scale_factor", "more than 0, at most 100".into(), found);
        }
        Ok(self)
    }

    /// The hyper-parameters this configuration implies.
    pub fn hyper(&self) -> Hyper {
        Hyper::paper(self.components, self.components as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_range_settings_are_refused_by_name() {
        let cases = [
            (PaperOverrides { components: Some(0), ..Default::default() }, "components"),
            (
                PaperOverrides { candidates: Some(Candidates::Nearest(0)), ..Default::default() },
                "candidates",
            ),
            (
                PaperOverrides { reassign_fraction: Some(1.5), ..Default::default() },
                "reassign_fraction",
            ),
            (
                PaperOverrides { reassign_fraction: Some(f64::NAN), ..Default::default() },
                "reassign_fraction",
            ),
            (PaperOverrides { scale_factor: Some(0.0), ..Default::default() }, "scale_factor"),
        ];
        for (overrides, setting) in cases {
            assert_eq!(PaperConfig::paper().with(&overrides).unwrap_err().setting, setting);
        }
    }

    #[test]
    fn overrides_layer() {
        let file = PaperOverrides { seed: Some(1), components: Some(50), ..Default::default() };
        let line = PaperOverrides { seed: Some(2), ..Default::default() };
        let config = PaperConfig::paper().with(&line.or(file)).unwrap();
        assert_eq!((config.seed, config.components), (2, 50));
    }
}
