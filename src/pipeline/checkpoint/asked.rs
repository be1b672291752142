//! Settings a user gives beside a checkpoint: they must be the ones the run was begun with.
//!
//! Every comparison is between values of the setting's own type: those of a model by its preset's
//! table, those of frames and depth here. Comparing the stored JSON instead would let pass whatever
//! has another name or place there.

use super::error::RunError;
use super::saved::SavedRun;
use crate::dataset::LoadOptions;
use crate::dataset::splits::HoldOut;
use crate::pipeline::plan::{Order, Selection, Shard};
use crate::pipeline::settings::GivenSettings;
use crate::train::setting::Preset;
use crate::train::setting::table::Conflict;
use crate::train::setting::value::text_of;
use serde::Serialize;
use std::fmt::Debug;

/// What a user asks of a run that goes on; what is not asked for is as it was.
#[derive(Clone, Debug, Default)]
pub struct ResumeRequest {
    /// Origin of the defaults.
    pub preset: Option<Preset>,
    /// Settings of the model.
    pub model: GivenSettings,
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
    /// Frames at most, those gone through included: this may change.
    pub max_frames: Option<usize>,
    /// How often frames are gone through, those before included: this may change too.
    pub passes: Option<usize>,
    /// Whether to take frames while they are recorded.
    pub follow: bool,
    /// Which frames are held out.
    pub hold_out: Option<HoldOut>,
}

impl SavedRun {
    /// Refuses the first setting that contradicts the run's.
    ///
    /// # Errors
    /// [`RunError::Conflict`] names the option, the run's value and the one asked for.
    pub fn check(&self, asked: &ResumeRequest) -> Result<(), RunError> {
        let method = &self.config.method;
        let conflict = differs("--preset", asked.preset.as_ref(), Some(&method.preset()))
            .or_else(|| asked.model.conflict(method))
            .or_else(|| of_frames(asked, &self.config.selection))
            .or_else(|| of_depth(&asked.load, &self.config.load));
        match conflict {
            None => Ok(()),
            Some(Conflict { setting, stored, asked }) => {
                let stored = stored.unwrap_or_else(|| "no value".to_owned());
                Err(RunError::Conflict { setting, path: self.path.clone(), stored, asked })
            }
        }
    }
}

/// Which frames, and in which order.
fn of_frames(asked: &ResumeRequest, stored: &Selection) -> Option<Conflict> {
    // Taken apart whole, so that a new field asks to be compared; how many frames, which share of them, how often and who
    // waits for them may change.
    let ResumeRequest {
        preset: _,
        model: _,
        split,
        order,
        stride,
        shard: _,
        load: _,
        max_frames: _,
        passes: _,
        follow: _,
        hold_out,
    } = asked;
    differs("--split", split.as_ref(), stored.split.as_ref())
        .or_else(|| differs("--order", order.as_ref(), Some(&stored.order)))
        .or_else(|| differs("--stride", stride.as_ref(), Some(&stored.stride)))
        .or_else(|| differs("--hold-out", hold_out.as_ref(), Some(&stored.hold_out)))
}

fn of_depth(asked: &LoadOptions, stored: &LoadOptions) -> Option<Conflict> {
    let LoadOptions {
        depth_scale,
        depth_range,
        poses,
        intrinsics,
        confidence,
        geometry_only,
        track,
        // No option of the command line: it is the checkpoint's.
        local_origin: _,
    } = asked;
    let grey = |load: &LoadOptions| load.geometry_only.then_some(true);
    let tracked = |load: &LoadOptions| load.track.then_some(true);
    differs("--depth-scale", depth_scale.as_ref(), stored.depth_scale.as_ref())
        .or_else(|| differs("--depth-range", depth_range.as_ref(), stored.depth_range.as_ref()))
        .or_else(|| differs("--pose-axes", poses.as_ref(), stored.poses.as_ref()))
        .or_else(|| differs("--intrinsics", intrinsics.as_ref(), stored.intrinsics.as_ref()))
        .or_else(|| differs("--confidence", confidence.as_ref(), stored.confidence.as_ref()))
        .or_else(|| {
            differs("--geometry-only", geometry_only.then_some(&true), grey(stored).as_ref())
        })
        .or_else(|| differs("--poses track", track.then_some(&true), tracked(stored).as_ref()))
}

/// A value asked for that is not the stored one.
fn differs<T: PartialEq + Serialize + Debug>(
    option: &str,
    asked: Option<&T>,
    stored: Option<&T>,
) -> Option<Conflict> {
    let asked = asked.filter(|_| asked != stored)?;
    Some(Conflict {
        setting: option.to_owned(),
        stored: stored.map(text_of),
        asked: text_of(asked),
    })
}
