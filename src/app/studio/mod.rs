//! The application: assembles the panels and turns their requests into orders for the worker.

mod command_line;
mod commands;
mod dialogs;
mod dock;
mod film_tools;
mod frames;
mod shell;
mod side_panel;

use super::drawing::{Painting, PassTimes, WindowWaker};
use super::fonts::{SystemFonts, add_icons};
use super::layout::{SideTab, WindowLayout};
use super::opening::FileProposal;
use super::panels::menus::{BarAnswer, MenuContext};
use super::panels::notices::NoticeBoard;
use super::panels::quality::QualityPlot;
use super::panels::signal_color::strengthen_text;
use super::panels::summary::SummaryRender;
use super::panels::{status, summary, transport};
use super::quality::QualityMonitor;
use super::settings_file::StoredSettings;
use super::state::{NoticeKind, Opened, RunState, Snapshot};
use super::training::TrainSettings;
use super::user_folders::RecentPaths;
use super::viewer::SceneView;
use super::viewer::comparison::ComparedModel;
use super::viewer::painter::ViewPainter;
use super::viewport::WindowDevice;
use super::window::{Exit, ExitReason, Handover};
use super::worker::{Worker, WorkerOrder};
use super::{settings_file, viewport};
use crate::render::Lens;
use crate::render::attributes::Attribute;
use dialogs::{Dialogs, UnsavedWork};
use eframe::egui::{CentralPanel, Color32, Context, Frame, Panel, Ui, Visuals};
use film_tools::FilmTools;
use frames::FrameStripState;
use glam::DVec3;
use shell::{Shell, drop_target};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// State of the window. The trainer has its own state on another thread.
pub struct Studio {
    worker: Arc<Worker>,
    shell: Shell,
    view: SceneView,
    quality: QualityMonitor,
    training: TrainSettings,
    /// Component attribute that was requested from the worker.
    requested_attribute: Option<Attribute>,
    layout: WindowLayout,
    panels: PanelStates,
    recent: RecentPaths,
    film: FilmTools,
    dialogs: Dialogs,
    unsaved: UnsavedWork,
    fonts: SystemFonts,
    timing: Timing,
}

/// State of panels that is kept between egui passes.
#[derive(Default)]
struct PanelStates {
    strip: FrameStripState,
    quality_plot: QualityPlot,
    notices: NoticeBoard,
    summary: SummaryRender,
    /// Serial number of what is open, its path, and the settings with which it was opened.
    applied: Option<(u64, Option<PathBuf>, TrainSettings)>,
    /// Scene before a retraining, which is compared with the next one, and the files of its dataset.
    before_retrain: Option<(FileProposal, ComparedModel)>,
    /// Autosave slot of the interrupted run that the user declined to continue ("Later").
    postponed_slot: Option<PathBuf>,
}

struct Timing {
    started: Instant,
    first_splats_logged: bool,
    passes: PassTimes,
}

