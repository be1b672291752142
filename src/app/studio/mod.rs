//! The application: assembles the panels and turns their requests into orders for the worker.

mod commands;
mod dock;
mod files;
mod frames;
mod side_panel;

use super::action_finder::ActionFinder;
use super::drawing::{Painting, ViewRenderer, WindowWaker};
use super::exit::{Exit, ExitReason, Handover};
use super::film::{FilmThread, StillJob};
use super::layout::{SideTab, WindowLayout};
use super::opening::Pending;
use super::panels::menus::{MenuAnswer, MenuContext};
use super::panels::notices::NoticeBoard;
use super::panels::quality::QualityPlot;
use super::panels::signal_color::SignalColor;
use super::panels::transport::TransportAnswer;
use super::panels::{ready, status, transport};
use super::pass_times::PassTimes;
use super::path_dialog::PathDialog;
use super::path_editor::PathEditor;
use super::persistence::StoredSettings;
use super::quality::QualityMonitor;
use super::state::{NoticeKind, Opened, RunState, Snapshot, Subject};
use super::training::TrainSettings;
use super::user_folders::RecentPaths;
use super::viewer::SceneView;
use super::viewer::painter::ViewPainter;
use super::viewer::settings::ViewSettings;
use super::viewport::WindowDevice;
use super::window_painter::WindowPainter;
use super::worker::{Waker, Worker, WorkerOrder};
use super::{persistence, viewport};
use crate::export::mapping::Mapping;
use crate::render::Lens;
use crate::render::attributes::Attribute;
use eframe::egui::{
    Align2, CentralPanel, Color32, Context, FontId, Frame, Id, LayerId, Order, Panel, Theme, Ui,
    ViewportCommand, Visuals,
};
use frames::FrameStripState;
use glam::DVec3;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// State of the window; the trainer's state is on its own thread.
pub struct Studio {
    worker: Arc<Worker>,
    exit: Exit,
    device: Option<WindowDevice>,
    /// Wakes this window from other threads; inactive once the window is dropped.
    window_waker: WindowWaker,
    egui: Context,
    view: SceneView,
    quality: QualityMonitor,
    quality_plot: QualityPlot,
    /// Serial of the run whose summary card was closed.
    closed_summary_serial: u64,
    training: TrainSettings,
    /// Component attribute requested from the worker.
    requested_attribute: Option<Attribute>,
    adapter: String,
    layout: WindowLayout,
    strip: FrameStripState,
    path: PathEditor,
    /// True if the view shows a moment of the playing path.
    is_at_path_moment: bool,
    finder: ActionFinder,
    open_dialog: PathDialog,
    compare_dialog: PathDialog,
    save_dialog: PathDialog,
    export_dialog: PathDialog,
    film_dialog: PathDialog,
    film: FilmThread,
    still: StillJob,
    mapping: Mapping,
    help_is_open: bool,
    /// Action that waits for the user or a file.
    pending: Option<Pending>,
    may_close: bool,
    notices: NoticeBoard,
    recent: RecentPaths,
    /// Current title, to send only changes.
    title: String,
    /// Slot of the abandoned run for which the user chose "Not now".
    postponed_slot: Option<PathBuf>,
    started: Instant,
    first_splats_logged: bool,
    passes: PassTimes,
}

impl Studio {
    /// Creates the application with a new worker and opens `subject`, if given.
    pub fn new(
        context: &eframe::CreationContext<'_>,
        subject: Option<Subject>,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        let window = context.egui_ctx.clone();
        let worker = Arc::new(Worker::start(Arc::new(move || window.request_repaint()))?);
        let first = subject.map_or(WorkerOrder::Deliver, WorkerOrder::Open);
        Self::attach(context, worker, vec![first], Exit::default(), painting, started)
    }

