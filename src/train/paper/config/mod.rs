//! Settings of the `paper` preset, validated before training.

mod settings;

use crate::model::conjugate::posterior::Conversion;
use crate::model::conjugate::prior::Hyper;
use crate::model::splat::splats::CovarianceForm;
use crate::train::setting::table::{SettingLayer, settings};
use crate::train::setting::{ConfigError, MAX_COMPONENTS, Preset};
use serde::{Deserialize, Serialize};

pub use settings::{
    Candidates, Init, MAX_CANDIDATES, Operations, Precision, ReassignPolicy, UpdateWidth, Width,
};

/// A validated configuration of the `paper` preset. Created by [`PaperConfig::paper`] and
/// [`PaperConfig::with`] or read from a file; missing settings of older files get the paper's values.
///
/// ```
/// use vbgs_studio::train::paper::config::{PaperOverrides, PaperConfig};
///
/// let few = PaperOverrides { components: Some(5000), ..PaperOverrides::default() };
/// assert_eq!(PaperConfig::paper().with(&few)?.components, 5000);
/// let none = PaperOverrides { components: Some(0), ..PaperOverrides::default() };
/// let error = PaperConfig::paper().with(&none).err().ok_or("accepted")?;
/// assert_eq!(error.setting, "components");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(remote = "Self", default = "PaperConfig::paper")]
pub struct PaperConfig {
    /// Seed of all random number streams.
    pub seed: u64,
    /// Number of components, the paper's N.
    pub components: usize,
    /// Number of candidate components per point.
    pub candidates: Candidates,
    /// Source of the initial means.
    pub init: Init,
    /// Reassignment policy.
    pub reassign: ReassignPolicy,
    /// Share of the unused components that may move per frame.
    pub reassign_fraction: f64,
    /// Minimum number of badly explained points to sample from.
    pub low_elbo_floor: usize,
    /// Named arithmetic of the inner loops.
    pub precision: Precision,
    /// Arithmetic of the inner loops, by operation.
    pub operations: Operations,
    /// Conversion of posteriors to splats.
    pub conversion: Conversion,
    /// True to use the reference implementation even where the fused kernels support the configuration.
    /// Only tests set it, to compare the two.
    #[serde(skip)]
    pub is_plain: bool,
}

settings! {
    /// User-settable options of the `paper` preset, from a RON file or the command line; `None` selects the
    /// preset's value.
    pub struct PaperOverrides of PaperConfig, Preset::Paper,
        such as "(components: 50000, candidates: 4)";

    /// Seed of all random streams.
    seed: u64 {
        default "0";
        at |run| run.seed;
    }
    /// Number of components.
    components: usize {
        label "Components";
        default "100000";
        range "1 to {MAX_COMPONENTS}", |n| (1..=MAX_COMPONENTS).contains(n);
        at |run| run.components;
    }
    /// Candidate components per point, or `dense`.
    candidates: Candidates {
        label "Candidates";
        default "4";
        range "1 to {MAX_CANDIDATES}, or dense", |candidates| candidates.is_legal();
        at |run| run.candidates;
    }
    /// Source of the initial means.
    init: Init {
        label "Initial means";
        default "random";
        at |run| run.init;
    }
    /// When unused components move to badly explained points: `forwarded` after the fit, `dense` and `padded`
    /// before it.
    reassign: ReassignPolicy {
        label "Reassignment";
        default "padded";
        at |run| run.reassign;
    }
    /// Share of the unused components that may move per frame.
    reassign_fraction: f64 {
        label "Share reassigned";
        default "0.05";
        range "0 to 1", |share| (0.0..=1.0).contains(share);
        at |run| run.reassign_fraction;
    }
    /// Arithmetic by operation, as written by `precision-search`; cannot be combined with a named precision.
    // Listed before `precision`, so that a named precision with the same operations keeps its name.
    operations: Operations {
        default by "those of the precision";
        below precision;
        get |run| Some(run.operations);
        set |run, operations| (run.precision, run.operations) = (Precision::Custom, operations);
    }
    /// Arithmetic of the inner loops.
    precision: Precision {
        label "Precision";
        default "mixed";
        get |run| Some(run.precision);
        set |run, precision| {
            run.precision = precision;
            run.operations = precision.operations().unwrap_or(run.operations);
        };
    }
    /// Conversion of covariances to splats.
    covariance_form: CovarianceForm {
        default "right";
        get |run| Some(run.conversion.form);
        set |run, form| {
            if form == CovarianceForm::LegacyCholesky {
                run.conversion = Conversion::legacy();
            }
        };
    }
    /// Factor on the splats' standard deviations.
    scale_factor: f64 {
        default by "1, or 1.41 with legacy-cov";
        range "more than 0, at most 100", |factor| *factor > 0.0 && *factor <= 100.0;
        at |run| run.conversion.scale_factor;
    }
}

/// Maximum value of the setting `low_elbo_floor`, whose published value is 1024.
const MAX_LOW_ELBO_FLOOR: usize = 1 << 16;

fn refuse<T>(setting: &'static str, expected: String, found: String) -> Result<T, ConfigError> {
    Err(ConfigError { setting, expected, found })
}

impl PaperOverrides {
    /// Returns an error if a named precision is combined with different operations.
    fn check_precision(&self) -> Result<(), ConfigError> {
        match (self.precision, self.operations) {
            (Some(Precision::Custom), None) => refuse(
                "precision",
                "f64 or mixed, or `operations` in a settings file (`--config`)".into(),
                "custom alone".into(),
            ),
            (Some(precision), Some(operations))
                if precision.operations().is_some_and(|its_own| its_own != operations) =>
            {
                refuse(
                    "operations",
                    format!("none with `precision: {precision:?}`, which sets all operations"),
                    "both".into(),
                )
            }
            _ => Ok(()),
        }
    }
}

impl PaperConfig {
    /// Returns the published configuration: N = 100,000, C = 4, random start, reassignment before the
    /// fit.
    pub fn paper() -> Self {
        Self {
            seed: 0,
            components: 100_000,
            candidates: Candidates::Nearest(4),
            init: Init::Random,
            reassign: ReassignPolicy::Padded,
            reassign_fraction: 0.05,
            low_elbo_floor: 1024,
            precision: Precision::Mixed,
            operations: Operations::MIXED,
            conversion: Conversion::right(),
            is_plain: false,
        }
    }

    /// Applies `overrides`; returns an error for the first setting out of range.
    pub fn with(mut self, overrides: &PaperOverrides) -> Result<Self, ConfigError> {
        // The order of application hides a conflict of the two afterwards.
        overrides.check_precision()?;
        overrides.apply(&mut self);
        self.check()
    }

    fn check(self) -> Result<Self, ConfigError> {
        PaperOverrides::check(&self)?;
        // Only a checkpoint can set this value, and buffers are sized by it.
        if !(1..=MAX_LOW_ELBO_FLOOR).contains(&self.low_elbo_floor) {
            return refuse(
                "low_elbo_floor",
                format!("1 to {MAX_LOW_ELBO_FLOOR}"),
                self.low_elbo_floor.to_string(),
            );
        }
        Ok(self)
    }

    /// Returns the hyperparameters implied by this configuration.
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