impl Studio {
    /// Creates the application for a worker that may already be training, and sends the orders in `first`
    /// to it. `exit` receives the reason why the window closes.
    pub fn attach(
        context: &eframe::CreationContext<'_>,
        worker: Arc<Worker>,
        first: Vec<WorkerOrder>,
        exit: Exit,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        // Orders go first, so that the trainer works while the GPU is initialised.
        let StoredSettings { view, mut training, recent, layout, problems } =
            StoredSettings::read(|part| context.storage?.get_string(part));
        // The stored one belongs to the dataset that was open last.
        training.scene.scale = None;
        // Settings before everything else, since they apply to datasets opened after them.
        worker.send(WorkerOrder::TrainBy(Box::new(training.clone())));
        let warn = |problem| WorkerOrder::Report(NoticeKind::Warning, problem);
        first
            .into_iter()
            .chain(problems.into_iter().map(warn))
            .for_each(|order| worker.send(order));
        strengthen_text(&context.egui_ctx);
        add_icons(&context.egui_ctx);
        let fonts = SystemFonts::default();
        fonts.watch(&context.egui_ctx);
        let waker = WindowWaker::of(&context.egui_ctx);
        let device = context.wgpu_render_state.as_ref().map(WindowDevice::new);
        let (painter, adapter) = ViewPainter::choose(device.as_ref(), painting, waker.waker())?;
        let shell = Shell::new(context.egui_ctx.clone(), waker, device, adapter, exit);
        let mut view = shell.scene_view(painter, view);
        view.past_folders = worker.folders().clone();
        worker.set_interval(view.painter.snapshot_interval());
        // The previous window may have requested another attribute.
        worker.send(WorkerOrder::Watch(None));
        let mut film = FilmTools::default();
        if let Some(Handover { view: kept, path }) = shell.exit.handover.take() {
            view.restore_retained_state(kept);
            film.path = path;
        }
        Ok(Self {
            quality: QualityMonitor::new(shell.waker().clone()),
            worker,
            shell,
            view,
            training,
            requested_attribute: None,
            layout,
            panels: PanelStates::default(),
            recent,
            film,
            dialogs: Dialogs::default(),
            unsaved: UnsavedWork::default(),
            fonts,
            timing: Timing { started, first_splats_logged: false, passes: PassTimes::default() },
        })
    }

    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.worker.snapshot()
    }

    pub fn n_drawn(&self) -> usize {
        self.view.painter.n_drawn()
    }

    pub fn view(&self) -> &SceneView {
        &self.view
    }

    pub fn quality(&self) -> &QualityMonitor {
        &self.quality
    }

    pub fn exit(&self) -> &Exit {
        &self.shell.exit
    }

    /// Closes the window without confirmation. The run continues in the next window.
    fn close_window(&mut self, why: ExitReason) {
        self.shell.exit.reason.set(why);
        // No confirmation: unsaved training continues in the next window.
        self.unsaved.close(&self.shell.egui);
    }

    /// Stores the user's state for the next window, and warns about a film that cannot continue.
    fn hand_over(&mut self) {
        if let Some(output) = self.film.thread.output() {
            let text = format!(
                "{}: the film was not finished, because the window that rendered it was closed; render it again",
                output.display()
            );
            self.report(NoticeKind::Warning, text);
        }
        let mut path = std::mem::take(&mut self.film.path);
        path.is_playing = false;
        let handover = Handover { view: self.view.take_retained_state(), path };
        self.shell.exit.handover.set(Some(handover));
    }

    /// Draws everything except dialogs.
    fn draw_panels(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
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
            Some(BarAnswer::Action(action)) => self.apply_action(action, snapshot),
            Some(BarAnswer::Open(path)) => self.open_path(path, snapshot),
            Some(BarAnswer::Retrain) => self.retrain(snapshot),
        }
        let postponed = self.panels.postponed_slot.as_ref();
        if let Some(run) =
            snapshot.files.abandoned.as_ref().filter(|run| postponed != Some(&run.slot))
        {
            let answer =
                Panel::top("abandoned").frame(frame).show(ui, |ui| status::abandoned(run, ui));
            self.handle_abandoned_answer(run, answer.inner, snapshot);
        }
        if snapshot.state == RunState::Training {
            // A trainer that waits for a drive does not wake the window.
            ui.ctx().request_repaint_after(Duration::from_secs(1));
        }
        let surroundings = status::StatusContext {
            adapter: &self.shell.renderer(self.view.painter.gpu_failed),
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
        let (strip, shows) = (&mut self.panels.strip, self.layout.shows_frames);
        let run = (snapshot, self.worker.trained_thumbnails());
        strip.ui(&mut self.view, &self.quality, shows, frame, run, ui);
        // The central panel comes last: egui gives it the room left by the others.
        let central = CentralPanel::default().frame(Frame::NONE);
        central.show(ui, |ui| dock::tiles(self, ui, frame, snapshot));
    }

    fn transport(&mut self, ui: &mut Ui, snapshot: &Snapshot) -> Option<BarAnswer> {
        let mut scale = self.training.scene.scale;
        let menu = MenuContext {
            recent: self.recent.paths(),
            why_not: &|action| self.unavailable_reason(action, snapshot),
            is_on: &|command| self.is_on(command, snapshot),
        };
        let asked = transport::ui(snapshot, &menu, &mut scale, ui);
        if scale != self.training.scene.scale {
            self.training.scene.scale = scale;
            self.send_training(snapshot);
        }
        asked
    }

    /// Prepares view and file dialogs for a newly opened dataset or model.
    fn switch_to(&mut self, opened: &Opened) {
        if let Some(path) = opened.path.as_ref().filter(|_| self.view.is_another(opened)) {
            self.recent.note(path);
        }
        if self.panels.applied.as_ref().is_none_or(|(serial, ..)| *serial != opened.serial) {
            // The worker has chosen the scale in the same way.
            if self.panels.applied.as_ref().is_some_and(|(_, path, _)| *path != opened.path) {
                self.training = self.training.for_dataset(opened.path.as_deref());
                self.apply_training();
            }
            let applied = (opened.serial, opened.path.clone(), self.training.clone());
            self.panels.applied = Some(applied);
        }
        let is_another = self.view.is_another(opened);
        if let Some(lost) = self.view.reset_for_subject(opened) {
            self.report(NoticeKind::Warning, lost);
        }
        if is_another
            && let Some((_, before)) =
                self.panels.before_retrain.take().filter(|(files, _)| *files == opened.files)
        {
            self.view.comparison.show_model(before);
        }
        self.dialogs.propose(opened);
    }

    /// Draws the viewport, or the start page if nothing is open. Notices cover the top `noticed` points
    /// of the viewport.
    fn central_view(&mut self, ui: &mut Ui, snapshot: &Snapshot, noticed: f32) {
        // Taken even if nothing is drawn: the worker sends the next update only after this one.
        for update in self.worker.splat_updates().take() {
            self.quality.change(&update.change);
            self.view.apply_update(update);
        }
        if snapshot.opened.is_none() {
            if let Some(command) = summary::start(snapshot, noticed, ui) {
                self.apply_command(command, snapshot);
            }
            return;
        }
        let opened = snapshot.opened.as_ref();
        let place = opened.map(|opened| (opened.home.up, opened.local_origin));
        let (up, origin) = place.unwrap_or((DVec3::Z, DVec3::ZERO));
        for (kind, text) in self.view.take_compared(up, origin) {
            if kind == NoticeKind::Error {
                self.dialogs.compare.show_problem(text.clone());
            }
            self.report(kind, text);
        }
        self.film.play(&mut self.view, ui);
        // While it plays, the view shows the film.
        let shows_path = self.layout.is_active(SideTab::Path) && !self.film.path.is_playing;
        self.view.overlays.path = shows_path.then(|| self.film.path.clone());
        if let Some(message) = self.view.ui(ui, snapshot) {
            self.report(NoticeKind::Error, message);
        }
        if let Some(problem) = self.view.editor.take_past_problem() {
            self.report(NoticeKind::Warning, problem);
        }
        let settings = &self.view.settings;
        // Quality is measured at dataset cameras, which are pinhole cameras.
        let method = settings.method(settings.renderer, Lens::Pinhole);
        let (every, splats) = (settings.panels.quality_every, self.view.learned());
        let past = self.view.editor().stored_scenes.moments();
        if self.view.camera.is_moving() {
            self.quality.hold(ui.ctx());
        }
        self.quality.update(ui.ctx(), snapshot, method, every, (splats, past));
        if let Some((serial, curves)) = self.quality.take_new_curves() {
            self.worker.send(WorkerOrder::RecordCurves(serial, curves));
        }
        self.request_attributes();
        if let Some(registration) = self.view.overlays.measure.take_registration() {
            self.worker.send(WorkerOrder::Register(registration));
        }
        if let Some(picked) = self.view.take_picked() {
            self.worker.send(WorkerOrder::Inspect(picked));
            // A click next to the splats deselects, which is no reason to switch tabs.
            let is_editing = self.layout.is_active(SideTab::Edit);
            if picked.is_some() && !is_editing && !self.view.overlays.is_measuring() {
                self.layout.activate(SideTab::Inspector);
            }
        }
        if !self.timing.first_splats_logged && self.view.painter.n_drawn() > 0 {
            self.timing.first_splats_logged = true;
            // Read by the test of the start-up time (`tests/app/window.rs`).
            tracing::info!(
                "first splats visible after {} ms",
                self.timing.started.elapsed().as_millis()
            );
        }
    }
}