    /// Creates the application for a worker that may already be training, and sends the `first` orders. The
    /// reason why the window ends is recorded in `exit`.
    pub fn attach(
        context: &eframe::CreationContext<'_>,
        worker: Arc<Worker>,
        first: Vec<WorkerOrder>,
        exit: Exit,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        // Orders go first, so that the trainer works while the GPU is initialised.
        let StoredSettings { view, training, recent, layout, problems } =
            StoredSettings::read(|part| context.storage?.get_string(part));
        give_first_orders(&worker, &training, first, problems);
        strengthen_weak_text(&context.egui_ctx);
        let wakes = WindowWaker::of(&context.egui_ctx);
        let waker = wakes.waker();
        let device = context.wgpu_render_state.as_ref().map(WindowDevice::new);
        let (painter, adapter) = ViewPainter::choose(device.as_ref(), painting, waker)?;
        let mut view = scene_view(painter, view, (&context.egui_ctx, waker), device.as_ref());
        worker.set_interval(view.painter.snapshot_interval());
        // The previous window may have requested another attribute.
        worker.send(WorkerOrder::Watch(None));
        Ok(Self {
            path: take_over(&mut view, &exit),
            worker,
            exit,
            device,
            requested_attribute: None,
            view,
            training,
            quality: QualityMonitor::new(waker.clone()),
            quality_plot: QualityPlot::default(),
            closed_summary_serial: 0,
            window_waker: wakes,
            egui: context.egui_ctx.clone(),
            adapter,
            layout,
            strip: FrameStripState::default(),
            is_at_path_moment: false,
            finder: ActionFinder::default(),
            open_dialog: PathDialog::open(),
            compare_dialog: PathDialog::compare(),
            save_dialog: PathDialog::save(),
            export_dialog: PathDialog::export(),
            film_dialog: PathDialog::film(),
            film: FilmThread::default(),
            still: StillJob::default(),
            mapping: Mapping::default(),
            help_is_open: false,
            pending: None,
            may_close: false,
            notices: NoticeBoard::default(),
            recent,
            title: String::new(),
            postponed_slot: None,
            started,
            first_splats_logged: false,
            passes: PassTimes::default(),
        })
    }

