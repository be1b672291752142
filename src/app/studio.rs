//! The application: puts panels together and turns what they answer into orders.

use super::adapter_memory;
use super::command::Command;
use super::device::Device;
use super::dialogs::{self, Decision, PathDialog};
use super::drawing::Drawer;
use super::drop_target;
use super::export_options;
use super::kept::{self, Kept};
use super::panels::{adapter, inspector, latency, notices, scene, settings, status, transport};
use super::state::{NoticeKind, RunState, Snapshot, Subject};
use super::training::TrainSettings;
use super::viewer::painter::Painter;
use super::viewer::{SceneView, toolbar};
use super::viewport::GpuPainter;
use super::window::{Exit, Leave};
use super::worker::{Order, Waker, Worker};
use crate::export::mapping::Mapping;
use crate::render::attributes::Attribute;
use eframe::egui::{
    CentralPanel, Color32, Context, FocusDirection, Frame, Key, Panel, RichText, Ui,
    ViewportCommand, Visuals,
};
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

/// Who draws the scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Painting {
    /// The GPU if it is a real one, else the CPU renderer, which is faster than a software GPU.
    Auto,
    /// The GPU whatever it is.
    Gpu,
}

/// What waits for the user's decision about unsaved training.
#[derive(Clone, Debug)]
enum Discarding {
    By(Order),
    Close,
}