impl Drop for Studio {
    fn drop(&mut self) {
        self.shell.record_lost_device();
        if self.shell.exit.reason.get() != ExitReason::Closed {
            self.hand_over();
        }
    }
}

impl eframe::App for Studio {
    fn clear_color(&self, visuals: &Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        let adapter = match self.shell.exit.reason.get() {
            ExitReason::Adapter(chosen) => Some(chosen),
            ExitReason::Closed | ExitReason::DeviceLost => None,
        };
        StoredSettings::write(
            storage,
            &self.view.settings,
            &self.training,
            &self.recent,
            &self.layout,
            adapter.as_ref(),
        );
        let caveat = self.shell.device.as_ref().and_then(|device| viewport::caveat(&device.state));
        // Also without a caveat: the stored one may be of an earlier adapter.
        storage.set_string(settings_file::CAVEAT, caveat.unwrap_or_default());
    }

    /// Runs before every pass of [`ui`](eframe::App::ui). While the window is hidden or minimised, it
    /// runs without `ui`.
    fn logic(&mut self, ctx: &Context, _: &mut eframe::Frame) {
        // Here, since eframe closes a hidden window without a pass of `ui`.
        let snapshot = self.worker.snapshot();
        std::thread::sleep(self.view.begin_pass(snapshot.state));
        self.timing.passes.begin(snapshot.state);
        // Another renderer may have taken over since the last pass.
        self.worker.set_interval(self.view.painter.snapshot_interval());
        self.unsaved.handle_close_request(ctx, &snapshot);
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        if self.shell.device.as_ref().is_some_and(WindowDevice::is_lost) {
            // Drawing with a lost device panics, even in egui.
            self.close_window(ExitReason::DeviceLost);
            return;
        }
        self.report_faults();
        // One snapshot for the whole pass, so that shortcuts, panels and dialogs act on the same state.
        let snapshot = self.worker.snapshot();
        if let Some(opened) = &snapshot.opened {
            self.switch_to(opened);
        }
        self.shell.update_title(&snapshot);
        self.handle_dropped_files(ui, &snapshot);
        // Handled before the dialogs: otherwise the Escape that closes a dialog would also clear the
        // selection.
        self.handle_shortcuts(ui, &snapshot);
        self.draw_panels(ui, &snapshot);
        self.show_dialogs(ui, &snapshot);
        drop_target(ui.ctx());
        // After all texts of this pass.
        if let Some(text) = self.fonts.update(ui.ctx(), self.shell.waker()) {
            self.report(NoticeKind::Info, text);
        }
        self.timing.passes.end(self.timing.started);
    }
}
