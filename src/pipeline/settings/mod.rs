//! Settings of a run: the user's values, and their result on a dataset.

pub mod method;
pub mod scene;

use crate::train::paper::config::{Candidates, PaperConfig, PaperOverrides};
use crate::train::setting::table::{Conflict, SettingLayer};
use crate::train::setting::{ConfigError, Preset};
use method::{Method, MethodRequest};
use scene::SceneOverrides;

/// Settings given by the user, for each preset. An option common to both presets is set in both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GivenSettings {
    /// Settings of the paper preset.
    pub paper: PaperOverrides,
    /// Settings of the scene preset.
    pub scene: SceneOverrides,
}

impl GivenSettings {
    /// Returns a request for a model of a preset with the given settings.
    ///
    /// # Errors
    /// [`ConfigError`] states a setting that is out of range or would have no effect.
    pub fn request(self, preset: Preset) -> Result<MethodRequest, ConfigError> {
        Ok(match preset {
            Preset::Paper => {
                let config = PaperConfig::paper().with(&self.paper)?;
                // The default number of candidates suits any number of components.
                if let Some(Candidates::Nearest(n)) = self.paper.candidates
                    && n > config.components
                {
                    let components = config.components;
                    let expected =
                        format!("at most the number of components, {components}, or dense");
                    let (setting, found) = ("candidates", n.to_string());
                    return Err(ConfigError { setting, expected, found });
                }
                config.into()
            }
            Preset::Scene => self.scene.into(),
        })
    }

    /// Returns the name and value of the first given setting that the preset lacks.
    pub fn foreign_to(&self, preset: Preset) -> Option<(&'static str, String)> {
        match preset {
            Preset::Paper => self.scene.first_unsupported_by::<PaperOverrides>(),
            Preset::Scene => self.paper.first_unsupported_by::<SceneOverrides>(),
        }
    }

    /// Returns the first given setting that the run lacks or that has another value in the run.
    pub fn conflict(&self, method: &Method) -> Option<Conflict> {
        let conflict = match method {
            Method::Paper(config) => self.paper.conflict(config),
            Method::Scene(run) => self.scene.conflict(run),
        };
        conflict.or_else(|| {
            let (setting, requested) = self.foreign_to(method.preset())?;
            Some(Conflict { setting, stored: None, requested })
        })
    }
}

impl From<PaperOverrides> for GivenSettings {
    fn from(paper: PaperOverrides) -> Self {
        Self { paper, ..Self::default() }
    }
}

impl From<SceneOverrides> for GivenSettings {
    fn from(scene: SceneOverrides) -> Self {
        Self { scene, ..Self::default() }
    }
}

/// Returns the text of a RON file for a preset: every setting with its help and its default.
///
/// ```
/// use vbgs_studio::pipeline::settings::{preset_file, scene::SceneOverrides};
/// use vbgs_studio::train::setting::Preset;
///
/// let options =
///     ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
/// let preset: SceneOverrides = options.from_str(preset_file(Preset::Scene))?;
/// assert_eq!(preset.directional, Some(true));
/// # Ok::<(), ron::error::SpannedError>(())
/// ```
pub fn preset_file(preset: Preset) -> &'static str {
    match preset {
        Preset::Paper => include_str!("../../../assets/presets/paper.ron"),
        Preset::Scene => include_str!("../../../assets/presets/scene.ron"),
    }
}
