//! Opens datasets and models for training or viewing.

use super::following::{follow_of, is_folder};
use super::thread::WorkerThread;
use crate::app::opening;
use crate::app::opening::{Content, OpenedSubject, PathProblem};
use crate::app::rescue::{AbandonedRun, AutosaveSlot};
use crate::app::splat_updates::SplatChange;
use crate::app::state::{
    GivenCalibration, NoticeKind, NoticeOffer, NoticeTopic, OpenAs, Opened, RunState, Source,
    Subject,
};
use crate::dataset::calibration::Calibration;
use crate::dataset::frame::Frame;
use crate::eval::report::FrameReport;
use crate::pipeline::follow::Follow;
use crate::pipeline::job::Job;
use crate::pipeline::panic_report::PanicReport;
use crate::train::setting::Preset;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

enum Found {
    Whole(Box<OpenedSubject>),
    /// A folder with a recording that continues or has not begun.
    Recording(Box<Follow>),
}

impl WorkerThread {
    pub(super) fn open_with(
        &mut self,
        calibration: Option<Arc<GivenCalibration>>,
        subject: Subject,
    ) {
        let path = subject.path().map(Path::to_path_buf);
        if let Err(refusal) = self.try_open(calibration, subject) {
            self.refuse(path.as_deref(), refusal.kind, refusal.problem);
        }
    }

    /// Reports why something was not opened, with an offer of what can be opened instead.
    pub(super) fn refuse(&mut self, path: Option<&Path>, kind: NoticeKind, problem: PathProblem) {
        let PathProblem { text, above } = problem;
        let open_as =
            || path.and_then(|path| OpenAs::advised(path, &text)).map(NoticeOffer::OpenAs);
        let offer = above.map(NoticeOffer::OpenAbove).or_else(open_as);
        // Of the subject, so that it disappears once something is open.
        self.outbox.notify_with(NoticeTopic::Subject, kind, text, offer);
    }

    fn try_open(
        &mut self,
        calibration: Option<Arc<GivenCalibration>>,
        subject: Subject,
    ) -> Result<(), Refusal> {
        let found = self.while_loading(|worker| worker.find(calibration.as_ref(), &subject))?;
        match found {
            Found::Recording(follow) => {
                self.await_recording(*follow, calibration, subject);
            }
            Found::Whole(opened) => {
                self.outbox.next_serial += 1;
                self.run.set_subject(subject, calibration);
                self.install_subject(*opened);
                let opened = self.outbox.snapshot.opened.clone();
                let dataset = opened.as_ref().and_then(|opened| opened.dataset.as_ref());
                if let Some(path) = dataset.and_then(|dataset| dataset.path.as_deref()) {
                    self.offer_abandoned_run(Some(path));
                }
                if self.outbox.snapshot.following.is_on {
                    self.set_follows(true);
                }
            }
        }
        Ok(())
    }

    /// Runs `open` while the state is [`RunState::Loading`]. If it fails, the previous dataset or model
    /// stays open and its training is paused.
    fn while_loading<T>(
        &mut self,
        open: impl FnOnce(&mut Self) -> Result<T, Refusal>,
    ) -> Result<T, Refusal> {
        let before = self.outbox.snapshot.state;
        self.outbox.set_state(RunState::Loading);
        // Published at once, because this thread publishes nothing during the opening.
        self.outbox.publish(&self.run, true);
        let opened = open(self);
        if opened.is_err() {
            self.outbox.set_state(match before {
                RunState::Training => RunState::Paused,
                RunState::Loading => RunState::Empty,
                other => other,
            });
        }
        opened
    }

