//! What is said of the settings of either preset, before it is known which one is meant.

use super::method::{Method, MethodRequest};
use super::scene::SceneOverrides;
use crate::train::paper::config::{PaperConfig, PaperOverrides};
use crate::train::setting::table::{Conflict, SettingLayer};
use crate::train::setting::{ConfigError, Preset};

/// Settings that a user gives, by preset; an option that both have is in both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GivenSettings {
    /// Of the paper preset.
    pub paper: PaperOverrides,
    /// Of the scene preset.
    pub scene: SceneOverrides,
}

impl GivenSettings {
    /// What is asked of a model of a preset.
    ///
    /// # Errors
    /// [`ConfigError`] names a setting that is out of its range.
    pub fn request(self, preset: Preset) -> Result<MethodRequest, ConfigError> {
        Ok(match preset {
            Preset::Paper => PaperConfig::paper().with(&self.paper)?.into(),
            Preset::Scene => self.scene.into(),
        })
    }

    /// The first setting given that a preset has no option for, and the one that has.
    pub fn foreign_to(&self, preset: Preset) -> Option<Foreign> {
        match preset {
            Preset::Paper => foreign::<_, PaperOverrides>(&self.scene),
            Preset::Scene => foreign::<_, SceneOverrides>(&self.paper),
        }
    }

    /// The first setting given that is not as a run has it.
    pub fn conflict(&self, method: &Method) -> Option<Conflict> {
        let conflict = match method {
            Method::Paper(config) => self.paper.conflict(config),
            Method::Scene(run) => self.scene.conflict(run),
        };
        conflict.or_else(|| {
            let Foreign { setting, value: asked, .. } = self.foreign_to(method.preset())?;
            Some(Conflict { setting, stored: None, asked })
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

/// A setting that is not one of the preset meant.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Foreign {
    /// The setting, as messages name it.
    pub setting: String,
    /// The preset that has it.
    pub preset: Preset,
    /// The value given.
    pub value: String,
}

fn foreign<Other: SettingLayer, Own: SettingLayer>(given: &Other) -> Option<Foreign> {
    let (about, value) = given.foreign_to::<Own>()?;
    Some(Foreign { setting: about.name(), preset: Other::PRESET, value })
}

/// A preset as a RON file: every setting with what it does and its default.
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
