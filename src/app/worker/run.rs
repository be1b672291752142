//! The open dataset or model, and the attribute and component that the window displays.

use crate::app::opening::Content;
use crate::app::state::{FrameSampling, GivenCalibration, HISTORY, Inspected, Subject};
use crate::dataset::pose_check;
use crate::dataset::surface::sample::FrameSample;
use crate::eval::report::FrameReport;
use crate::export::registration::Registration;
use crate::model::attributes::ComponentAttributes;
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::job::Job;
use crate::pipeline::session::Session;
use crate::render::attributes::Attribute;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Default)]
pub struct Run {
    pub subject: Option<Subject>,
    pub calibration: Option<Arc<GivenCalibration>>,
    content: Option<Content>,
    /// Attribute that the viewport needs for each component, if any.
    pub watched: Option<Attribute>,
    /// Index of the component that snapshots describe in detail.
    pub inspecting: Option<u32>,
    pub sampling: Option<Job<FrameSampling>>,
    /// Time at which the frames are sampled, if no frame is trained on before.
    sampling_due: Option<Instant>,
}

/// Delay of sampling after a dataset was opened. The first frame that is trained on ends it: until then
/// sampling would take the cores that decode that frame.
const SAMPLING_DELAY: Duration = Duration::from_millis(500);

impl Run {
    pub fn session(&self) -> Option<&Session> {
        match &self.content {
            Some(Content::Session(session)) => Some(session),
            _ => None,
        }
    }

    pub fn session_mut(&mut self) -> Option<&mut Session> {
        match &mut self.content {
            Some(Content::Session(session)) => Some(session),
            _ => None,
        }
    }

    pub fn set_subject(&mut self, subject: Subject, calibration: Option<Arc<GivenCalibration>>) {
        (self.subject, self.calibration) = (Some(subject), calibration);
    }

    /// Replaces the session or model; `None` while a recording is awaited.
    pub fn set_content(&mut self, content: Option<Content>) {
        self.content = content;
        // A sampling of the previous dataset is abandoned.
        (self.sampling, self.sampling_due) = (None, None);
        // The index would refer to another component.
        self.inspecting = None;
    }

    /// Returns the registration of the world, which exports apply.
    pub fn registration(&self) -> Option<&Registration> {
        match self.content.as_ref()? {
            Content::Session(session) => session.registration(),
            Content::Model(_, registration) => registration.as_ref(),
        }
    }

    pub fn register(&mut self, new: Option<Registration>) {
        match &mut self.content {
            Some(Content::Session(session)) => session.register(new),
            Some(Content::Model(_, registration)) => *registration = new,
            None => {}
        }
    }

    /// Returns the splats of the newest state, regardless of what the viewport displays.
    pub fn splats(&self) -> SplatSet {
        match &self.content {
            Some(Content::Session(session)) => session.splats(),
            Some(Content::Model(splats, _)) => splats.clone(),
            None => SplatSet::default(),
        }
    }

    /// Returns the reports of the latest frames. A report changes once the frame's buffered photograph
    /// is used for training.
    pub fn recent_frames(&self) -> &[FrameReport] {
        let frames = self.session().map_or(&[][..], Session::frames);
        &frames[frames.len().saturating_sub(HISTORY)..]
    }

    /// Returns the attributes of components; empty if the viewport does not need them.
    pub fn attributes_of(&self, ids: &[u32]) -> Vec<ComponentAttributes> {
        match self.session() {
            Some(session) if self.watched.is_some() => session.attributes_of(ids),
            _ => Vec::new(),
        }
    }

    pub fn watch(&mut self, attribute: Option<Attribute>) {
        self.watched = attribute;
        let Some(session) = self.session_mut() else { return };
        match attribute {
            Some(Attribute::Elbo) => session.start_component_elbo(),
            // It costs every frame time, so it is computed only while it is shown.
            _ => session.stop_component_elbo(),
        }
    }

    pub fn inspect(&self) -> Option<Arc<Inspected>> {
        let id = self.inspecting?;
        let inspected = match self.content.as_ref()? {
            Content::Session(session) => Inspected::Component(Box::new(session.inspect(id)?)),
            Content::Model(splats, _) => Inspected::Splat {
                id,
                splat: *splats.get(id as usize)?,
                appearance: splats.appearance_of(id as usize),
            },
        };
        Some(Arc::new(inspected))
    }

    /// Samples the frames once the first one is trained on, or if none is for [`SAMPLING_DELAY`].
    pub fn schedule_sampling(&mut self) {
        self.sampling_due = Some(Instant::now() + SAMPLING_DELAY);
    }

    /// True while frames are sampled, or will be.
    pub fn awaits_sampling(&self) -> bool {
        self.sampling.is_some() || self.sampling_due.is_some()
    }

    /// Starts a scheduled sampling if it is due. `has_trained` is true once a frame was trained on.
    pub fn start_due_sampling(&mut self, has_trained: bool) {
        let is_due = |due: &mut Instant| has_trained || *due <= Instant::now();
        if self.sampling_due.take_if(is_due).is_some() {
            self.start_sampling();
        }
    }

    pub fn start_sampling(&mut self) {
        // Dropping a job cancels it, also if no other one can start.
        self.sampling = None;
        let Some(session) = self.session() else { return };
        let (dataset, split) = (session.dataset().clone(), session.plan().split);
        let surface = session.config().method.scene().map(|run| run.surface.clone());
        let frames = session.plan().first_pass();
        let sample = move || FrameSampling {
            sample: surface
                .and_then(|surface| FrameSample::of(&dataset, split, &frames, &surface).ok()),
            // The poses of the built-in scene are exact.
            poses: dataset
                .path
                .as_ref()
                .and_then(|_| pose_check::check(&dataset, split))
                .map(Arc::new),
        };
        match Job::start("frame sampling", sample) {
            Ok(job) => self.sampling = Some(job),
            Err(error) => tracing::warn!("starting the thread that samples frames failed: {error}"),
        }
    }

    /// Returns the result of sampling frames, or a notice if the sampling panicked. Returns it only
    /// once.
    pub fn take_sampling(&mut self) -> Option<Result<FrameSampling, String>> {
        let ended = self.sampling.as_ref()?.poll()?;
        self.sampling = None;
        Some(ended.map_err(|panic| panic.failure_notice("checking the frames for doubtful poses")))
    }
}
