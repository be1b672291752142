//! Every setting that shapes a training run, checked before any work.

use crate::model::posterior::Conversion;
use crate::model::prior::Hyper;
use crate::model::splats::CovarianceForm;
use serde::{Deserialize, Serialize};

/// A named set of defaults.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// The algorithm as published.
    Paper,
}

/// Which components a point is compared with; a number or `dense` in files and on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "CandidatesText", try_from = "CandidatesText")]
pub enum Candidates {
    /// All of them.
    Dense,
    /// The C components whose initial spatial means are nearest.
    Nearest(usize),
}

#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum CandidatesText {
    Number(usize),
    Word(String),
}

impl From<Candidates> for CandidatesText {
    fn from(candidates: Candidates) -> Self {
        match candidates {
            Candidates::Dense => Self::Word("dense".to_owned()),
            Candidates::Nearest(n) => Self::Number(n),
        }
    }
}

impl TryFrom<CandidatesText> for Candidates {
    type Error = String;

    fn try_from(text: CandidatesText) -> Result<Self, String> {
        match text {
            CandidatesText::Number(n) => Ok(Self::Nearest(n)),
            CandidatesText::Word(word) => word.parse(),
        }
    }
}

impl std::str::FromStr for Candidates {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text {
            "dense" => Ok(Self::Dense),
            _ => text
                .parse()
                .map(Self::Nearest)
                .map_err(|_| format!("expected a number or `dense`, found `{text}`")),
        }
    }
}

/// Where the initial means come from (`model.md` 11).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Init {
    /// Uniform in the normalised cube, independent of the data.
    Random,
    /// Points of the first frame.
    Data,
}

/// When and by which scores unused components move (`model.md` 10).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ReassignPolicy {
    /// Never.
    Off,
    /// Before the fit, from a dense pass over every point.
    Dense,
    /// Before the fit, from a truncated pass, among the lowest scores: the paper's default.
    Truncated,
    /// After the fit, from the scores of the fit itself; takes effect with the next frame.
    Forwarded,
}

/// Arithmetic of the hot loops.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Precision {
    /// f64 throughout: the oracle.
    F64,
    /// f32 in hot loops about a local centre, fixed-point sums.
    Mixed,
}

/// A checked configuration. Built by [`TrainConfig::paper`] and [`TrainConfig::with`] only.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TrainConfig {
    /// Origin of the defaults.
    pub preset: Preset,
    /// Seed of every random stream.
    pub seed: u64,
    /// Number of components, the paper's N.
    pub components: usize,
    /// Candidate components per point.
    pub candidates: Candidates,
    /// Initial means.
    pub init: Init,
    /// Reassignment policy.
    pub reassign: ReassignPolicy,
    /// Share of the unused components that may move per frame.
    pub reassign_fraction: f64,
    /// Least number of badly explained points the sampler chooses among.
    pub low_elbo_floor: usize,
    /// Arithmetic of the hot loops.
    pub precision: Precision,
    /// How the posterior becomes splats.
    pub conversion: Conversion,
}

/// Settings a user may override, from a RON file or the command line; `None` keeps the preset's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Overrides {
    /// See [`TrainConfig::seed`].
    pub seed: Option<u64>,
    /// See [`TrainConfig::components`].
    pub components: Option<usize>,
    /// See [`TrainConfig::candidates`].
    pub candidates: Option<Candidates>,
    /// See [`TrainConfig::init`].
    pub init: Option<Init>,
    /// See [`TrainConfig::reassign`].
    pub reassign: Option<ReassignPolicy>,
    /// See [`TrainConfig::reassign_fraction`].
    pub reassign_fraction: Option<f64>,
    /// See [`TrainConfig::precision`].
    pub precision: Option<Precision>,
    /// Decomposition of the covariance; `legacy-cholesky` switches to the reference's exporter.
    pub covariance_form: Option<CovarianceForm>,
    /// Factor on the splats' standard deviations.
    pub scale_factor: Option<f64>,
}

impl Overrides {
    /// These settings where present, `fallback`'s elsewhere.
    pub fn or(self, fallback: Self) -> Self {
        Self {
            seed: self.seed.or(fallback.seed),
            components: self.components.or(fallback.components),
            candidates: self.candidates.or(fallback.candidates),
            init: self.init.or(fallback.init),
            reassign: self.reassign.or(fallback.reassign),
            reassign_fraction: self.reassign_fraction.or(fallback.reassign_fraction),
            precision: self.precision.or(fallback.precision),
            covariance_form: self.covariance_form.or(fallback.covariance_form),
            scale_factor: self.scale_factor.or(fallback.scale_factor),
        }
    }
}

