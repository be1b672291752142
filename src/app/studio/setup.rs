//! What a window is made of when it opens.

use crate::app::device::WindowDevice;
use crate::app::drawing::Drawer;
use crate::app::exit::{Exit, Handover};
use crate::app::panels::signal_color::SignalColor;
use crate::app::path_editor::PathEditor;
use crate::app::state::NoticeKind;
use crate::app::training::TrainSettings;
use crate::app::viewer::SceneView;
use crate::app::viewer::painter::ViewPainter;
use crate::app::viewer::settings::ViewSettings;
use crate::app::viewport;
use crate::app::window_painter::WindowPainter;
use crate::app::worker::{Waker, Worker, WorkerOrder};
use eframe::egui::{Context, Theme};

/// Share of its strength that text has which stands back.
const WEAK_TEXT: f32 = 0.8;

/// What the worker is to do first, and what could not be read of the stored settings.
pub(super) fn give_first_orders(
    worker: &Worker,
    training: &TrainSettings,
    first: Vec<WorkerOrder>,
    problems: Vec<String>,
) {
    // Settings go first, since they hold for what is opened after them.
    worker.send(WorkerOrder::TrainBy(Box::new(training.clone())));
    first.into_iter().for_each(|order| worker.send(order));
    let warn = |problem| worker.send(WorkerOrder::Report(NoticeKind::Warning, problem));
    problems.into_iter().for_each(warn);
}

/// The central view, which knows whether a real GPU is there that does not draw it. Where none is, the cores
/// draw the window too.
pub(super) fn scene_view(
    painter: ViewPainter,
    settings: ViewSettings,
    (window, waker): (&Context, &Waker),
    device: Option<&WindowDevice>,
) -> SceneView {
    let on_cpu = painter.drawer() == Drawer::Cpu;
    let mut view = SceneView::new(painter, settings, waker.clone());
    if let Some(WindowDevice { state, .. }) = device.filter(|_| on_cpu) {
        if viewport::capabilities(state).is_software() {
            WindowPainter::install(window, state);
        } else {
            view.note_gpu_failure();
        }
    }
    view
}

/// Gives the view what the window before has left, if one did; returns the camera path that was being made.
pub(super) fn go_on(view: &mut SceneView, exit: &Exit) -> PathEditor {
    let Some(Handover { view: kept, path }) = exit.taken_over() else { return Default::default() };
    view.go_on_with(kept);
    path
}

/// As egui has them, text that stands back and links are hard to read, on white above all.
pub(super) fn strengthen_weak_text(context: &Context) {
    context.all_styles_mut(|style| style.visuals.weak_text_alpha = WEAK_TEXT);
    let link = SignalColor::Blue.on(false);
    context.style_mut_of(Theme::Light, |style| style.visuals.hyperlink_color = link);
}
