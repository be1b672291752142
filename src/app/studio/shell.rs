//! The window around the studio: graphics device, renderer, title, and reason for closing.

use crate::app::drawing::{ViewRenderer, WindowWaker};
use crate::app::state::Snapshot;
use crate::app::viewer::SceneView;
use crate::app::viewer::painter::ViewPainter;
use crate::app::viewer::settings::ViewSettings;
use crate::app::viewport;
use crate::app::viewport::WindowDevice;
use crate::app::window::{Exit, ExitReason};
use crate::app::window_painter::WindowPainter;
use crate::app::worker::Waker;
use eframe::egui::{Align2, Color32, Context, FontId, Id, LayerId, Order, ViewportCommand};
use std::panic::{AssertUnwindSafe, catch_unwind};

pub(super) struct Shell {
    pub egui: Context,
    /// Lets other threads repaint this window. Has no effect once the window is dropped.
    pub waker: WindowWaker,
    pub device: Option<WindowDevice>,
    pub adapter: String,
    pub exit: Exit,
    /// Current window title, stored so that only changes are sent.
    title: String,
}

impl Shell {
    pub fn new(
        egui: Context,
        waker: WindowWaker,
        device: Option<WindowDevice>,
        adapter: String,
        exit: Exit,
    ) -> Self {
        Self { egui, waker, device, adapter, exit, title: String::new() }
    }

    /// Creates the viewport. If the CPU draws although a GPU exists, a GPU failure is recorded. With a
    /// software adapter, the CPU also draws the window.
    pub fn scene_view(&self, painter: ViewPainter, settings: ViewSettings) -> SceneView {
        let on_cpu = painter.drawer() == ViewRenderer::Cpu;
        let mut view = SceneView::new(painter, settings, self.waker().clone());
        if let Some(WindowDevice { state, .. }) = self.device.as_ref().filter(|_| on_cpu) {
            if viewport::capabilities(state).is_software() {
                WindowPainter::install(&self.egui, state);
            } else {
                view.painter.gpu_failed = true;
            }
        }
        view
    }

    pub fn waker(&self) -> &Waker {
        self.waker.waker()
    }

    /// Returns a description of the renderer in use, including a fallback to the CPU.
    pub fn renderer(&self, gpu_failed: bool) -> String {
        match &self.device {
            Some(device) if gpu_failed => {
                format!("CPU renderer, since the GPU failed; window by {}", device.adapter)
            }
            _ => self.adapter.clone(),
        }
    }

    pub fn update_title(&mut self, snapshot: &Snapshot) {
        let title = match &snapshot.opened {
            Some(opened) => format!("{} - VBGS Studio", opened.name),
            None => "VBGS Studio".to_owned(),
        };
        if title != self.title {
            self.egui.send_viewport_cmd(ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    /// If a panic drops the window, records whether the graphics device was lost. After a loss egui panics,
    /// because it cannot allocate buffers. The device cannot be checked later, because it is dropped with
    /// the window.
    pub fn record_lost_device(&self) {
        if let Some(device) = self.device.as_ref().filter(|_| std::thread::panicking())
            // A device that panics when polled is lost.
            && catch_unwind(AssertUnwindSafe(|| device.is_lost())).unwrap_or(true)
        {
            self.exit.reason.set(ExitReason::DeviceLost);
        }
    }
}

/// Darkens the window while files are dragged over it.
pub(super) fn drop_target(ctx: &Context) {
    if ctx.input(|i| i.raw.hovered_files.is_empty()) {
        return;
    }
    let painter = ctx.layer_painter(LayerId::new(Order::Foreground, Id::unique("drop target")));
    let rect = ctx.content_rect();
    painter.rect_filled(rect, 0.0, Color32::from_black_alpha(160));
    let font = FontId::proportional(28.0);
    painter.text(rect.center(), Align2::CENTER_CENTER, "Drop to open", font, Color32::WHITE);
}
