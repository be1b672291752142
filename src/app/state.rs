//! The states of a run and the picture of it that panels draw from.

use super::abandoned::AbandonedRun;
use super::color_mode::ColorMode;
use super::file_proposal::FileProposal;
use crate::dataset::Dataset;
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::pose_check::PoseCheck;
use crate::dataset::surface::sample::FrameSample;
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::math::camera::Camera;
use crate::model::inspection::Inspection;
use crate::model::splat::appearance::Appearance;
use crate::model::splat::splats::Splat;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::method::Method;
use crate::pipeline::settings::scene::SceneRun;
use glam::DVec3;
use std::path::PathBuf;
use std::sync::Arc;

/// Where a run stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum RunState {
    /// Nothing is open.
    #[default]
    Empty,
    /// A dataset or model is being opened.
    Loading,
    /// A recording is followed that holds no whole frame yet.
    Waiting,
    /// Opened, nothing trained yet.
    Ready,
    /// Frames are being trained.
    Training,
    /// Between two frames, waiting for the user.
    Paused,
    /// Every frame is trained; also a model that was opened to be viewed.
    Finished,
    /// Something went wrong; what was trained is still there.
    Failed,
}

impl RunState {
    /// Every state.
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

    /// As the status line shows it.
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

/// What is open.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Source {
    /// Nothing.
    #[default]
    Nothing,
    /// A dataset that can be trained on.
    Dataset,
    /// A model file, for viewing and exporting.
    Model,
}

/// What a user opens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    /// The built-in demo.
    Demo,
    /// A dataset folder or a model file.
    Path(PathBuf),
}

/// Where to look at first, and at what scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HomeView {
    /// The camera to start from.
    pub camera: Camera,
    /// Direction that points up.
    pub up: DVec3,
    /// Point to turn about.
    pub target: DVec3,
    /// Size of the scene, world units.
    pub radius: f64,
}

/// What is open, as far as panels need to know; replaced when something else is opened.
#[derive(Clone, Debug)]
pub struct Opened {
    /// Name shown in the title.
    pub name: String,
    /// Where it lies; `None` for the demo.
    pub path: Option<PathBuf>,
    /// Lines for the scene panel: label and value.
    pub info: Vec<(String, String)>,
    /// Where to look at first.
    pub home: HomeView,
    /// Where its files are proposed to go, and under which name.
    pub files: FileProposal,
    /// Increases with everything opened, so that the viewport notices.
    pub serial: u64,
    /// Whether it is the built-in demo, which can be made again at any time.
    pub is_demo: bool,
    /// Its frames, for comparing with photographs; `None` for a model.
    pub dataset: Option<Arc<Dataset>>,
    /// What its positions are relative to in the world of its files, world units.
    pub local_origin: DVec3,
    /// Which frames are trained, in their order; `None` for a model.
    pub plan: Option<Arc<Plan>>,
    /// What was asked for of its frames; `None` for a model.
    pub selection: Option<Selection>,
    /// Colour modes whose values come with its splats, beyond those that every splat has.
    pub available_modes: &'static [ColorMode],
    /// How it is trained; `None` for a model.
    pub method: Option<Method>,
    /// Whether its splats are more than other programs draw, so that they are mapped on export.
    pub is_native: bool,
}

impl Opened {
    /// Its settings, where it is trained by the scene preset.
    pub fn scene(&self) -> Option<&SceneRun> {
        self.method.as_ref()?.scene()
    }

    /// The camera that took the photographs, where it is not the one that measured depth.
    pub fn color_camera(&self) -> Option<ColorCamera> {
        self.method.as_ref()?.any().color_camera()
    }
}

/// Corrections of the cameras that a user gave.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenCalibration {
    /// The corrections.
    pub calibration: Calibration,
    /// The file they were read from; `None` where a run that was gone on with brought them.
    pub file: Option<PathBuf>,
}

/// What is known of the splat that the user selected.
#[derive(Clone, Debug, PartialEq)]
pub enum Inspected {
    /// A component of the model in training.
    Component(Box<Inspection>),
    /// A splat of a file.
    Splat {
        /// Its place in the file.
        id: u32,
        /// What the file says of it.
        splat: Splat,
        /// How its colour varies.
        appearance: Appearance,
    },
}

impl Inspected {
    /// Number of the component or splat.
    pub fn id(&self) -> u32 {
        match self {
            Self::Component(inspection) => inspection.id,
            Self::Splat { id, .. } => *id,
        }
    }