    /// Reads the requested dataset or model, or prepares to follow a recording that is being written to the
    /// folder. Fails if reading fails or the user cancels.
    fn find(
        &mut self,
        calibration: Option<&Arc<GivenCalibration>>,
        subject: &Subject,
    ) -> Result<Found, Refusal> {
        let path = subject.path();
        // The level of detail belongs to what is open, or to what is opened first.
        let is_same = self.run.subject.as_ref().is_none_or(|open| open == subject);
        let mut training = match is_same {
            true => self.training.clone(),
            false => self.training.for_dataset(path),
        };
        // Into the copy, because settings outlive the dataset of the calibration.
        training.scene.calibration = calibration.map(|c| c.calibration.clone());
        let (follows, serial) = (self.outbox.snapshot.following.is_on, self.outbox.next_serial);
        let read = subject.clone();
        let found = self.read_cancellable(path, move || match &read {
            Subject::Path(path) if follows && is_folder(&read) => {
                follow_of(path, &training.of_dataset(path).reading)
                    .map(|follow| Found::Recording(Box::new(follow)))
                    .map_err(PathProblem::from)
            }
            _ => opening::open(&read, &training, serial)
                .map(|opened| Found::Whole(Box::new(opened)))
                .map_err(PathProblem::from),
        });
        Ok(found??)
    }

    /// Starts to wait for the first frame of a recording. Until then nothing is open.
    fn await_recording(
        &mut self,
        follow: Follow,
        calibration: Option<Arc<GivenCalibration>>,
        subject: Subject,
    ) {
        self.run.set_subject(subject, calibration);
        self.run.set_content(None);
        self.files.discard();
        self.outbox.replace_splats(SplatChange::All(Arc::default()));
        self.outbox.reset_snapshot();
        self.outbox.set_state(RunState::Waiting);
        self.following.await_recording(Some(follow));
        self.following.update(&self.run, &mut self.outbox);
    }

    pub(super) fn install_subject(&mut self, opened: OpenedSubject) {
        self.outbox.forget_notices(NoticeTopic::Subject);
        self.outbox.reset_snapshot();
        let calibration = self.run.calibration.clone();
        self.outbox.snapshot.opened = Some(Arc::new(Opened { calibration, ..opened.opened }));
        self.following.await_recording(None);
        // The user has confirmed that the previous run may be discarded.
        self.files.discard();
        self.outbox.replace_splats(SplatChange::all(opened.splats));
        self.show_content(&opened.content);
        (self.has_pending_step, self.n_unread) = (false, 0);
        self.run.set_content(Some(opened.content));
        self.watch_frames(opened.opened.serial);
        self.run.schedule_sampling();
        // The splats above were sent without attributes; these follow if the viewport needs them.
        self.watch(self.run.watched);
        for (kind, text) in opened.notices {
            self.outbox.notify_of(NoticeTopic::Subject, kind, text);
        }
        self.refresh_session_info();
    }

    /// Passes thumbnails of the frames that training decodes to the window.
    fn watch_frames(&self, serial: u64) {
        let Some(session) = self.run.session() else { return };
        let shared = self.shared.clone();
        let watcher = move |position, frame: &Frame| shared.thumbnails.add(serial, position, frame);
        session.watch_frames(Arc::new(watcher));
    }

    fn show_content(&mut self, content: &Content) {
        let is_demo = self.run.subject == Some(Subject::Demo);
        let snapshot = &mut self.outbox.snapshot;
        match content {
            Content::Session(session) => {
                snapshot.source = Source::Dataset;
                snapshot.n_frames = session.plan().frames.len();
                snapshot.frames_done = session.learner().status().frames as usize;
                snapshot.state = match session.visited() {
                    0 if is_demo => RunState::Training,
                    0 => RunState::Ready,
                    n if n < snapshot.n_frames => RunState::Paused,
                    _ => RunState::Finished,
                };
                let trained = session.frames().iter().map(|frame| frame.ms.stages.train);
                snapshot.pace.trained_s = 1e-3 * trained.sum::<f64>();
                snapshot.curves = Arc::new(session.curves().clone());
                let doubted = session.frames().iter().filter_map(FrameReport::outlier_warning);
                snapshot.frames.outliers = Arc::new(doubted.collect());
            }
            Content::Model(splats, _) => {
                snapshot.source = Source::Model;
                snapshot.state = RunState::Finished;
                snapshot.model.components = splats.len();
                snapshot.model.used = splats.len();
            }
        }
    }

