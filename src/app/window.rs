//! Opens windows around one trainer. If the graphics device is lost or the user chooses another adapter,
//! the window closes and the next one shows the same run.

use super::drawing::{Painting, WindowWaker};
use super::path_editor::PathEditor;
use super::rescue::{Crash, CrashedThread, Rescue};
use super::settings_file::SettingsFile;
use super::splat_updates::Mailbox;
use super::state::{NoticeKind, Subject};
use super::studio::Studio;
use super::viewer::KeptView;
use super::worker::{Worker, WorkerOrder};
use super::{settings_file, viewport};
use crate::pipeline::panic_report::PanicReport;
use crate::render::gpu::adapters::AdapterChoice;
use eframe::egui::{Vec2, ViewportBuilder};
use eframe::{App, CreationContext, NativeOptions};
use std::cell::RefCell;
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

#[derive(Clone, Debug, Default, PartialEq)]
pub enum ExitReason {
    #[default]
    Closed,
    DeviceLost,
    /// The user chose another graphics adapter.
    Adapter(AdapterChoice),
}

/// User state that is passed from a closed window to the next one.
pub struct Handover {
    pub view: KeptView,
    pub path: PathEditor,
}

/// Reason why a window closes, and the state for the next window. Both are shared, because a panic destroys
/// the window's own state.
#[derive(Clone, Default)]
pub struct Exit {
    pub reason: Arc<Mailbox<ExitReason>>,
    pub handover: Arc<Mailbox<Option<Handover>>>,
}

impl Exit {
    /// Creates the record for the next window. It has the same handover state, but no reason yet.
    pub fn for_next_window(&self) -> Self {
        // Shared, not moved: a window that fails to open has not taken the state.
        Self { reason: Arc::default(), handover: self.handover.clone() }
    }
}

/// Number of consecutive device losses after which another adapter is tried.
const MAX_LOSSES: usize = 3;
/// Time after which an open window is considered stable.
const WELL_AFTER: Duration = Duration::from_secs(60);

/// Opens windows one after another until the user closes one. If an adapter fails, the next window uses the
/// adapter that wgpu selects. If that adapter fails too and a window was ever open, the software adapter is
/// used. After a crash no further window is opened.
///
/// # Errors
/// The last error, and true if a window was ever open.
fn keep_open(
    mut adapter: AdapterChoice,
    mut open: impl FnMut(&AdapterChoice) -> Result<(ExitReason, Duration), WindowError>,
    mut tell: impl FnMut(NoticeKind, String),
) -> Result<(), (WindowError, bool)> {
    let mut losses = 0;
    let mut ever_open = false;
    loop {
        let failure = match open(&adapter) {
            Ok((ExitReason::Closed, _)) => return Ok(()),
            Ok((ExitReason::Adapter(chosen), _)) => {
                (adapter, losses, ever_open) = (chosen, 0, true);
                continue;
            }
            Ok((ExitReason::DeviceLost, lived)) => {
                ever_open = true;
                // Counted from 1 after a stable window: a long run may lose its device occasionally,
                // but one that is lost at every start will be lost again.
                losses = if lived >= WELL_AFTER { 1 } else { losses + 1 };
                if losses <= MAX_LOSSES {
                    tell(NoticeKind::Error, "the graphics device was lost, so a new window was opened; training continued meanwhile".to_owned());
                    continue;
                }
                WindowError::DeviceLost(losses)
            }
            Err(error @ WindowError::Crashed(_)) => return Err((error, ever_open)),
            Err(error) => error,
        };
        // If wgpu's own choice cannot open the first window, the caller has alternatives without a
        // window. The software adapter is for a run that would lose its window.
        let next = match (&adapter, ever_open) {
            (AdapterChoice::Software, true) | (AdapterChoice::Auto, false) => {
                return Err((failure, ever_open));
            }
            (AdapterChoice::Auto, true) => AdapterChoice::Software,
            _ => AdapterChoice::Auto,
        };
        tell(
            NoticeKind::Error,
            format!(
                "adapter `{adapter}`: {failure}; the window now uses adapter `{next}`; choose another one in Settings"
            ),
        );
        (adapter, losses) = (next, 0);
    }
}