/// The application's state; the trainer's is on its own thread.
pub struct Studio {
    worker: Arc<Worker>,
    exit: Exit,
    device: Option<Device>,
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
    discarding: Option<Discarding>,
    may_close: bool,
    dismissed: u64,
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
        let first = subject.map_or(Order::Deliver, Order::Open);
        Self::attach(context, worker, vec![first], Exit::default(), painting, started)
    }

    /// Builds the application on a run that may be under way and gives the `first` orders; `exit`
    /// learns why the window ends.
    pub fn attach(
        context: &eframe::CreationContext<'_>,
        worker: Arc<Worker>,
        first: Vec<Order>,
        exit: Exit,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        // The trainer begins while the GPU is made ready.
        let Kept { view, training, problems } = Kept::read(context.storage);
        worker.send(Order::TrainBy(Box::new(training.clone())));
        first.into_iter().for_each(|order| worker.send(order));
        for problem in problems {
            worker.send(Order::Report(NoticeKind::Warning, problem));
        }
        let egui = context.egui_ctx.clone();
        let waker: Waker = Arc::new(move || egui.request_repaint());
        let device = context.wgpu_render_state.as_ref().map(Device::new);
        let (painter, adapter) = Painter::choose(device.as_ref(), painting, &waker)?;
        let on_cpu = painter.drawer() == Drawer::Cpu;
        worker.set_interval(if on_cpu { SOFTWARE_INTERVAL } else { GPU_INTERVAL });
        // The window before may have coloured the scene otherwise.
        worker.send(Order::Watch(None));
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
            discarding: None,
            may_close: false,
            dismissed: 0,
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
        self.may_close = true;
        context.send_viewport_cmd(ViewportCommand::Close);
    }

    fn obey(&mut self, command: Command, snapshot: &Snapshot) {
        if !command.is_legal(snapshot.state, snapshot.source) {
            return;
        }
        match command {
            Command::Open => self.open_dialog.show(),
            Command::OpenDemo => self.discard_then(Order::Open(Subject::Demo), snapshot),
            Command::Train => self.worker.send(Order::Train),
            Command::Pause => self.worker.send(Order::Pause),
            Command::Step => self.worker.send(Order::Step),
            Command::Reset => self.discard_then(Order::Reset, snapshot),
            Command::Save => self.save_dialog.show(),
            Command::Export => self.export_dialog.show(),
            Command::FrameScene
            | Command::Home
            | Command::ToggleRenderer
            | Command::PreviousCamera
            | Command::NextCamera
            | Command::ComparePhoto => {
                if let Some(opened) = &snapshot.opened {
                    self.view.obey(command, opened);
                }
            }
            Command::Deselect => self.worker.send(Order::Inspect(None)),
            Command::Help => self.help_is_open = !self.help_is_open,
        }
    }

    /// Goes ahead at once if nothing would be lost, else asks.
    fn discard_then(&mut self, order: Order, snapshot: &Snapshot) {
        if would_lose(snapshot) {
            self.discarding = Some(Discarding::By(order));
        } else {
            self.worker.send(order);
        }
    }

    fn discard(&mut self, what: Discarding, ui: &Ui) {
        match what {
            Discarding::By(order) => self.worker.send(order),
            Discarding::Close => {
                self.may_close = true;
                ui.ctx().send_viewport_cmd(ViewportCommand::Close);
            }
        }
    }

    /// Keys are left to text fields and open questions.
    fn take_keys(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let dialogs = [&self.open_dialog, &self.save_dialog, &self.export_dialog];
        let asks = self.discarding.is_some() || dialogs.iter().any(|dialog| dialog.is_open());
        if asks || ui.ctx().egui_wants_keyboard_input() {
            return;
        }
        if ui.input(|i| i.key_pressed(Key::Tab)) {
            // The key is a command's; it would also move the focus, and keys with it.
            ui.memory_mut(|memory| memory.move_focus(FocusDirection::None));
        }
        for command in Command::ALL {
            if !command.is_legal(snapshot.state, snapshot.source) {
                continue;
            }
            let keys = command.shortcuts();
            if ui.input_mut(|i| keys.iter().any(|key| i.consume_shortcut(key))) {
                self.obey(command, snapshot);
            }
        }
    }

    fn take_dropped(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let dropped = ui.input(|i| i.raw.dropped_files.first().map(|f| f.path().to_owned()));
        if let Some(path) = dropped {
            self.discard_then(order_to_open(path), snapshot);
        }
    }

    /// Closing the window is asked about like everything else that forgets training.
    fn take_close_request(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let asked = ui.input(|i| i.viewport().close_requested());
        if asked && !self.may_close && would_lose(snapshot) {
            ui.ctx().send_viewport_cmd(ViewportCommand::CancelClose);
            self.discarding = Some(Discarding::Close);
        }
    }

    fn dialogs(&mut self, ui: &Ui, snapshot: &Snapshot) {
        if let Some(path) = self.open_dialog.ui(ui, &self.waker, |_| ()) {
            self.discard_then(order_to_open(path), snapshot);
        }
        if let Some(path) = self.save_dialog.ui(ui, &self.waker, |_| ()) {
            self.worker.send(Order::Save(path));
        }
        let is_native = snapshot.opened.as_ref().is_some_and(|opened| opened.is_native);
        let mapping = &mut self.mapping;
        let choices = |ui: &mut Ui| {
            if is_native {
                export_options::ui(mapping, ui);
            }
        };
        if let Some(path) = self.export_dialog.ui(ui, &self.waker, choices) {
            self.worker.send(Order::Export(path, self.mapping));
        }
        dialogs::help(ui, &mut self.help_is_open);
        let Some(what) = self.discarding.clone() else { return };
        match dialogs::confirm_discard(ui, snapshot.unsaved_frames) {
            None => {}
            Some(decision) => {
                self.discarding = None;
                match decision {
                    Decision::Discard => self.discard(what, ui),
                    Decision::Save => self.save_dialog.show(),
                    Decision::Export => self.export_dialog.show(),
                    Decision::Cancel => {}
                }
            }
        }
    }

    fn side_panel(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        ui.horizontal(|ui| {
            ui.selectable_value(&mut self.tab, Tab::Latency, "Latency");
            ui.selectable_value(&mut self.tab, Tab::Scene, "Scene");
            ui.selectable_value(&mut self.tab, Tab::Inspector, "Inspector");
            ui.selectable_value(&mut self.tab, Tab::Settings, "Settings");
        });
        ui.separator();
        match self.tab {
            Tab::Latency => latency::ui(snapshot, self.view.drawn(), ui),
            Tab::Scene => scene::ui(snapshot, ui),
            Tab::Inspector => inspector::ui(snapshot, ui),
            Tab::Settings => self.settings(ui),
        }
    }

    fn settings(&mut self, ui: &mut Ui) {
        let own_fov_deg = self.view.own_fov_deg();
        let around = settings::Surroundings { adapter: &self.adapter, own_fov_deg };
        let adapters = self.device.as_ref().map(|device| adapter::Adapters {
            there: &device.there,
            current: &device.adapter,
            gpu_failed: self.view.gpu_failed(),
        });
        let before = self.training.clone();
        let (view, training) = (&mut self.view.settings, &mut self.training);
        let asked = settings::ui(view, training, &around, adapters.as_ref(), ui);
        if self.training != before {
            self.worker.send(Order::TrainBy(Box::new(self.training.clone())));
        }
        match asked {
            None => {}
            Some(adapter::Asked::RetryGpu) => self.retry_gpu(),
            Some(adapter::Asked::Adapter(choice)) => {
                adapter_memory::remember(&choice);
                self.leave(Leave::Adapter(choice), ui.ctx());
            }
        }
    }

    fn retry_gpu(&mut self) {
        let Some(Device { state, faults, .. }) = &self.device else { return };
        faults.take(); // what went wrong before is known
        match GpuPainter::new(state, faults.clone(), self.waker.clone()) {
            Ok(painter) => self.view.draw_by(Painter::Gpu(Box::new(painter))),
            Err(error) => {
                let text = format!("the GPU still cannot draw the scene: {error}");
                self.worker.send(Order::Report(NoticeKind::Error, text));
            }
        }
    }

    /// Faults of the window's own drawing, which nobody else takes while the CPU draws the scene.
    fn report_faults(&self) {
        let is_on_cpu = self.view.drawn().drawer == Drawer::Cpu;
        let Some(device) = self.device.as_ref().filter(|_| is_on_cpu) else { return };
        for fault in device.faults.take() {
            let text = format!(
                "drawing the window failed: {}; if parts of it are missing, choose another adapter in Settings",
                fault.message
            );
            self.worker.send(Order::Report(NoticeKind::Error, text));
        }
    }

    fn central_view(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        for delivery in self.worker.feed().take() {
            self.view.change(delivery);
        }
        if snapshot.opened.is_none() && snapshot.state != RunState::Loading {
            self.empty_view(ui, snapshot);
            return;
        }
        if let Some(message) = self.view.ui(ui, snapshot) {
            self.worker.send(Order::Report(NoticeKind::Error, message));
        }
        let watched = self.view.settings.color_mode.attribute();
        if watched != self.watched {
            self.watched = watched;
            self.worker.send(Order::Watch(watched));
        }
        if let Some(picked) = self.view.take_picked() {
            self.worker.send(Order::Inspect(picked));
            if picked.is_some() {
                self.tab = Tab::Inspector;
            }
        }
        if !self.first_splats_logged && self.view.n_drawn() > 0 {
            self.first_splats_logged = true;
            tracing::info!("first splats visible after {} ms", self.started.elapsed().as_millis());
        }
    }

    /// Shown while nothing is open.
    fn empty_view(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        ui.vertical_centered(|ui| {
            ui.add_space(ui.available_height() * 0.35);
            ui.label(RichText::new("Drop a dataset folder here").size(22.0));
            ui.label("a checkpoint to go on with, or a .ply or .glb to look at");
            ui.add_space(12.0);
            if ui.button(Command::Open.label()).clicked() {
                self.obey(Command::Open, snapshot);
            }
            if ui.button("Try the synthetic scene").clicked() {
                self.obey(Command::OpenDemo, snapshot);
            }
        });
    }
}