    /// As it is drawn.
    pub fn splat(&self) -> &Splat {
        match self {
            Self::Component(inspection) => &inspection.splat,
            Self::Splat { splat, .. } => splat,
        }
    }

    /// How its colour varies.
    pub fn appearance(&self) -> &Appearance {
        match self {
            Self::Component(inspection) => &inspection.appearance,
            Self::Splat { appearance, .. } => appearance,
        }
    }
}

/// The newest picture of the run: small numbers only, shared without copying.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// Where the run stands.
    pub state: RunState,
    /// What kind of thing is open.
    pub source: Source,
    /// What is open.
    pub opened: Option<Arc<Opened>>,
    /// The latest frames, oldest first, at most [`HISTORY`].
    pub recent: Arc<Vec<FrameReport>>,
    /// Older frames whose photographs, which had waited, were compared meanwhile: the latest of them.
    pub late: Arc<Vec<FrameReport>>,
    /// Frames trained.
    pub frames_done: usize,
    /// Frames of the run.
    pub n_frames: usize,
    /// Whether the scene is drawn with what waits to be learnt from photographs.
    pub settled: bool,
    /// Components, used or not.
    pub components: usize,
    /// Components with statistics.
    pub used: usize,
    /// Frames that could not be used.
    pub skipped: Arc<Vec<SkippedFrame>>,
    /// What is to be said of frames whose photographs contradict the scene.
    pub doubts: Arc<Vec<String>>,
    /// Trained frames per second of wall time, over the last second or so.
    pub frames_per_s: f64,
    /// Seconds that its training took, waiting for frames included.
    pub trained_s: f64,
    /// Bytes of the model.
    pub model_bytes: usize,
    /// Frames trained since the run was last saved or exported.
    pub unsaved_frames: usize,
    /// Whether the program was ended from outside and training was kept: windows close.
    pub is_left_behind: bool,
    /// What became of the file that was to be written last.
    pub latest_write: Option<WriteOutcome>,
    /// What is known of the selected splat, if one is selected.
    pub inspected: Option<Arc<Inspected>>,
    /// How well the dataset's poses agree with its depth, once that is known.
    pub poses: Option<Arc<PoseCheck>>,
    /// How wide pixels are and how far depth is to be trusted, once that is known of a dataset that the
    /// scene preset trains.
    pub sample: Option<FrameSample>,
    /// What corrects the cameras of what is open, if something was given.
    pub calibration: Option<Arc<GivenCalibration>>,
    /// A run that an earlier window left behind, to be gone on with.
    pub abandoned: Option<Arc<AbandonedRun>>,
    /// What the user should read, newest last.
    pub notices: Arc<Vec<Notice>>,
    /// Whether recordings are followed: the one that is open and what is opened next.
    pub follows: bool,
    /// The recording that is followed now, if one is.
    pub followed: Option<Followed>,
}

impl Snapshot {
    /// Frames that the scene has seen, skipped ones among them.
    pub fn n_seen(&self) -> usize {
        self.frames_done + self.skipped.len()
    }
}

/// How a recording is followed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Followed {
    /// Its folder.
    pub path: PathBuf,
    /// Whether all frames that are whole were trained.
    pub is_waiting: bool,
    /// Why nothing comes, where that is not for lack of new files.
    pub problem: Option<String>,
}

impl Snapshot {
    /// Whether closing or opening something else would forget training. The demo can be made again
    /// at any time, so it never counts.
    pub fn has_training_to_lose(&self) -> bool {
        self.unsaved_frames > 0 && self.opened.as_ref().is_some_and(|opened| !opened.is_demo)
    }
}

/// What became of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WriteOutcome {
    /// The number given with the order to write it.
    pub number: u64,
    /// Whether it is there now, whole.
    pub is_written: bool,
}

/// Frames whose reports the window is shown, for their timings above all.
pub const HISTORY: usize = 300;

/// Something the user should read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Notice {
    /// Increases with every notice, so that dismissed ones stay away.
    pub serial: u64,
    /// What it is about.
    pub topic: NoticeTopic,
    /// How bad it is.
    pub kind: NoticeKind,
    /// The text.
    pub text: String,
}

/// What a notice is about, and so how long it matters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoticeTopic {
    /// What is open: until something else is.
    Subject,
    /// The window and its adapter: until another adapter draws.
    Window,
    /// Something that was done.
    Event,
}

/// How bad a notice is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoticeKind {
    /// Good to know.
    Info,
    /// Something was left out.
    Warning,
    /// Something failed.
    Error,
}