/// Opens a window on the dataset or model `subject` and runs until the user closes it. The file
/// `calibration` corrects a dataset's cameras. If `adapter` is `None`, the adapter chosen in an earlier
/// session is used. `is_ended` waits for at most the given time and returns true once the program must end.
/// Training is then stored for the next session and the window closes. `started` is the start time of the
/// process.
pub fn run(
    subject: Subject,
    calibration: Option<PathBuf>,
    adapter: Option<AdapterChoice>,
    is_ended: impl Fn(Duration) -> bool + Send + 'static,
    started: Instant,
) -> Result<(), WindowError> {
    // Checked first: without a display nothing needs to be started, and this error is specific.
    if !has_display() {
        return Err(WindowError::NoDisplay);
    }
    let no_thread = |e: std::io::Error| WindowError::Window(e.to_string());
    let host = Host::new(started).map_err(no_thread)?;
    watch(is_ended, &host.worker).map_err(no_thread)?;
    let settings = SettingsFile::of_user();
    let found = settings.as_ref().map(SettingsFile::open).unwrap_or_default();
    for text in found.problems {
        // Notices of the worker outlive a window that cannot be opened.
        host.worker.send(WorkerOrder::Report(NoticeKind::Warning, text));
    }
    let adapter = adapter.or(found.adapter).unwrap_or(AdapterChoice::Auto);
    let mut first: Vec<WorkerOrder> = vec![WorkerOrder::Open(subject)];
    // Sent after the dataset, whose cameras it corrects.
    first.extend(calibration.map(WorkerOrder::Calibrate));
    let open = |adapter: &AdapterChoice| {
        let opened = Instant::now();
        let leave = host.open_window(&mut first, adapter, settings.as_ref())?;
        Ok((leave, opened.elapsed()))
    };
    let tell = |kind, text| host.worker.send(WorkerOrder::Report(kind, text));
    let ended = keep_open(adapter, open, tell);
    // The last window has written the settings, and nothing else would report their loss.
    if let Some(text) = settings.as_ref().and_then(SettingsFile::close) {
        tracing::error!("{text}");
    }
    match ended {
        // After a crash of training the window stayed open, and the user has closed it by now.
        Ok(()) => match host.worker.crash() {
            None => Ok(()),
            Some(crash) => Err(WindowError::Crashed(Box::new(crash))),
        },
        Err((error, ever_open)) if ever_open && !matches!(error, WindowError::Crashed(_)) => {
            Err(WindowError::Gone(Box::new(error), host.worker.store()))
        }
        Err((error, _)) => Err(error),
    }
}

struct Host {
    worker: Arc<Worker>,
    /// Waker of the current window. It is stored here because the training thread outlives windows.
    waker: Arc<WindowWaker>,
    shown: Arc<Mailbox<Option<String>>>,
    exit: RefCell<Exit>,
    started: Instant,
}

impl Host {
    fn new(started: Instant) -> std::io::Result<Self> {
        let waker = Arc::new(WindowWaker::default());
        let worker = Arc::new(Worker::start(waker.waker().clone())?);
        Ok(Self { worker, waker, shown: Arc::default(), exit: RefCell::default(), started })
    }

    /// Opens one window and returns when it closes. When opened, the window sends the orders in `first` to
    /// the worker. On success, `first` then contains the orders for the next window.
    fn open_window(
        &self,
        first: &mut Vec<WorkerOrder>,
        adapter: &AdapterChoice,
        settings: Option<&SettingsFile>,
    ) -> Result<ExitReason, WindowError> {
        let exit = self.exit.borrow().for_next_window();
        self.exit.replace(exit.clone());
        let (word, worker, waker) = (exit.clone(), self.worker.clone(), self.waker.clone());
        let (started, shown) = (self.started, self.shown.clone());
        // Cloned, not taken, because a window that fails to open has sent none of them.
        let orders = first.clone();
        let create = move |creation: &eframe::CreationContext<'_>| {
            waker.open(creation.egui_ctx.clone());
            report_caveat(creation, &worker, &shown);
            let studio = Studio::attach(creation, worker, orders, word, Painting::Auto, started)?;
            Ok(Box::new(studio) as Box<dyn eframe::App>)
        };
        // All windows run on this thread: winit allows one event loop per process, which eframe stores
        // per thread and reuses.
        let ended = run_window(&self.worker, &exit, || native_options(adapter, settings), create);
        // Closed after an error too, because the waker must not hold the context of a closed window.
        self.waker.close();
        ended?;
        // For the next window everything is open; it lacks only the splats.
        *first = vec![WorkerOrder::Deliver];
        Ok(exit.reason.get())
    }
}

fn report_caveat(
    creation: &eframe::CreationContext<'_>,
    worker: &Worker,
    shown: &Mailbox<Option<String>>,
) {
    let caveat = creation.wgpu_render_state.as_ref().and_then(viewport::caveat);
    // An earlier session has shown it.
    let known = creation.storage.and_then(|storage| storage.get_string(settings_file::CAVEAT));
    // After a lost device the same adapter is used, and its caveat was already reported.
    if let Some(text) = caveat.clone().filter(|_| shown.get() != caveat && known != caveat) {
        worker.send(WorkerOrder::Report(NoticeKind::Info, text));
    }
    shown.set(caveat);
}

