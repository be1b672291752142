//! Opens the demo, a dataset folder, a checkpoint or a model file.

use super::color_mode::ColorMode;
use super::state::{HomeView, NoticeKind, Opened, Subject};
use super::training::{RefusedSetting, TrainSettings};
use super::wording::{origin_info, session_info};
use crate::dataset::LoadOptions;
use crate::dataset::calibration::Calibration;
use crate::dataset::error::DatasetError;
use crate::export::ExportError;
use crate::export::checkpoint::is_checkpoint;
use crate::export::mapping::is_plain;
use crate::export::registration::Registration;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::orbit::Orbit;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::framing::{Framing, framing};
use crate::model::splat::splats::Splat;
use crate::pipeline::checkpoint::{ResumeRequest, RunError, SavedRun};
use crate::pipeline::error::SessionError;
use crate::pipeline::memory;
use crate::pipeline::plan::Selection;
use crate::pipeline::session::{DemoError, Session, demo_dataset, demo_session};
use crate::{dataset, export};
use glam::DVec3;
use std::path::{Path, PathBuf, absolute};
use std::sync::Arc;

pub enum Content {
    Session(Box<Session>),
    /// Splats without training state, and the registration of their world.
    Model(SplatSet, Option<Registration>),
}

/// Newly opened dataset or model: its content, its properties for panels, and notices.
pub struct OpenedSubject {
    pub content: Content,
    pub splats: SplatSet,
    pub opened: Opened,
    pub notices: Vec<(NoticeKind, String)>,
}

