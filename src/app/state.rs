//! State of a run, and the snapshot of it that panels draw.

use super::color_mode::ColorMode;
use super::opening::FileProposal;
use super::rescue::AbandonedRun;
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::pose_check::PoseCheck;
use crate::dataset::surface::sample::FrameSample;
use crate::dataset::{Dataset, LoadOptions};
use crate::eval::report::{FrameReport, QualityCurves, SkippedFrame, quantile};
use crate::export::registration::Registration;
use crate::math::camera::Camera;
use crate::model::inspection::Inspection;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::method::Method;
use crate::pipeline::settings::scene::SceneRun;
use glam::DVec3;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RunState {
    #[default]
    Empty,
    Loading,
    /// Training waits, because the followed recording has no complete frame yet.
    Waiting,
    Ready,
    Training,
    /// The user has stopped training between two frames.
    Paused,
    /// Every frame is trained, or a model was opened for viewing.
    Finished,
    /// Training has failed; the scene trained so far remains.
    Failed,
}

impl RunState {
    pub const ALL: [RunState; 8] = [
        RunState::Empty,
        RunState::Loading,
        RunState::Waiting,
        RunState::Ready,
        RunState::Training,
        RunState::Paused,
        RunState::Finished,
        RunState::Failed,
    ];

    /// True while a trained scene does not change: training is paused or finished.
    pub fn is_at_rest(self) -> bool {
        matches!(self, RunState::Paused | RunState::Finished)
    }

    pub fn label(self) -> &'static str {
        match self {
            RunState::Empty => "Empty",
            RunState::Loading => "Loading",
            RunState::Waiting => "Waiting",
            RunState::Ready => "Ready",
            RunState::Training => "Training",
            RunState::Paused => "Paused",
            RunState::Finished => "Finished",
            RunState::Failed => "Failed",
        }
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    #[default]
    Nothing,
    Dataset,
    Model,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    Demo,
    Path(PathBuf),
}

