//! The application: puts panels together and turns what they answer into orders.

mod commands;
mod files;
mod side_panel;

use super::command::UiCommand;
use super::device::WindowDevice;
use super::drawing::Drawer;
use super::drop_target;
use super::exit::{Exit, Leave};
use super::painting::Painting;
use super::panels::{abandoned, notices, status, transport};
use super::path_dialog::PathDialog;
use super::pending::Pending;
use super::persistence::{self, StoredSettings};
use super::state::{NoticeKind, Opened, RunState, Snapshot, Subject};
use super::training::TrainSettings;
use super::viewer::painter::ViewPainter;
use super::viewer::{SceneView, toolbar};
use super::worker::{Waker, Worker, WorkerOrder};
use crate::export::endings::{READ_ENDINGS, listed};
use crate::export::mapping::Mapping;
use crate::render::attributes::Attribute;
use eframe::egui::{
    CentralPanel, Color32, Context, Frame, Panel, RichText, Ui, ViewportCommand, Visuals,
};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Tabs of the side panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Tab {
    #[default]
    Latency,
    Scene,
    Inspector,
    Settings,
}

/// The application's state; the trainer's is on its own thread.
pub struct Studio {
    worker: Arc<Worker>,
    exit: Exit,
    device: Option<WindowDevice>,
    waker: Waker,
    view: SceneView,
    training: TrainSettings,
    /// What the worker was asked to tell of components.
    watched: Option<Attribute>,
    adapter: String,
    tab: Tab,
    open_dialog: PathDialog,
    save_dialog: PathDialog,
    export_dialog: PathDialog,
    mapping: Mapping,
    help_is_open: bool,
    /// What waits for the user or a file.
    pending: Option<Pending>,
    may_close: bool,
    dismissed: u64,
    /// File of the abandoned run that the user does not want to be asked about now.
    put_off: Option<PathBuf>,
    started: Instant,
    first_splats_logged: bool,
}

/// Shortest time between two snapshots on a real GPU, and where the CPU draws the window too.
const GPU_INTERVAL: Duration = Duration::from_millis(33);
const SOFTWARE_INTERVAL: Duration = Duration::from_millis(500);

impl Studio {
    /// Builds the application on eframe's context and opens `subject`, if there is one.
    pub fn new(
        context: &eframe::CreationContext<'_>,
        subject: Option<Subject>,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        let egui = context.egui_ctx.clone();
        let worker = Arc::new(Worker::start(Arc::new(move || egui.request_repaint()))?);
        let first = subject.map_or(WorkerOrder::Deliver, WorkerOrder::Open);
        Self::attach(context, worker, vec![first], Exit::default(), painting, started)
    }

    /// Builds the application on a run that may be under way and gives the `first` orders; `exit`
    /// learns why the window ends.
    pub fn attach(
        context: &eframe::CreationContext<'_>,
        worker: Arc<Worker>,
        first: Vec<WorkerOrder>,
        exit: Exit,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        // The trainer begins while the GPU is made ready.
        let StoredSettings { view, training, problems } = StoredSettings::read(context.storage);
        // Settings go first, since they hold for what is opened after them.
        worker.send(WorkerOrder::TrainBy(Box::new(training.clone())));
        first.into_iter().for_each(|order| worker.send(order));
        for problem in problems {
            worker.send(WorkerOrder::Report(NoticeKind::Warning, problem));
        }
        let egui = context.egui_ctx.clone();
        let waker: Waker = Arc::new(move || egui.request_repaint());
        let device = context.wgpu_render_state.as_ref().map(WindowDevice::new);
        let (painter, adapter) = ViewPainter::choose(device.as_ref(), painting, &waker)?;
        let on_cpu = painter.drawer() == Drawer::Cpu;
        // Every snapshot repaints the window, which a software adapter does on the cores that train
        // (`rendering.md`, Software adapters).
        worker.set_interval(if on_cpu { SOFTWARE_INTERVAL } else { GPU_INTERVAL });
        // The window before may have coloured the scene otherwise.
        worker.send(WorkerOrder::Watch(None));
        Ok(Self {
            worker,
            exit,
            device,
            watched: None,
            view: SceneView::new(painter, view, waker.clone()),
            training,
            waker,
            adapter,
            tab: Tab::default(),
            open_dialog: PathDialog::open(),
            save_dialog: PathDialog::save(),
            export_dialog: PathDialog::export(),
            mapping: Mapping::default(),
            help_is_open: false,
            pending: None,
            may_close: false,
            dismissed: 0,
            put_off: None,
            started,
            first_splats_logged: false,
        })
    }