    /// Latest snapshot of the run.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.worker.snapshot()
    }

    /// Number of splats drawn in the viewport.
    pub fn n_drawn(&self) -> usize {
        self.view.painter.n_drawn()
    }

    /// The viewport.
    pub fn view(&self) -> &SceneView {
        &self.view
    }

    /// Quality measurements of the open dataset.
    pub fn quality(&self) -> &QualityMonitor {
        &self.quality
    }

    /// Record of why the window ends.
    pub fn exit(&self) -> &Exit {
        &self.exit
    }

    /// Closes the window but not the run.
    fn close_window(&mut self, why: ExitReason, context: &Context) {
        self.exit.set_reason(why);
        // No confirmation: unsaved training continues in the next window.
        self.may_close = true;
        context.send_viewport_cmd(ViewportCommand::Close);
    }

    /// Stores the user's state for the next window; warns about a film that cannot continue.
    fn hand_over(&mut self) {
        if let Some(output) = self.film.output() {
            let text = format!(
                "{}: the film was not finished, because the window that rendered it was closed; render it again",
                output.display()
            );
            self.worker.send(WorkerOrder::Report(NoticeKind::Warning, text));
        }
        let mut path = std::mem::take(&mut self.path);
        path.is_playing = false;
        self.exit.hand_over(Handover { view: self.view.take_retained_state(), path });
    }

    /// Draws everything except dialogs.
    fn panels(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        // Transparent, since the window is cleared to the panels' colour: filling it again costs 66 ms of CPU
        // time on a software adapter (1280×800, llvmpipe).
        let frame = Frame::side_top_panel(ui.style()).fill(Color32::TRANSPARENT);
        let asked = Panel::top("transport").frame(frame).show(ui, |ui| {
            ui.add_space(3.0);
            let asked = self.transport(ui, snapshot);
            ui.add_space(3.0);
            asked
        });
        match asked.inner {
            None => {}
            Some(TransportAnswer::Command(command)) => self.apply_command(command, snapshot),
            Some(TransportAnswer::Menu(MenuAnswer::Action(action))) => {
                self.apply_action(action, snapshot);
            }
            Some(TransportAnswer::Menu(MenuAnswer::Open(path))) => self.open_path(path, snapshot),
            Some(TransportAnswer::Retrain) => self.retrain(snapshot),
        }
        if let Some(run) = snapshot.abandoned.as_ref().filter(|run| !self.is_postponed(run)) {
            let answer =
                Panel::top("abandoned").frame(frame).show(ui, |ui| status::abandoned(run, ui));
            self.handle_abandoned_answer(run, answer.inner, snapshot);
        }
        if snapshot.state == RunState::Training {
            // A trainer that waits for a drive does not wake the window.
            ui.ctx().request_repaint_after(Duration::from_secs(1));
        }
        let surroundings = status::StatusContext {
            adapter: &self.renderer_description(),
            n_drawn: self.view.painter.n_drawn(),
            file_progress: self.worker.file_progress(),
            slow_frame: self.worker.slow_frame(),
        };
        let unwanted = Panel::bottom("status")
            .frame(frame)
            .show(ui, |ui| status::ui(snapshot, &surroundings, ui));
        match unwanted.inner {
            Some(status::CancelRequest::File) => self.worker.cancel_file(),
            Some(status::CancelRequest::Opening) => self.worker.cancel_opening(),
            None => {}
        }
        self.frame_strip(ui, frame, snapshot);
        // The central panel comes last: egui gives it the room left by the others.
        CentralPanel::default().frame(Frame::NONE).show(ui, |ui| self.tiles(ui, frame, snapshot));
    }

    fn transport(&mut self, ui: &mut Ui, snapshot: &Snapshot) -> Option<TransportAnswer> {
        let mut scale = self.training.scene.scale;
        let menu = MenuContext {
            recent: self.recent.paths(),
            why_not: &|action| self.unavailable_reason(action, snapshot),
            is_on: &|command| self.is_on(command, snapshot),
        };
        let asked = transport::ui(snapshot, &menu, &mut scale, ui);
        if scale != self.training.scene.scale {
            self.training.scene.scale = scale;
            self.worker.send(WorkerOrder::TrainBy(Box::new(self.training.clone())));
        }
        asked
    }

    /// Updates the window title.
    fn update_title(&mut self, context: &Context, snapshot: &Snapshot) {
        let title = match &snapshot.opened {
            Some(opened) => format!("{} - VBGS Studio", opened.name),
            None => "VBGS Studio".to_owned(),
        };
        if title != self.title {
            context.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    /// Switches view and file dialogs to the open dataset or model.
    fn switch_to(&mut self, opened: &Opened) {
        if let Some(path) = opened.path.as_ref().filter(|_| self.view.is_another(opened)) {
            self.recent.note(path);
        }
        self.view.reset_for_subject(opened);
        self.save_dialog.propose(opened.serial, &opened.files);
        self.export_dialog.propose(opened.serial, &opened.files);
        self.film_dialog.propose(opened.serial, &opened.files);
    }

    /// Draws the viewport, or the start page if nothing is open, below `noticed` points of notices.
    fn central_view(&mut self, ui: &mut Ui, snapshot: &Snapshot, noticed: f32) {
        // Taken even if nothing is drawn: the worker sends the next update only after this one.
        for update in self.worker.splat_updates().take() {
            self.quality.change(&update.change);
            self.view.apply_update(update);
        }
        if snapshot.opened.is_none() {
            if let Some(command) = ready::start(snapshot, noticed, ui) {
                self.apply_command(command, snapshot);
            }
            return;
        }
        let origin = snapshot.opened.as_ref().map_or(DVec3::ZERO, |opened| opened.local_origin);
        for (kind, text) in self.view.take_compared(origin) {
            self.worker.send(WorkerOrder::Report(kind, text));
        }
        self.play_path(ui);
        if let Some(message) = self.view.ui(ui, snapshot) {
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, message));
        }
        let settings = &self.view.settings;
        let method = settings.method(settings.renderer, Lens::Pinhole);
        let (every, splats) = (settings.quality_every, self.view.learned());
        self.quality.update(ui.ctx(), snapshot, method, every, splats);
        self.cards(ui, snapshot, noticed);
        self.request_attributes();
        if let Some(picked) = self.view.take_picked() {
            self.worker.send(WorkerOrder::Inspect(picked));
            // A click next to the splats deselects, which is no reason to switch tabs.
            if picked.is_some() && !self.view.overlays.is_measuring() {
                self.layout.activate(SideTab::Inspector);
            }
        }
        if !self.first_splats_logged && self.view.painter.n_drawn() > 0 {
            self.first_splats_logged = true;
            // Read by the test of the start-up time (`tests/app/window.rs`).
            tracing::info!("first splats visible after {} ms", self.started.elapsed().as_millis());
        }
    }
}

impl Drop for Studio {
    /// After a device loss egui panics because it cannot allocate buffers. The loss is detected here, during
    /// unwinding, since the device must not outlive its display.
    fn drop(&mut self) {
        if let Some(device) = self.device.as_ref().filter(|_| std::thread::panicking())
            // A device that panics when polled is lost.
            && catch_unwind(AssertUnwindSafe(|| device.is_lost())).unwrap_or(true)
        {
            self.exit.set_reason(ExitReason::DeviceLost);
        }
        if self.exit.reason() != ExitReason::Closed {
            self.hand_over();
        }
    }
}

