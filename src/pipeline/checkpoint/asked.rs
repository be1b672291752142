//! Settings a user gives beside a checkpoint: they must be the ones the run was begun with.
//!
//! Every comparison is between values of the setting's own type: those of a model by its preset's
//! table, those of frames and depth here. Comparing the stored JSON instead would let pass whatever
//! has another name or place there.

use super::error::RunError;
use super::saved::SavedRun;
use crate::dataset::LoadOptions;
use crate::pipeline::plan::{Order, Selection, Shard};
use crate::pipeline::settings::method::Method;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::{PaperOverrides, Preset};
use crate::train::setting::table::{Conflict, SettingLayer};
use crate::train::setting::value::text_of;
use serde::Serialize;
use std::fmt::Debug;

/// What a user asks of a run that goes on; what is not asked for is as it was.
#[derive(Clone, Debug, Default)]
pub struct ResumeRequest {
    /// Origin of the defaults.
    pub preset: Option<Preset>,
    /// Settings of a model of the paper's preset.
    pub paper: PaperOverrides,
    /// Settings of a model of the scene's.
    pub scene: SceneOverrides,
    /// Split to train on.
    pub split: Option<String>,
    /// Order of the frames.
    pub order: Option<Order>,
    /// Every so-many-th frame.
    pub stride: Option<usize>,
    /// Share of the frames.
    pub shard: Option<Shard>,
    /// How depth files are read.
    pub load: LoadOptions,
    /// Frames at most, those gone through included: the one setting that may change.
    pub max_frames: Option<usize>,
}

impl SavedRun {
    /// Refuses the first setting that contradicts the run's.
    ///
    /// # Errors
    /// [`RunError::Conflict`] names the option, the run's value and the one asked for.
    pub fn check(&self, asked: &ResumeRequest) -> Result<(), RunError> {
        let method = &self.config.method;
        let conflict = differs("--preset", asked.preset.as_ref(), Some(&method.preset()))
            .or_else(|| of_model(&asked.paper, &asked.scene, method))
            .or_else(|| of_frames(asked, &self.config.selection))
            .or_else(|| of_depth(&asked.load, &self.config.load));
        match conflict {
            None => Ok(()),
            Some(Conflict { setting, stored, asked }) => {
                Err(RunError::Conflict { setting, path: self.path.clone(), stored, asked })
            }
        }
    }
}

/// Settings of the run's preset against the run's; of the other, only those with an option of both
/// may be given.
fn of_model(paper: &PaperOverrides, scene: &SceneOverrides, method: &Method) -> Option<Conflict> {
    match method {
        Method::Paper(config) => {
            paper.conflict(config).or_else(|| foreign::<_, PaperOverrides>(scene))
        }
        Method::Scene(run) => scene.conflict(run).or_else(|| foreign::<_, SceneOverrides>(paper)),
    }
}

fn foreign<Other: SettingLayer, Own: SettingLayer>(layer: &Other) -> Option<Conflict> {
    let (about, asked) = layer.foreign_to::<Own>()?;
    Some(Conflict { setting: about.name(), stored: "no such option".to_owned(), asked })
}

/// Which frames, and in which order.
fn of_frames(asked: &ResumeRequest, stored: &Selection) -> Option<Conflict> {
    // Taken apart whole, so that a new field asks to be compared; a limit of frames may change.
    let ResumeRequest {
        preset: _,
        paper: _,
        scene: _,
        split,
        order,
        stride,
        shard,
        load: _,
        max_frames: _,
    } = asked;
    differs("--split", split.as_ref(), stored.split.as_ref())
        .or_else(|| differs("--order", order.as_ref(), Some(&stored.order)))
        .or_else(|| differs("--stride", stride.as_ref(), Some(&stored.stride)))
        .or_else(|| differs("--shard", shard.as_ref(), stored.shard.as_ref()))
}

fn of_depth(asked: &LoadOptions, stored: &LoadOptions) -> Option<Conflict> {
    let LoadOptions { depth_scale, depth_range } = asked;
    differs("--depth-scale", depth_scale.as_ref(), stored.depth_scale.as_ref())
        .or_else(|| differs("--depth-range", depth_range.as_ref(), stored.depth_range.as_ref()))
}

/// A value asked for that is not the stored one.
fn differs<T: PartialEq + Serialize + Debug>(
    option: &str,
    asked: Option<&T>,
    stored: Option<&T>,
) -> Option<Conflict> {
    let asked = asked.filter(|_| asked != stored)?;
    let stored = stored.map_or_else(|| "no such option".to_owned(), text_of);
    Some(Conflict { setting: option.to_owned(), stored, asked: text_of(asked) })
}