/// Calibrations are opened for what is open already.
fn order_to_open(path: PathBuf) -> Order {
    match path.extension() {
        Some(extension) if extension == "ron" => Order::Calibrate(path),
        _ => Order::Open(Subject::Path(path)),
    }
}

/// Whether there is training to lose. The demo can be made again at any time, so it never counts.
fn would_lose(snapshot: &Snapshot) -> bool {
    snapshot.unsaved_frames > 0 && snapshot.opened.as_ref().is_some_and(|o| !o.is_demo)
}

impl eframe::App for Studio {
    fn clear_color(&self, visuals: &Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        kept::write(storage, &self.view.settings, &self.training);
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        if self.device.as_ref().is_some_and(Device::is_lost) {
            // Nothing may be drawn any more, not even by egui, or it panics.
            self.leave(Leave::DeviceLost, ui.ctx());
            return;
        }
        self.report_faults();
        let snapshot = self.worker.snapshot();
        self.take_close_request(ui, &snapshot);
        self.take_dropped(ui, &snapshot);
        self.take_keys(ui, &snapshot);
        // The window is cleared to the panels' colour, so nothing is filled twice: one fill of the
        // window costs 66 ms of processor time on a software adapter (1280×800, llvmpipe).
        let frame = Frame::side_top_panel(ui.style()).fill(Color32::TRANSPARENT);
        let asked = Panel::top("transport").frame(frame).show(ui, |ui| {
            ui.add_space(3.0);
            let asked = transport::ui(&snapshot, ui);
            ui.add_space(3.0);
            asked
        });
        if let Some(command) = asked.inner {
            self.obey(command, &snapshot);
        }
        let surroundings =
            status::Surroundings { adapter: &self.adapter, n_drawn: self.view.n_drawn() };
        Panel::bottom("status")
            .frame(frame)
            .show(ui, |ui| status::ui(&snapshot, &surroundings, ui));
        Panel::right("panels")
            .default_size(340.0)
            .size_range(240.0..=640.0)
            .frame(frame)
            .show(ui, |ui| self.side_panel(ui, &snapshot));
        if let Some(opened) = &snapshot.opened {
            let asked = Panel::top("viewport bar").frame(frame).show(ui, |ui| {
                ui.add_space(2.0);
                let asked = toolbar::ui(&mut self.view, &snapshot, opened, ui);
                ui.add_space(2.0);
                asked
            });
            if let Some(command) = asked.inner {
                self.obey(command, &snapshot);
            }
        }
        CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            self.central_view(ui, &snapshot);
            self.dismissed = notices::ui(&snapshot, self.dismissed, ui);
        });
        self.dialogs(ui, &snapshot);
        drop_target::show(ui.ctx());
    }
}