    /// The newest snapshot of the run.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.worker.snapshot()
    }

    /// Splats in the picture on screen.
    pub fn n_drawn(&self) -> usize {
        self.view.n_drawn()
    }

    /// The central view.
    pub fn view(&self) -> &SceneView {
        &self.view
    }

    /// Why the window ends, if it does.
    pub fn exit(&self) -> &Exit {
        &self.exit
    }

    /// Ends the window, not the run.
    fn leave(&mut self, why: Leave, context: &Context) {
        self.exit.leave(why);
        // Nothing is asked about unsaved training: it goes on in the next window.
        self.may_close = true;
        context.send_viewport_cmd(ViewportCommand::Close);
    }

    /// Everything in the window but questions.
    fn panels(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        // The window is cleared to the panels' colour, so nothing is filled twice: one fill of the
        // window costs 66 ms of processor time on a software adapter (1280×800, llvmpipe).
        let frame = Frame::side_top_panel(ui.style()).fill(Color32::TRANSPARENT);
        let asked = Panel::top("transport").frame(frame).show(ui, |ui| {
            ui.add_space(3.0);
            let asked = transport::ui(snapshot, ui);
            ui.add_space(3.0);
            asked
        });
        if let Some(command) = asked.inner {
            self.apply_command(command, snapshot);
        }
        if let Some(run) = snapshot.abandoned.as_ref().filter(|run| !self.is_put_off(run)) {
            let answer = Panel::top("abandoned").frame(frame).show(ui, |ui| abandoned::ui(run, ui));
            self.answer_abandoned(run, answer.inner, snapshot);
        }
        let surroundings = status::StatusContext {
            adapter: &self.adapter,
            n_drawn: self.view.n_drawn(),
            file_progress: self.worker.file_progress(),
        };
        let cancelled = Panel::bottom("status")
            .frame(frame)
            .show(ui, |ui| status::ui(snapshot, &surroundings, ui));
        if cancelled.inner {
            self.worker.cancel_file();
        }
        Panel::right("panels")
            .default_size(340.0)
            .size_range(240.0..=640.0)
            .frame(frame)
            .show(ui, |ui| self.side_panel(ui, snapshot));
        if let Some(opened) = &snapshot.opened {
            let asked = Panel::top("viewport bar").frame(frame).show(ui, |ui| {
                ui.add_space(2.0);
                let asked = toolbar::ui(&mut self.view, snapshot, opened, ui);
                ui.add_space(2.0);
                asked
            });
            if let Some(command) = asked.inner {
                self.apply_command(command, snapshot);
            }
        }
        // The last panel: egui gives it the room that those before have left.
        CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            self.central_view(ui, snapshot);
            self.dismissed = notices::ui(snapshot, self.dismissed, ui);
        });
    }

    /// Nothing is shown of what was open before: neither its cameras nor its names for files.
    fn turn_to(&mut self, opened: &Opened) {
        self.view.turn_to(opened);
        self.save_dialog.propose(opened.serial, &opened.files);
        self.export_dialog.propose(opened.serial, &opened.files);
    }

    fn central_view(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        // Taken even if nothing is drawn of it: the worker makes the next update
        // when this one is gone.
        for update in self.worker.splat_updates().take() {
            self.view.change(update);
        }
        if snapshot.opened.is_none() && snapshot.state != RunState::Loading {
            self.empty_view(ui, snapshot);
            return;
        }
        if let Some(message) = self.view.ui(ui, snapshot) {
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, message));
        }
        // Asked after the view was drawn, which leaves modes that this scene cannot show.
        let watched = self.view.settings.color_mode.attribute();
        if watched != self.watched {
            self.watched = watched;
            self.worker.send(WorkerOrder::Watch(watched));
        }
        if let Some(picked) = self.view.take_picked() {
            self.worker.send(WorkerOrder::Inspect(picked));
            // A click beside every splat deselects, which is no reason to turn to another tab.
            if picked.is_some() {
                self.tab = Tab::Inspector;
            }
        }
        if !self.first_splats_logged && self.view.n_drawn() > 0 {
            self.first_splats_logged = true;
            // The test of the start-up time reads this line (`tests/app/window.rs`).
            tracing::info!("first splats visible after {} ms", self.started.elapsed().as_millis());
        }
    }

    /// Shown while nothing is open.
    fn empty_view(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        ui.vertical_centered(|ui| {
            ui.add_space(ui.available_height() * 0.35);
            if let Some(followed) = &snapshot.followed {
                let path = followed.path.display();
                let waits = format!("Waiting for the first frame of {path}");
                ui.label(RichText::new(waits).size(22.0));
                ui.label(followed.problem.as_deref().unwrap_or_default());
                return;
            }
            ui.label(RichText::new("Drop a dataset folder here").size(22.0));
            let endings = listed(&READ_ENDINGS);
            ui.label(format!("a checkpoint to go on with, or splats to look at ({endings})"));
            ui.add_space(12.0);
            if ui.button(UiCommand::Open.label()).clicked() {
                self.apply_command(UiCommand::Open, snapshot);
            }
            if ui.button("Try the synthetic scene").clicked() {
                self.apply_command(UiCommand::OpenDemo, snapshot);
            }
        });
    }
}