impl Subject {
    /// Returns the path; `None` for the demo.
    pub fn path(&self) -> Option<&Path> {
        match self {
            Self::Path(path) => Some(path),
            Self::Demo => None,
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomeView {
    pub camera: Camera,
    pub up: DVec3,
    pub target: DVec3,
    pub radius: f64,
}

/// Properties of the open dataset or model, for panels. Replaced when another dataset or model is opened.
#[derive(Clone, Debug)]
pub struct Opened {
    pub name: String,
    pub path: Option<PathBuf>,
    pub info: Vec<(String, String)>,
    pub home: HomeView,
    pub files: FileProposal,
    /// Serial number, which increases with every opened dataset or model.
    pub serial: u64,
    /// True for the built-in demo, which can be recomputed.
    pub is_demo: bool,
    /// The open dataset, for comparisons with photographs; `None` for a model.
    pub dataset: Option<Arc<Dataset>>,
    /// Origin of splat positions, in the world coordinates of the opened files.
    pub local_origin: DVec3,
    /// Frames to train, in training order; `None` for a model.
    pub plan: Option<Arc<Plan>>,
    pub selection: Option<Selection>,
    /// Colour modes that the open dataset or model supports in addition to those that are always supported.
    pub available_modes: &'static [ColorMode],
    pub method: Option<Method>,
    pub calibration: Option<Arc<GivenCalibration>>,
    /// True if splats may have properties that standard 3DGS lacks, such as colour gradients. An export may
    /// have to convert them.
    pub is_native: bool,
}

impl Opened {
    pub fn scene(&self) -> Option<&SceneRun> {
        self.method.as_ref()?.scene()
    }

    /// Returns the camera that took the photographs, if it differs from the depth camera.
    pub fn color_camera(&self) -> Option<ColorCamera> {
        self.method.as_ref()?.as_any().color_camera()
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct GivenCalibration {
    pub calibration: Calibration,
    /// File that contains the calibration; `None` if the calibration comes from a resumed run.
    pub file: Option<PathBuf>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum Inspected {
    Component(Box<Inspection>),
    Splat { id: u32, splat: Splat, appearance: Appearance },
}

impl Inspected {
    pub fn id(&self) -> u32 {
        match self {
            Self::Component(inspection) => inspection.id,
            Self::Splat { id, .. } => *id,
        }
    }

    pub fn splat(&self) -> &Splat {
        match self {
            Self::Component(inspection) => &inspection.splat,
            Self::Splat { splat, .. } => splat,
        }
    }

    pub fn appearance(&self) -> &Appearance {
        match self {
            Self::Component(inspection) => &inspection.appearance,
            Self::Splat { appearance, .. } => appearance,
        }
    }
}

/// Snapshot of the run for the window. It contains only small values and shared lists, because every
/// publication copies it.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    pub state: RunState,
    pub source: Source,
    pub opened: Option<Arc<Opened>>,
    pub frames_done: usize,
    pub n_frames: usize,
    pub frames: FrameLists,
    /// True if the drawn scene already includes the photographs in the shuffle buffer, although training on
    /// them follows later.
    pub includes_pending_photographs: bool,
    pub model: ModelSize,
    pub pace: Pace,
    pub files: FileState,
    /// True if the program is being terminated and training was stored. Windows then close.
    pub is_terminated: bool,
    pub inspected: Option<Arc<Inspected>>,
    /// Registration of the world, which exports apply.
    pub registration: Option<Arc<Registration>>,
    pub sampling: FrameSampling,
    /// Quality measured during the run, also before it was resumed.
    pub curves: Arc<QualityCurves>,
    pub notices: Arc<Vec<Notice>>,
    pub following: FollowState,
}

/// Lists of reports about single frames. Snapshots share each list until it changes.
#[derive(Clone, Debug, Default)]
pub struct FrameLists {
    /// Reports of the latest frames, oldest first, at most [`HISTORY`].
    pub recent: Arc<Vec<FrameReport>>,
    /// Reports of frames older than those in `recent`, whose buffered photographs were compared with the
    /// scene since then.
    pub late: Arc<Vec<FrameReport>>,
    pub skipped: Arc<Vec<SkippedFrame>>,
    /// Warnings about outlier frames, which do not fit the scene.
    pub outliers: Arc<Vec<String>>,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct ModelSize {
    /// Number of components, including unused ones.
    pub components: usize,
    pub used: usize,
    pub bytes: usize,
    /// Memory of textures, part of `bytes`.
    pub texture_bytes: usize,
}

#[derive(Clone, Copy, Debug, Default)]
pub struct Pace {
    /// Trained frames per second of wall-clock time, averaged over the latest frames.
    pub frames_per_s: f64,
    /// Training time in seconds, including the time spent waiting for frames.
    pub trained_s: f64,
    /// Time at which training began to wait for a frame that has not been read; `None` if training does not
    /// wait.
    pub unread_since: Option<Instant>,
}

#[derive(Clone, Debug, Default)]
pub struct FileState {
    /// Number of frames trained since the run was last saved or exported.
    pub unsaved_frames: usize,
    /// True if scale, level or coordinates were set since the run was last saved or exported.
    pub is_registration_unsaved: bool,
    pub latest_write: Option<WriteOutcome>,
    /// Number of the latest file that could not be written, and the error.
    pub failed_write: Option<(u64, Arc<str>)>,
    /// Run of an earlier window that was neither saved nor discarded, offered for resuming.
    pub abandoned: Option<Arc<AbandonedRun>>,
}

/// Measurements on a sample of the frames. Each is `None` until it is known.
#[derive(Clone, Debug, Default)]
pub struct FrameSampling {
    /// Result of checking whether the camera poses agree with the depth images.
    pub poses: Option<Arc<PoseCheck>>,
    /// Pixel width and depth noise. Available only for a dataset that the scene preset trains.
    pub sample: Option<FrameSample>,
}

#[derive(Clone, Debug, Default)]
pub struct FollowState {
    /// True if recordings are followed, that is, trained on while they are being written. Applies to the
    /// open recording and those opened later.
    pub is_on: bool,
    pub recording: Option<Followed>,
}

impl Snapshot {
    /// Returns the median training time of the latest frames, ms; `None` before the first one.
    pub fn median_frame_ms(&self) -> Option<f64> {
        let mut ms: Vec<f64> = self.frames.recent.iter().map(|f| f.ms.stages.train).collect();
        ms.sort_by(f64::total_cmp);
        (!ms.is_empty()).then(|| quantile(&ms, 0.5))
    }

    /// Returns the number of frames that were processed for the scene, including skipped ones.
    pub fn n_seen(&self) -> usize {
        self.frames_done + self.frames.skipped.len()
    }

    /// True if training would be lost by closing the window or opening another dataset or model. Always
    /// false for the demo, which can be recomputed.
    pub fn has_training_to_lose(&self) -> bool {
        (self.files.unsaved_frames > 0 || self.files.is_registration_unsaved)
            && self.opened.as_ref().is_some_and(|opened| !opened.is_demo)
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Followed {
    pub path: PathBuf,
    /// True if training has used all complete frames and waits for new ones.
    pub is_waiting: bool,
    /// Reason why no frames arrive, other than the absence of new files.
    pub problem: Option<String>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteOutcome {
    pub number: u64,
    pub is_written: bool,
}

/// Maximum number of latest frames whose reports a snapshot contains.
pub const HISTORY: usize = 300;

/// Offer to open a dataset with options that its notice advises.
#[derive(Clone, Debug, PartialEq)]
pub struct OpenAs {
    pub path: PathBuf,
    pub reading: LoadOptions,
}

impl OpenAs {
    /// Returns the offer for a message that names an option of the command line; `None` if it names none.
    /// Options with a value of the user's are offered unset.
    pub fn advised(path: &Path, message: &str) -> Option<Self> {
        let axes = message.split_once("--pose-axes ").and_then(|(_, after)| {
            let end = after.find(|c: char| !(c.is_ascii_lowercase() || c == '-'));
            after[..end.unwrap_or(after.len())].parse().ok()
        });
        let reading = LoadOptions {
            track: message.contains("--poses track"),
            geometry_only: message.contains("geometry only"),
            poses: axes,
            ..LoadOptions::default()
        };
        let others = ["--depth-scale", "--depth-range", "--intrinsics", "--confidence"];
        let is_named =
            reading != LoadOptions::default() || others.iter().any(|name| message.contains(name));
        is_named.then(|| Self { path: path.to_owned(), reading })
    }
}

/// What a notice offers besides being closed.
#[derive(Clone, Debug, PartialEq)]
pub enum NoticeOffer {
    OpenAs(OpenAs),
    /// Opens the folder of the recording of which a part was to be opened.
    OpenAbove(PathBuf),
}

#[derive(Clone, Debug, PartialEq)]
pub struct Notice {
    /// Serial number, which increases with every notice, so that closed notices do not reappear.
    pub serial: u64,
    pub topic: NoticeTopic,
    pub kind: NoticeKind,
    pub text: String,
    pub offer: Option<NoticeOffer>,
}

/// Topic of a notice, which determines how long it is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoticeTopic {
    /// Concerns the open dataset or model, or one whose opening failed; shown until another one is opened.
    Subject,
    /// Concerns the window and its graphics adapter; shown until another adapter draws the window.
    Window,
    Event,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoticeKind {
    Info,
    /// Something was omitted or is doubtful.
    Warning,
    Error,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::PoseConvention;

    #[test]
    fn a_message_that_names_an_option_offers_it() {
        let advised = |text: &str| OpenAs::advised(Path::new("a"), text).map(|offer| offer.reading);
        let plain = LoadOptions::default();
        assert_eq!(advised("a: expected poses, found none"), None);
        let track = Some(LoadOptions { track: true, ..plain });
        assert_eq!(advised("estimate all poses with --poses track"), track);
        let poses = Some(PoseConvention::OpenglWorldToCamera);
        let axes = advised("choose the pose axes (`--pose-axes opengl-world-to-camera`)");
        assert_eq!(axes, Some(LoadOptions { poses, ..plain }));
        assert_eq!(advised("set the intrinsics (`--intrinsics`)"), Some(plain));
        let grey = Some(LoadOptions { geometry_only: true, ..plain });
        assert_eq!(advised("or open the recording with geometry only"), grey);
    }
}