impl eframe::App for Studio {
    fn clear_color(&self, visuals: &Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        let adapter = match self.exit.reason() {
            ExitReason::Adapter(chosen) => Some(chosen),
            ExitReason::Closed | ExitReason::DeviceLost => None,
        };
        persistence::write(
            storage,
            &self.view.settings,
            &self.training,
            &self.recent,
            &self.layout,
            adapter.as_ref(),
        );
        let caveat = self.device.as_ref().and_then(|device| viewport::caveat(&device.state));
        storage.set_string(persistence::CAVEAT, caveat.unwrap_or_default());
    }

    /// Runs before every pass of [`ui`](eframe::App::ui), and alone while the window is hidden or minimised.
    fn logic(&mut self, ctx: &Context, _: &mut eframe::Frame) {
        // Here, since eframe closes a hidden window without a pass of `ui`.
        let snapshot = self.worker.snapshot();
        std::thread::sleep(self.view.begin_pass(snapshot.state));
        self.passes.begin(snapshot.state);
        self.worker.set_interval(self.view.painter.snapshot_interval());
        self.handle_close_request(ctx, &snapshot);
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        if self.device.as_ref().is_some_and(WindowDevice::is_lost) {
            // Drawing with a lost device panics, even in egui.
            self.close_window(ExitReason::DeviceLost, ui.ctx());
            return;
        }
        self.report_faults();
        // One snapshot for the whole pass, so that shortcuts, panels and dialogs act on the same state.
        let snapshot = self.worker.snapshot();
        if let Some(opened) = &snapshot.opened {
            self.switch_to(opened);
        }
        self.update_title(ui.ctx(), &snapshot);
        self.handle_dropped_files(ui, &snapshot);
        // Before the dialogs: otherwise the Escape that closes a dialog would also clear the selection.
        self.handle_shortcuts(ui, &snapshot);
        self.panels(ui, &snapshot);
        self.dialogs(ui, &snapshot);
        show(ui.ctx());
        self.passes.end(self.started);
    }
}

pub fn show(ctx: &Context) {
    if ctx.input(|i| i.raw.hovered_files.is_empty()) {
        return;
    }
    let painter = ctx.layer_painter(LayerId::new(Order::Foreground, Id::unique("drop target")));
    let rect = ctx.content_rect();
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(160));
    painter.text(
        rect.center(),
        Align2::CENTER_CENTER,
        "Drop to open",
        FontId::proportional(28.0),
        Color32::WHITE,
    );
}

/// Opacity of weak text.
const WEAK_TEXT: f32 = 0.8;

/// Sends the initial settings, orders and warnings about unreadable stored settings to the worker.
fn give_first_orders(
    worker: &Worker,
    training: &TrainSettings,
    first: Vec<WorkerOrder>,
    problems: Vec<String>,
) {
    // Settings go first, since they apply to datasets opened after them.
    worker.send(WorkerOrder::TrainBy(Box::new(training.clone())));
    first.into_iter().for_each(|order| worker.send(order));
    let warn = |problem| worker.send(WorkerOrder::Report(NoticeKind::Warning, problem));
    problems.into_iter().for_each(warn);
}

/// Creates the viewport. If the CPU draws although a GPU exists, a GPU failure is noted; without any GPU, the
/// CPU also draws the window.
fn scene_view(
    painter: ViewPainter,
    settings: ViewSettings,
    (window, waker): (&Context, &Waker),
    device: Option<&WindowDevice>,
) -> SceneView {
    let on_cpu = painter.drawer() == ViewRenderer::Cpu;
    let mut view = SceneView::new(painter, settings, waker.clone());
    if let Some(WindowDevice { state, .. }) = device.filter(|_| on_cpu) {
        if viewport::capabilities(state).is_software() {
            WindowPainter::install(window, state);
        } else {
            view.painter.note_gpu_failure();
        }
    }
    view
}

/// Restores the view handed over by the previous window, if any; returns its camera path.
fn take_over(view: &mut SceneView, exit: &Exit) -> PathEditor {
    let Some(Handover { view: kept, path }) = exit.take_handover() else {
        return Default::default();
    };
    view.restore_retained_state(kept);
    path
}

/// Raises the contrast of weak text and links, which egui draws too pale, above all on white.
fn strengthen_weak_text(context: &Context) {
    context.all_styles_mut(|style| style.visuals.weak_text_alpha = WEAK_TEXT);
    let link = SignalColor::Blue.for_theme(false);
    context.style_mut_of(Theme::Light, |style| style.visuals.hyperlink_color = link);
}