impl Drop for Studio {
    /// egui panics where a lost device gives it no memory to write to. Whether that is so is asked
    /// here, on the way out, since the device must not outlive the display that it draws on.
    fn drop(&mut self) {
        let Some(device) = self.device.as_ref().filter(|_| std::thread::panicking()) else {
            return;
        };
        // A device that cannot even be asked is none any more.
        if catch_unwind(AssertUnwindSafe(|| device.is_lost())).unwrap_or(true) {
            self.exit.leave(Leave::DeviceLost);
        }
    }
}

impl eframe::App for Studio {
    fn clear_color(&self, visuals: &Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        persistence::write(storage, &self.view.settings, &self.training);
    }

    /// Runs before every pass of [`ui`](eframe::App::ui), and alone while the window is hidden or minimised.
    fn logic(&mut self, ctx: &Context, _: &mut eframe::Frame) {
        // Here, since eframe closes a hidden window without a pass of `ui`.
        let snapshot = self.worker.snapshot();
        self.take_close_request(ctx, &snapshot);
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        if self.device.as_ref().is_some_and(WindowDevice::is_lost) {
            // Nothing may be drawn any more, not even by egui, or it panics.
            self.leave(Leave::DeviceLost, ui.ctx());
            return;
        }
        self.report_faults();
        // One snapshot for the whole pass, so that keys, panels and questions
        // judge by the same state.
        let snapshot = self.worker.snapshot();
        if let Some(opened) = &snapshot.opened {
            self.turn_to(opened);
        }
        self.take_dropped(ui, &snapshot);
        // Before the dialogs: the Escape that closes one would else find it closed and deselect.
        self.take_keys(ui, &snapshot);
        self.panels(ui, &snapshot);
        self.dialogs(ui, &snapshot);
        drop_target::show(ui.ctx());
    }
}
