//! The application: puts panels together and turns what they answer into orders.

use super::adapter_memory;
use super::color_mode::ColorMode;
use super::command::Command;
use super::dialogs::{self, Decision, PathDialog};
use super::panels::{adapter, inspector, latency, notices, scene, status, transport};
use super::scene_view::SceneView;
use super::state::{NoticeKind, RunState, Snapshot, Subject};
use super::viewport::{self, GpuPainter};
use super::window::{Exit, Leave};
use super::worker::{Order, Waker, Worker};
use crate::render::gpu::adapters::AdapterFacts;
use crate::render::gpu::faults::GpuFaults;
use eframe::egui::{
    CentralPanel, Color32, Context, Frame, Panel, RichText, Ui, ViewportCommand, Visuals,
};
use eframe::egui_wgpu::RenderState;
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
    adapter: String,
    tab: Tab,
    open_dialog: PathDialog,
    save_dialog: PathDialog,
    export_dialog: PathDialog,
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
        if let Some(subject) = subject {
            worker.send(Order::Open(subject));
        }
        Self::attach(context, worker, Exit::default(), painting, started)
    }

    /// Builds the application on a run that may be under way; `exit` learns why the window ends.
    pub fn attach(
        context: &eframe::CreationContext<'_>,
        worker: Arc<Worker>,
        exit: Exit,
        painting: Painting,
        started: Instant,
    ) -> std::io::Result<Self> {
        let egui = context.egui_ctx.clone();
        let waker: Waker = Arc::new(move || egui.request_repaint());
        let device = context.wgpu_render_state.as_ref().map(Device::new);
        let (gpu, adapter) = gpu_painter(device.as_ref(), painting, &waker);
        worker.set_interval(if gpu.is_some() { GPU_INTERVAL } else { SOFTWARE_INTERVAL });
        Ok(Self {
            worker,
            exit,
            device,
            view: SceneView::new(gpu, waker.clone())?,
            waker,
            adapter,
            tab: Tab::default(),
            open_dialog: PathDialog::open(),
            save_dialog: PathDialog::save(),
            export_dialog: PathDialog::export(),
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

    /// Colours the scene in another way.
    pub fn set_color_mode(&mut self, mode: ColorMode) {
        self.view.set_color_mode(mode);
        self.worker.send(Order::Watch(mode.attribute()));
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
            Command::FrameScene => self.view.frame_scene(),
            Command::Home => {
                if let Some(opened) = &snapshot.opened {
                    self.view.go_home(opened);
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
        if ui.ctx().egui_wants_keyboard_input() || self.discarding.is_some() {
            return;
        }
        for command in Command::ALL {
            if !command.is_legal(snapshot.state, snapshot.source) {
                continue;
            }
            let pressed =
                command.shortcut().is_some_and(|s| ui.input_mut(|i| i.consume_shortcut(&s)));
            if pressed {
                self.obey(command, snapshot);
            }
        }
    }

    fn take_dropped(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let dropped = ui.input(|i| i.raw.dropped_files.first().map(|f| f.path().to_owned()));
        if let Some(path) = dropped {
            self.discard_then(Order::Open(Subject::Path(path)), snapshot);
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
        if let Some(path) = self.open_dialog.ui(ui, &self.waker) {
            self.discard_then(Order::Open(Subject::Path(path)), snapshot);
        }
        if let Some(path) = self.save_dialog.ui(ui, &self.waker) {
            self.worker.send(Order::Save(path));
        }
        if let Some(path) = self.export_dialog.ui(ui, &self.waker) {
            self.worker.send(Order::Export(path));
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
            Tab::Latency => latency::ui(snapshot, ui),
            Tab::Scene => scene::ui(snapshot, ui),
            Tab::Inspector => inspector::ui(snapshot, ui),
            Tab::Settings => self.adapters(ui),
        }
    }

    fn adapters(&mut self, ui: &mut Ui) {
        let Some(device) = &self.device else { return };
        let adapters = adapter::Adapters {
            there: &device.there,
            current: Some(&device.adapter),
            gpu_failed: self.view.gpu_failed(),
        };
        match adapter::ui(&adapters, ui) {
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
            Ok(painter) => self.view.use_gpu(painter),
            Err(error) => {
                let text = format!("the GPU still cannot draw the scene: {error}");
                self.worker.send(Order::Report(NoticeKind::Error, text));
            }
        }
    }

    /// Faults of the window's own drawing, which nobody else takes while the CPU draws the scene.
    fn report_faults(&self) {
        let Some(device) = self.device.as_ref().filter(|_| !self.view.is_on_gpu()) else { return };
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

/// Whether there is training to lose. The demo can be made again at any time, so it never counts.
fn would_lose(snapshot: &Snapshot) -> bool {
    snapshot.unsaved_frames > 0 && snapshot.opened.as_ref().is_some_and(|o| !o.is_demo)
}

/// The window's device, watched.
struct Device {
    state: RenderState,
    faults: GpuFaults,
    /// What else could draw the window.
    there: Vec<AdapterFacts>,
    adapter: AdapterFacts,
}

impl Device {
    fn new(state: &RenderState) -> Self {
        let (there, adapter) = viewport::adapters(state);
        Self { state: state.clone(), faults: viewport::watch(state), there, adapter }
    }

    fn is_lost(&self) -> bool {
        viewport::poll(&self.state);
        self.faults.is_lost()
    }
}

/// A GPU painter if the adapter is a real GPU, and who draws, for the status line.
fn gpu_painter(
    device: Option<&Device>,
    painting: Painting,
    waker: &Waker,
) -> (Option<GpuPainter>, String) {
    let Some(Device { state, faults, .. }) = device else {
        return (None, "CPU renderer".to_owned());
    };
    let capabilities = viewport::capabilities(state);
    tracing::info!("adapter: {capabilities}");
    if capabilities.is_software() && painting == Painting::Auto {
        return (None, format!("CPU renderer; window by {capabilities}"));
    }
    match GpuPainter::new(state, faults.clone(), waker.clone()) {
        Ok(painter) => (Some(painter), capabilities.to_string()),
        Err(error) => {
            tracing::warn!("{error}");
            (None, format!("CPU renderer ({error})"))
        }
    }
}

impl eframe::App for Studio {
    fn clear_color(&self, visuals: &Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
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
        CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
            self.central_view(ui, &snapshot);
            self.dismissed = notices::ui(&snapshot, self.dismissed, ui);
        });
        self.dialogs(ui, &snapshot);
        show_drop_target(ui.ctx());
    }
}

/// A hint while a file is dragged over the window.
fn show_drop_target(ctx: &Context) {
    use eframe::egui::{Align2, Color32, FontId, Id, LayerId, Order as Layer};
    if ctx.input(|i| i.raw.hovered_files.is_empty()) {
        return;
    }
    let painter = ctx.layer_painter(LayerId::new(Layer::Foreground, Id::unique("drop target")));
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