/// A setting outside its range.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{setting}: expected {expected}, found {found}")]
pub struct ConfigError {
    /// Name of the setting, as the command line spells it.
    pub setting: &'static str,
    /// The allowed range.
    pub expected: String,
    /// The value given.
    pub found: String,
}

/// Most components a model may have: one id is an `i32` everywhere it is stored.
pub const MAX_COMPONENTS: usize = 20_000_000;
/// Most candidates per point; beyond this the dense E-step is meant.
pub const MAX_CANDIDATES: usize = 1024;

impl TrainConfig {
    /// The published algorithm: N = 100,000, C = 4, random start, reassignment before the fit.
    pub fn paper() -> Self {
        Self {
            preset: Preset::Paper,
            seed: 0,
            components: 100_000,
            candidates: Candidates::Nearest(4),
            init: Init::Random,
            reassign: ReassignPolicy::Truncated,
            reassign_fraction: 0.05,
            low_elbo_floor: 1024,
            precision: Precision::Mixed,
            conversion: Conversion::right(),
        }
    }

    /// This configuration with `overrides` applied, or the first setting that is out of range.
    pub fn with(mut self, overrides: &Overrides) -> Result<Self, ConfigError> {
        self.seed = overrides.seed.unwrap_or(self.seed);
        self.components = overrides.components.unwrap_or(self.components);
        self.candidates = overrides.candidates.unwrap_or(self.candidates);
        self.init = overrides.init.unwrap_or(self.init);
        self.reassign = overrides.reassign.unwrap_or(self.reassign);
        self.reassign_fraction = overrides.reassign_fraction.unwrap_or(self.reassign_fraction);
        self.precision = overrides.precision.unwrap_or(self.precision);
        if overrides.covariance_form == Some(CovarianceForm::LegacyCholesky) {
            self.conversion = Conversion::legacy();
        }
        self.conversion.scale_factor =
            overrides.scale_factor.unwrap_or(self.conversion.scale_factor);
        self.check()
    }

    fn check(self) -> Result<Self, ConfigError> {
        let refuse = |setting, expected: String, found: String| {
            Err(ConfigError { setting, expected, found })
        };
        if !(1..=MAX_COMPONENTS).contains(&self.components) {
            return refuse(
                "--components",
                format!("1 to {MAX_COMPONENTS}"),
                self.components.to_string(),
            );
        }
        if let Candidates::Nearest(c) = self.candidates
            && !(1..=MAX_CANDIDATES).contains(&c)
        {
            return refuse(
                "--candidates",
                format!("1 to {MAX_CANDIDATES}, or dense"),
                c.to_string(),
            );
        }
        if !(0.0..=1.0).contains(&self.reassign_fraction) {
            return refuse(
                "--reassign-fraction",
                "0 to 1".into(),
                self.reassign_fraction.to_string(),
            );
        }
        if !(self.conversion.scale_factor > 0.0 && self.conversion.scale_factor <= 100.0) {
            let found = self.conversion.scale_factor.to_string();
            return refuse("--scale-factor", "more than 0, at most 100".into(), found);
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
            (Overrides { components: Some(0), ..Default::default() }, "--components"),
            (
                Overrides { candidates: Some(Candidates::Nearest(0)), ..Default::default() },
                "--candidates",
            ),
            (
                Overrides { reassign_fraction: Some(1.5), ..Default::default() },
                "--reassign-fraction",
            ),
            (
                Overrides { reassign_fraction: Some(f64::NAN), ..Default::default() },
                "--reassign-fraction",
            ),
            (Overrides { scale_factor: Some(0.0), ..Default::default() }, "--scale-factor"),
        ];
        for (overrides, setting) in cases {
            assert_eq!(TrainConfig::paper().with(&overrides).unwrap_err().setting, setting);
        }
    }

    #[test]
    fn overrides_layer() {
        let file = Overrides { seed: Some(1), components: Some(50), ..Default::default() };
        let line = Overrides { seed: Some(2), ..Default::default() };
        let config = TrainConfig::paper().with(&line.or(file)).unwrap();
        assert_eq!((config.seed, config.components), (2, 50));
    }
}