    /// Reopens the dataset or model with its calibration, so that the current settings apply.
    pub(super) fn reset(&mut self) {
        if let Some(subject) = self.run.subject.clone() {
            let registration = self.run.registration().cloned();
            self.open_with(self.run.calibration.clone(), subject);
            // The world is the same.
            self.run.register(registration);
        }
    }

    pub(super) fn calibrate(&mut self, path: &Path) {
        let read = match self.calibratable() {
            Ok(subject) => {
                let file = path.to_owned();
                let read = self.read_cancellable(Some(path), move || Calibration::read(&file));
                read.and_then(|read| read.map_err(|error| error.to_string().into()))
                    .map(|calibration| (subject, calibration))
            }
            Err(why) => Err(format!("{}: {why}", path.display()).into()),
        };
        match read {
            Ok((subject, calibration)) => {
                let given = GivenCalibration { calibration, file: Some(path.to_owned()) };
                self.open_with(Some(Arc::new(given)), subject);
            }
            Err(Refusal { kind, problem }) => self.outbox.notify(kind, problem.text),
        }
    }

    /// Returns the open dataset if a calibration can be applied to it, otherwise the reason why not.
    fn calibratable(&self) -> Result<Subject, &'static str> {
        match &self.run.subject {
            None => Err("a calibration applies to a dataset: open the dataset first"),
            Some(Subject::Path(open)) if open.is_file() => {
                Err("a calibration applies to a dataset but a file is open: open its dataset first")
            }
            Some(_) if self.training.preset != Preset::Scene => Err(
                "the paper preset does not support a calibration: choose the scene preset in Settings first",
            ),
            Some(subject) => Ok(subject.clone()),
        }
    }

    /// Offers the newest run that an earlier window neither saved nor discarded. Without `dataset`,
    /// considers the runs of all datasets.
    pub(super) fn offer_abandoned_run(&mut self, dataset: Option<&Path>) {
        if let Some(run) = self.files.find_abandoned(dataset) {
            self.outbox.snapshot.files.abandoned = Some(Arc::new(run));
        }
    }

    pub(super) fn resume_abandoned_run(&mut self) {
        let Some(run) = self.outbox.snapshot.files.abandoned.take() else { return };
        if let Err(problem) = self.try_resume(&run) {
            self.outbox.snapshot.files.abandoned = Some(run.clone());
            let text = format!("{}: training cannot be resumed: {problem}", run.file.display());
            self.outbox.notify(NoticeKind::Error, text);
        }
    }

    fn try_resume(&mut self, run: &AbandonedRun) -> Result<(), String> {
        // Locked before it is read, or two windows could resume the same run.
        let slot = AutosaveSlot::lock_existing(&run.slot).map_err(|error| error.to_string())?;
        let slot = slot.ok_or("another window has resumed it")?;
        let (file, serial) = (run.file.clone(), self.outbox.next_serial);
        let opened = self.while_loading(|worker| {
            // The drive of the dataset may have been disconnected.
            let read = worker.read_cancellable(Some(&run.dataset), move || {
                opening::open_run(&file, serial).map_err(|error| error.to_string())
            });
            Ok(read??)
        });
        let opened = opened.map_err(|refusal| refusal.problem.text)?;
        self.outbox.next_serial += 1;
        let calibration = match &opened.content {
            Content::Session(session) => {
                let method = &session.config().method;
                let is_given = !method.assumes_calibration(session.dataset());
                method.as_any().calibration().filter(|_| is_given).cloned()
            }
            Content::Model(..) => None,
        };
        let calibration =
            calibration.map(|calibration| Arc::new(GivenCalibration { calibration, file: None }));
        self.run.set_subject(Subject::Path(run.dataset.clone()), calibration);
        self.install_subject(opened);
        if let Some(session) = self.run.session() {
            self.files.adopt(slot, session);
            // Only the autosave contains these frames, no file of the user's.
            self.outbox.snapshot.files.unsaved_frames = self.outbox.snapshot.frames_done;
        }
        Ok(())
    }

    pub(super) fn discard_abandoned_run(&mut self) {
        let Some(run) = self.outbox.snapshot.files.abandoned.take() else { return };
        if let Ok(Some(slot)) = AutosaveSlot::lock_existing(&run.slot) {
            slot.delete_files();
            // An older one may be left.
            let opened = self.outbox.snapshot.opened.clone();
            self.offer_abandoned_run(opened.as_ref().and_then(|opened| opened.path.as_deref()));
        }
    }

    /// Runs `work` on a separate thread and returns its result, or a [`Refusal`] if the user cancels.
    /// `path` appears in messages.
    fn read_cancellable<T: Send + 'static>(
        &mut self,
        path: Option<&Path>,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Refusal> {
        let name = path.map_or_else(|| "the demo".to_owned(), |path| path.display().to_string());
        self.shared.opening.begin();
        let job = start_opening(&name, work)?;
        let mut is_warned = false;
        loop {
            if let Some(ended) = job.wait(POLL_INTERVAL) {
                return Ok(join_opening(&name, ended)?);
            }
            if !self.shared.is_opening_wanted() {
                let problem = format!("{name}: opening was cancelled").into();
                return Err(Refusal { kind: NoticeKind::Info, problem });
            }
            if !is_warned && job.elapsed() > SLOW {
                is_warned = true;
                self.warn_of_slow_drive(&name, job.elapsed());
            }
        }
    }

    fn warn_of_slow_drive(&mut self, name: &str, elapsed: Duration) {
        let text = format!(
            "{name}: expected it to be open, found it still being read after {} s; a drive may be slow or disconnected: wait, or press Cancel opening below and check the drive",
            elapsed.as_secs()
        );
        // Of the subject, so that it disappears once that is open.
        self.outbox.notify_of(NoticeTopic::Subject, NoticeKind::Warning, text);
        self.outbox.publish(&self.run, true);
    }
}