#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    #[error(transparent)]
    Demo(#[from] DemoError),
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    #[error(transparent)]
    Session(#[from] SessionError),
    #[error(transparent)]
    Model(#[from] ExportError),
    #[error(transparent)]
    Run(#[from] RunError),
    #[error(transparent)]
    Setting(#[from] RefusedSetting),
}

/// Reason why a path cannot be opened or written.
#[derive(Clone, Debug)]
pub struct PathProblem {
    pub text: String,
    /// Folder of the recording of which the path is a part.
    pub above: Option<PathBuf>,
}

impl From<String> for PathProblem {
    fn from(text: String) -> Self {
        Self { text, above: None }
    }
}

impl From<OpenError> for PathProblem {
    fn from(error: OpenError) -> Self {
        let text = error.to_string();
        match error {
            OpenError::Dataset(DatasetError::InsideRecording { above, .. }) => {
                Self { text, above: Some(above) }
            }
            _ => text.into(),
        }
    }
}

/// Checks that a path exists and looks like something that can be opened, without reading all of it.
/// `follows` is true if recordings are followed, whose folders may still be empty.
pub fn check(path: &Path, reading: &LoadOptions, follows: bool) -> Result<(), PathProblem> {
    if is_calibration(path) {
        return Calibration::read(path).map(drop).map_err(|error| error.to_string().into());
    }
    if path.is_file() && !dataset::is_archive(path) {
        return check_model(path);
    }
    if follows && path.is_dir() {
        return Ok(());
    }
    Ok(dataset::check_layout(path, reading).map_err(OpenError::from)?)
}

/// Checks by its start that a file may be a checkpoint or a model.
pub fn check_model(path: &Path) -> Result<(), PathProblem> {
    match is_checkpoint(path) {
        true => Ok(()),
        false => Ok(export::check_start(path).map_err(OpenError::from)?),
    }
}

/// True for the name of a calibration file.
pub fn is_calibration(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "ron")
}

/// Opens a dataset or model and gives it the serial number `serial`. Training uses the settings in
/// `training`, unless a checkpoint with its own settings is resumed.
pub fn open(
    subject: &Subject,
    training: &TrainSettings,
    serial: u64,
) -> Result<OpenedSubject, OpenError> {
    match subject {
        Subject::Demo => Ok(session(demo_session(training.request()?)?, serial, None)),
        Subject::Path(path) if is_checkpoint(path) => checkpoint(path, serial),
        // An archive is a file too, but contains a dataset.
        Subject::Path(path) if path.is_file() && !dataset::is_archive(path) => {
            Ok(view(path, read_splats(path)?, serial))
        }
        Subject::Path(path) => {
            let request = training.request()?;
            let calibrated_photographs = request.has_color_camera();
            let reading = training.of_dataset(path).reading;
            let options = LoadOptions { calibrated_photographs, ..reading };
            let dataset = Arc::new(dataset::open(path, &options)?);
            let opened = Session::new(dataset, request, Selection::all_frames())?;
            Ok(session(opened, serial, Some(path)))
        }
    }
}

/// Returns a session with its properties for panels. `path` is `None` for the demo.
pub fn session(mut session: Session, serial: u64, path: Option<&Path>) -> OpenedSubject {
    let dataset = session.dataset().clone();
    let notes = dataset.notes.iter().map(|note| (NoticeKind::Info, note.clone()));
    let warnings = match dataset.warnings.len() {
        0 => None,
        1 => Some((NoticeKind::Warning, dataset.warnings[0].to_string())),
        // One notice, because every frame of a dataset may be unusable.
        n => Some((
            NoticeKind::Warning,
            format!("{n} frames are unusable; the first: {}", dataset.warnings[0]),
        )),
    };
    let assumed = session.config().method.assumes_calibration(&dataset).then(|| (
        NoticeKind::Info,
        "colour is sampled with the published Kinect calibration; for another camera, drop a calibration file here".to_owned(),
    ));
    let split = &dataset.splits[session.plan().split];
    let color_camera = session.config().method.as_any().color_camera();
    let scaled = color_camera.and_then(|camera| split.camera_scaling(&camera).ok().flatten());
    let scaled = scaled.map(|scaled| (NoticeKind::Info, scaled.to_string()));
    let unused = dataset.unused.iter().map(|unused| (NoticeKind::Warning, unused.clone()));
    let lowered = memory::note(session.config().method.as_any().component_limit());
    let lowered = lowered.map(|note| (NoticeKind::Info, note));
    let notices =
        notes.chain(warnings).chain(lowered).chain(unused).chain(assumed).chain(scaled).collect();
    let opened = Opened {
        name: path.map_or_else(|| "Demo: synthetic room".to_owned(), |_| dataset.name.clone()),
        path: path.map(Path::to_path_buf),
        info: session_info(&session),
        home: home_of(&session),
        files: FileProposal::beside(path),
        serial,
        is_demo: path.is_none(),
        dataset: Some(dataset.clone()),
        local_origin: dataset.local_origin(),
        plan: Some(Arc::new(session.plan().clone())),
        selection: Some(session.config().selection.clone()),
        available_modes: &[
            ColorMode::Evidence,
            ColorMode::Uncertainty,
            ColorMode::Elbo,
            ColorMode::Birth,
        ],
        method: Some(session.config().method.clone()),
        calibration: None,
        is_native: session.config().method.scene().is_some(),
    };
    let splats = match session.learner().status().used {
        // Invisible placeholders: later updates refer to components by their index.
        0 => vec![Splat::default(); session.learner().status().components].into(),
        _ => {
            // At rest pending photographs are part of the drawn scene.
            session.settle();
            // Dropped, because the frame reports already contain them.
            session.take_outlier_warnings();
            session.splats()
        }
    };
    OpenedSubject { splats, opened, notices, content: Content::Session(Box::new(session)) }
}

/// Returns the home view: the first training camera. Its orbit centre is ahead of the camera, at the
/// depth of the scene's centre.
fn home_of(session: &Session) -> HomeView {
    let split = &session.dataset().splits[session.plan().split];
    let camera = split.frames[session.plan().frames.first().copied().unwrap_or(0)].camera;
    let [lo, hi] = session.config().position_range.map(DVec3::from_array);
    let (centre, radius) = ((lo + hi) * 0.5, 0.5 * (hi - lo).length());
    let ahead = (centre - camera.pose.centre()).dot(camera.pose.forward());
    // The camera may look past the centre or away from it.
    let distance = ahead.clamp(0.2 * radius, 2.0 * radius);
    let target = camera.pose.centre() + camera.pose.forward() * distance;
    HomeView { camera, up: session.up(), target, radius }
}

/// Horizontal field of view for a model, radians. Model files contain no camera.
const MODEL_FOV: f64 = 1.0;

/// Opens a checkpoint and resumes its run. If the run cannot be resumed, only the scene is shown.
fn checkpoint(path: &Path, serial: u64) -> Result<OpenedSubject, OpenError> {
    let run = SavedRun::read(path)?;
    resumed(&run, serial, Some(path)).or_else(|error| {
        let mut scene = scene_of(&run)?;
        let text = format!("{error}; the scene is shown, but training cannot be resumed");
        scene.notices.push((NoticeKind::Warning, text));
        Ok(view(path, scene, serial))
    })
}

/// Resumes an autosaved run. In the window it has the name and path of its dataset.
pub fn open_run(path: &Path, serial: u64) -> Result<OpenedSubject, OpenError> {
    let run = SavedRun::read(path)?;
    resumed(&run, serial, run.meta.dataset.as_deref())
}

fn resumed(run: &SavedRun, serial: u64, path: Option<&Path>) -> Result<OpenedSubject, OpenError> {
    let mut opened = session(continued(run)?, serial, path);
    opened.notices.extend(run.numerics_differ().map(|text| (NoticeKind::Warning, text)));
    Ok(opened)
}

fn drawable(all: &SplatSet) -> SplatSet {
    // A checkpoint also stores components that are unused.
    all.retained(|_, splat| splat.is_drawable())
}

fn continued(run: &SavedRun) -> Result<Session, OpenError> {
    let dataset = match &run.meta.dataset {
        Some(folder) => Arc::new(dataset::open(folder, &run.load_options())?),
        None => demo_dataset()?,
    };
    Ok(run.clone().resume(dataset, &ResumeRequest::default(), false)?)
}

/// Splats of a checkpoint or a model file, without training state.
pub struct BareSplats {
    /// Splats with positions relative to `local_origin`.
    pub splats: SplatSet,
    /// Origin of the splat positions, in the world coordinates of the file's dataset.
    pub local_origin: DVec3,
    pub notices: Vec<(NoticeKind, String)>,
    up: DVec3,
    /// Up direction in the axes of `splats`, if the format defines its axes.
    pub defined_up: Option<DVec3>,
    registration: Option<Registration>,
    /// Size of the file, bytes.
    bytes: u64,
}

pub fn read_splats(path: &Path) -> Result<BareSplats, OpenError> {
    if is_checkpoint(path) {
        return scene_of(&SavedRun::read(path)?);
    }
    let model = export::read(path)?;
    let mut notices: Vec<_> =
        model.notes.iter().map(|n| (NoticeKind::Info, n.to_string())).collect();
    if model.skipped > 0 {
        let (n, path) = (model.skipped, path.display());
        let text = format!("{n} rows of {path} are not finite and were left out");
        notices.push((NoticeKind::Warning, text));
    }
    Ok(BareSplats {
        up: model.up().unwrap_or(DVec3::Z),
        defined_up: model.defined_up,
        local_origin: model.local_origin,
        registration: None,
        bytes: model.bytes,
        splats: model.splats,
        notices,
    })
}

fn scene_of(run: &SavedRun) -> Result<BareSplats, OpenError> {
    Ok(BareSplats {
        splats: drawable(&run.splats()?),
        local_origin: run.local_origin(),
        notices: Vec::new(),
        up: run.up(),
        defined_up: None,
        registration: run.meta.registration.clone(),
        bytes: run.bytes,
    })
}

fn view(path: &Path, scene: BareSplats, serial: u64) -> OpenedSubject {
    let BareSplats { splats, local_origin, notices, up, bytes, registration, .. } = scene;
    let framing = framing(splats.iter()).unwrap_or(Framing { centre: DVec3::ZERO, radius: 1.0 });
    let intrinsics = Intrinsics::from_horizontal_fov(800, 600, MODEL_FOV);
    let orbit = Orbit {
        target: framing.centre,
        up,
        azimuth: 0.6,
        elevation: 0.4,
        distance: framing.distance(intrinsics.fov_y()),
    };
    let camera = Camera { intrinsics, pose: orbit.pose() };
    let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
    let opened = Opened {
        name,
        path: Some(path.to_owned()),
        info: [
            ("Model".to_owned(), path.display().to_string()),
            ("Splats".to_owned(), splats.len().to_string()),
            ("Size".to_owned(), format!("{:.1} MB", bytes as f64 * 1e-6)),
        ]
        .into_iter()
        .chain(origin_info(local_origin))
        .collect(),
        home: HomeView { camera, up, target: framing.centre, radius: framing.radius },
        files: FileProposal::beside(Some(path)),
        serial,
        is_demo: false,
        dataset: None,
        local_origin,
        plan: None,
        selection: None,
        available_modes: &[],
        method: None,
        calibration: None,
        is_native: !is_plain(splats.view()),
    };
    let content = Content::Model(splats.clone(), registration);
    OpenedSubject { splats, opened, notices, content }
}

const DEMO: &str = "demo";

/// Folder, and file name without extension, that dialogs propose for new files.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileProposal {
    /// Folder that contains the open file or dataset; the current folder for the demo. An absolute path if
    /// it can be determined.
    pub folder: PathBuf,
    pub stem: String,
}

impl FileProposal {
    /// Proposes files beside the opened path and named after it. `opened` is `None` for the demo.
    pub fn beside(opened: Option<&Path>) -> Self {
        let Some(opened) = opened else {
            return Self { folder: absolute_or_same(Path::new(".")), stem: DEMO.to_owned() };
        };
        let mut path = absolute_or_same(opened);
        if path.file_name().is_none() {
            // `a/..` is a folder too, but only the file system knows its name.
            path = path.canonicalize().unwrap_or(path);
        }
        // Only files have extensions: a dot in a folder's name is part of the name.
        let name = if path.is_file() { path.file_stem() } else { path.file_name() };
        let stem = name.map_or_else(|| DEMO.to_owned(), |name| name.to_string_lossy().into_owned());
        let folder = path.parent().map_or_else(|| path.clone(), Path::to_path_buf);
        Self { folder, stem }
    }

    /// Returns the proposed path with the extension `ending`, given without its dot.
    pub fn path(&self, ending: &str) -> PathBuf {
        self.folder.join(format!("{}.{ending}", self.stem))
    }
}

/// Makes a path absolute. Returns it unchanged if the current folder is unknown.
pub fn absolute_or_same(path: &Path) -> PathBuf {
    absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod file_proposal_tests {
    use super::*;

    #[test]
    fn files_go_beside_what_is_open_and_are_named_by_it() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path().canonicalize().unwrap();
        let room = folder.join("my.room");
        std::fs::create_dir_all(room.join("train")).unwrap();
        let run = folder.join("run.1.vbgs");
        std::fs::write(&run, "").unwrap();
        for (opened, expected) in [
            (room.clone(), "my.room.ply"),
            (room.join("train").join(".."), "my.room.ply"),
            (run, "run.1.ply"),
        ] {
            let proposal = FileProposal::beside(Some(&opened));
            assert_eq!(proposal.path("ply"), folder.join(expected), "{}", opened.display());
        }
        let demo = FileProposal::beside(None);
        assert_eq!(demo.path("vbgs"), std::env::current_dir().unwrap().join("demo.vbgs"));
        assert!(FileProposal::beside(Some(Path::new("/"))).path("ply").is_absolute());
    }
}