const ICON: &[u8] = include_bytes!("../../assets/icon.png");

fn native_options(
    adapter: &AdapterChoice,
    settings: Option<&SettingsFile>,
) -> eframe::NativeOptions {
    eframe::NativeOptions {
        viewport: ViewportBuilder::default()
            .with_title("VBGS Studio")
            .with_app_id("vbgs-studio")
            // Without a readable icon the window opens all the same.
            .with_icon(eframe::icon_data::from_png_bytes(ICON).unwrap_or_default())
            .with_inner_size(Vec2::new(1280.0, 800.0))
            .with_min_inner_size(Vec2::new(640.0, 400.0))
            .with_drag_and_drop(true),
        // The studio searches the system's fonts itself, without waiting for their files.
        system_font_fallback: false,
        wgpu_options: viewport::wgpu_configuration(adapter),
        persistence_path: settings.map(|settings| settings.path().to_owned()),
        ..Default::default()
    }
}

/// True if an environment variable names a display server. Always true on platforms without X11 and
/// Wayland.
fn has_display() -> bool {
    let named = |variable: &str| std::env::var_os(variable).is_some_and(|v| !v.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || named("DISPLAY") || named("WAYLAND_DISPLAY")
}

const MAX_RUNS: usize = 3;

type Created = Result<Box<dyn App>, Box<dyn Error + Send + Sync>>;

/// Opens a window with `options` and runs the application that `create` returns until the window closes.
/// Panics are handled by [`run_guarded`].
///
/// A panic unwinds through winit's event loop and leaves it in a running state. The next run of the loop
/// only handles remaining events of the old window and returns without a window. The run after that creates
/// one.
///
/// # Errors
/// Those of [`run_guarded`], and an error if no run created a window.
pub fn run_window(
    worker: &Worker,
    exit: &Exit,
    options: impl Fn() -> NativeOptions,
    create: impl FnOnce(&CreationContext<'_>) -> Created,
) -> Result<(), WindowError> {
    let mut create = Some(create);
    for _ in 0..MAX_RUNS {
        let waiting = &mut create;
        let creator = move |context: &CreationContext<'_>| match waiting.take() {
            Some(create) => create(context),
            None => Err("one run of the event loop created two windows".into()),
        };
        let run = || Ok(eframe::run_native("vbgs-studio", options(), Box::new(creator))?);
        run_guarded(worker, exit, run)?;
        if create.is_none() {
            return Ok(());
        }
    }
    Err(WindowError::Window("the event loop ended before it created a window".to_owned()))
}

/// Runs `window` until the window closes, and catches its panics. A panic is not an error if `exit` records
/// a device loss: the caller then opens the next window. Any other panic is a bug. No window is then opened
/// again, because it could panic at the same place.
///
/// # Errors
/// [`WindowError::Crashed`] with the path of the stored run, or the error of `window`.
pub fn run_guarded(
    worker: &Worker,
    exit: &Exit,
    window: impl FnOnce() -> Result<(), WindowError>,
) -> Result<(), WindowError> {
    // Unwind safe: all state shared with the worker is written in single assignments.
    match catch_unwind(AssertUnwindSafe(window)) {
        Ok(ended) => ended,
        // The device cannot be polled here: it was dropped with the window, which polled it last
        // (`Studio::drop`).
        Err(_) if exit.reason.get() == ExitReason::DeviceLost => Ok(()),
        Err(payload) => Err(WindowError::Crashed(Box::new(Crash {
            thread: CrashedThread::Window,
            panic: PanicReport::of(&*payload),
            rescue: worker.store(),
        }))),
    }
}

/// Maximum duration of each wait in [`watch`]. The thread may run for that long after the worker is
/// dropped.
const POLL_INTERVAL: Duration = Duration::from_secs(10);

/// Starts a thread that waits for a request to end the program while the worker exists. `is_asked` waits
/// for at most the given time and returns true once there is such a request. Training is then stopped and
/// stored for the next session, and the window closes without a prompt.
pub fn watch(
    is_asked: impl Fn(Duration) -> bool + Send + 'static,
    worker: &Arc<Worker>,
) -> std::io::Result<()> {
    let worker = Arc::downgrade(worker);
    let watcher = std::thread::Builder::new().name("termination".into());
    watcher.spawn(move || {
        // The worker is not held meanwhile, because dropping it joins its thread.
        while worker.strong_count() > 0 {
            if is_asked(POLL_INTERVAL) {
                if let Some(worker) = worker.upgrade() {
                    // A notice, which is logged, states the outcome.
                    let _ = worker.store();
                }
                return;
            }
        }
    })?;
    Ok(())
}

#[derive(Debug, thiserror::Error)]
pub enum WindowError {
    #[error("no display found")]
    NoDisplay,
    /// The environment names a display server, but the server does not respond.
    #[error("the display server does not respond")]
    DisplaySilent,
    #[error("no usable graphics adapter found ({0})")]
    NoAdapter(String),
    #[error("the graphics device was lost {0} times in a row")]
    DeviceLost(usize),
    /// The window was lost and cannot be reopened. Holds the cause and the outcome of storing the run.
    #[error("the window was lost and cannot be reopened: {0}; {1}")]
    Gone(Box<WindowError>, Rescue),
    #[error(transparent)]
    Crashed(Box<Crash>),
    #[error("no window could be opened ({0})")]
    Window(String),
}

impl From<eframe::Error> for WindowError {
    fn from(error: eframe::Error) -> Self {
        match error {
            // `run` has checked before that a display is announced.
            eframe::Error::Winit(_) | eframe::Error::WinitEventLoop(_) => Self::DisplaySilent,
            eframe::Error::Wgpu(error) => Self::NoAdapter(error.to_string()),
            other => Self::Window(other.to_string()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Simulates windows that end as listed. Returns the adapters of the opened windows, the result and
    /// the number of notices.
    fn windows(
        first: &str,
        ends: Vec<Result<(ExitReason, Duration), WindowError>>,
    ) -> (Vec<String>, Result<(), bool>, usize) {
        let (mut asked, mut told) = (Vec::new(), 0);
        let mut ends = ends.into_iter();
        let open = |adapter: &AdapterChoice| {
            asked.push(adapter.to_string());
            ends.next().unwrap_or(Err(WindowError::NoDisplay))
        };
        let choice = AdapterChoice::parse(first);
        let ended = keep_open(choice, open, |_, _| told += 1).map_err(|(_, ever)| ever);
        (asked, ended, told)
    }

    fn lost(lived_s: u64) -> Result<(ExitReason, Duration), WindowError> {
        Ok((ExitReason::DeviceLost, Duration::from_secs(lived_s)))
    }

    fn closed() -> Result<(ExitReason, Duration), WindowError> {
        Ok((ExitReason::Closed, Duration::ZERO))
    }

    #[test]
    fn a_lost_window_is_opened_again_and_closing_ends_it() {
        assert_eq!(windows("auto", vec![lost(1), closed()]), (vec!["auto".into(); 2], Ok(()), 1));
        let many = (0..9).map(|_| lost(100)).chain([closed()]).collect();
        assert_eq!(windows("auto", many).0, vec!["auto"; 10], "each was well for a while");
    }

    #[test]
    fn losses_in_a_row_end_at_the_software_adapter_and_then_without_a_window() {
        let (asked, ended, told) = windows("rtx", (0..12).map(|_| lost(1)).collect());
        let expected: Vec<&str> =
            [["rtx"; 4], ["auto"; 4], ["software"; 4]].into_iter().flatten().collect();
        assert_eq!(
            (asked, ended, told),
            (expected.iter().map(|s| s.to_string()).collect(), Err(true), 11)
        );
    }

    #[test]
    fn a_crash_opens_no_window_again() {
        let crash = Crash {
            thread: CrashedThread::Window,
            panic: PanicReport { message: "boom".into(), place: None },
            rescue: Rescue::Nothing,
        };
        let crashed = Err(WindowError::Crashed(Box::new(crash)));
        let (asked, ended, told) = windows("auto", vec![lost(1), crashed, closed()]);
        assert_eq!((asked, ended, told), (vec!["auto".into(); 2], Err(true), 1));
    }

    #[test]
    fn another_adapter_is_opened_and_left_again_if_it_fails() {
        let chosen = Ok((ExitReason::Adapter(AdapterChoice::Index(7)), Duration::ZERO));
        let (asked, ended, told) =
            windows("auto", vec![chosen, Err(WindowError::NoDisplay), closed()]);
        assert_eq!(
            (asked, ended, told),
            (vec!["auto".into(), "7".into(), "auto".into()], Ok(()), 1)
        );
        for (first, expected) in [("auto", vec!["auto"]), ("software", vec!["software", "auto"])] {
            let (asked, ended, _) = windows(first, Vec::new());
            assert_eq!(
                (asked, ended),
                (expected.iter().map(|s| s.to_string()).collect(), Err(false))
            );
        }
    }
}