/// Interval at which the worker checks for cancellation.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Opening time after which the user is warned of a slow drive.
const SLOW: Duration = Duration::from_secs(4);

/// Reason why a dataset or model was not opened.
#[derive(Debug)]
struct Refusal {
    /// Severity of the notice. A cancellation by the user is not an error.
    kind: NoticeKind,
    problem: PathProblem,
}

impl From<PathProblem> for Refusal {
    fn from(problem: PathProblem) -> Self {
        Self { kind: NoticeKind::Error, problem }
    }
}

impl From<String> for Refusal {
    fn from(text: String) -> Self {
        PathProblem::from(text).into()
    }
}

/// Starts a thread that opens a dataset or model by calling `work`. `name` appears in messages.
///
/// # Errors
/// If no thread can be started.
pub fn start_opening<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<Job<T>, String> {
    let n_threads = rayon::current_num_threads();
    let reads = move || {
        // In its own pool: a thread of the global pool that never returns would be missing for training
        // and drawing.
        match rayon::ThreadPoolBuilder::new().num_threads(n_threads).build() {
            Ok(pool) => pool.install(work),
            Err(_) => work(),
        }
    };
    Job::start("opening", reads)
        .map_err(|error| format!("{name}: starting the thread that opens it failed: {error}"))
}

/// Returns the result of the work. If the work panicked, the error is the text of a notice.
pub fn join_opening<T>(name: &str, ended: Result<T, PanicReport>) -> Result<T, String> {
    ended.map_err(|panic| format!("{name}: {}", panic.failure_notice("opening it")))
}
