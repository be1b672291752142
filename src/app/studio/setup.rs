//! Steps of opening a window.

use crate::app::device::WindowDevice;
use crate::app::drawing::ViewRenderer;
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

/// Opacity of weak text.
const WEAK_TEXT: f32 = 0.8;

/// Sends the initial settings, orders and warnings about unreadable stored settings to the worker.
pub(super) fn give_first_orders(
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
pub(super) fn scene_view(
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
            view.note_gpu_failure();
        }
    }
    view
}

/// Restores the view handed over by the previous window, if any; returns its camera path.
pub(super) fn take_over(view: &mut SceneView, exit: &Exit) -> PathEditor {
    let Some(Handover { view: kept, path }) = exit.take_handover() else {
        return Default::default();
    };
    view.restore_retained_state(kept);
    path
}

/// Raises the contrast of weak text and links, which egui draws too pale, above all on white.
pub(super) fn strengthen_weak_text(context: &Context) {
    context.all_styles_mut(|style| style.visuals.weak_text_alpha = WEAK_TEXT);
    let link = SignalColor::Blue.for_theme(false);
    context.style_mut_of(Theme::Light, |style| style.visuals.hyperlink_color = link);
}
