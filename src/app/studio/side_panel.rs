//! Panels and their requests to the window.

use super::Studio;
use crate::app::color_mode::ColorMode;
use crate::app::detail::{finer, retrainable_run};
use crate::app::drawing::ViewRenderer;
use crate::app::layout::SideTab;
use crate::app::panels::card::CardPlace;
use crate::app::panels::quality::EvidenceHistogram;
use crate::app::panels::ready::SummaryAnswer;
use crate::app::panels::settings::SettingsAnswer;
use crate::app::panels::{edit, inspector, latency, quality, ready, settings};
use crate::app::state::{NoticeKind, Opened, RunState, Snapshot, Source};
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::painter::ViewPainter;
use crate::app::viewer::toolbar::ViewMode;
use crate::app::viewport;
use crate::app::viewport::{GpuViewPainter, WindowDevice};
use crate::app::window::ExitReason;
use crate::app::worker::WorkerOrder;
use crate::train::scene::units::StructuralScale;
use eframe::egui::Ui;

impl Studio {
    pub(super) fn panel(&mut self, tab: SideTab, ui: &mut Ui, snapshot: &Snapshot) {
        match tab {
            SideTab::Latency => self.latency_tab(ui, snapshot),
            SideTab::Quality => self.quality_tab(ui, snapshot),
            SideTab::Scene => inspector::scene_section(snapshot, ui),
            SideTab::Inspector => inspector::ui(snapshot, ui),
            SideTab::Edit => self.edit_tab(ui, snapshot),
            SideTab::Path => self.path_tab(ui, snapshot),
            SideTab::Settings => self.settings(ui, snapshot),
        }
    }

    fn latency_tab(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        let mut budget_ms = self.view.settings.panels.frame_budget_ms;
        let csv = latency::ui(snapshot, &self.view.painter.drawn, &mut budget_ms, ui);
        self.view.settings.panels.frame_budget_ms = budget_ms;
        if let (Some(csv), Some(opened)) = (csv, &snapshot.opened) {
            self.worker.send(WorkerOrder::WriteText(opened.files.path("latency.csv"), csv));
        }
    }

    fn quality_tab(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        let mut every = self.view.settings.panels.quality_every;
        let opened = snapshot.opened.as_deref();
        let evidence = self.evidence(snapshot);
        let thumbnails = opened.and_then(|opened| self.view.thumbnails(opened));
        let (known, plot) = (&self.quality, &mut self.panels.quality_plot);
        let asked =
            quality::ui(known, snapshot, thumbnails, plot, &mut every, evidence.as_ref(), ui);
        self.view.settings.panels.quality_every = every;
        if let (Some(frame), Some(opened)) = (asked, opened) {
            self.view.compare_at(frame, opened);
        }
    }

    fn path_tab(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else {
            ui.label("Nothing is open.");
            return;
        };
        self.film.panel(&mut self.view, &mut self.dialogs.film, &self.worker, opened, ui);
    }

    fn settings(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        let gpu_failed = self.view.painter.gpu_failed;
        let graphics = settings::Graphics {
            renderer: &self.shell.renderer(gpu_failed),
            device: self.shell.device.as_ref(),
            gpu_failed,
        };
        let before = self.training.clone();
        let (view, training) = (&mut self.view.settings, &mut self.training);
        let asked = settings::ui(view, training, &graphics, ui);
        if self.training != before {
            self.worker.send(WorkerOrder::TrainBy(Box::new(self.training.clone())));
        }
        match asked {
            None => {}
            Some(SettingsAnswer::Command(command)) => self.apply_command(command, snapshot),
            Some(SettingsAnswer::RetryGpu) => self.retry_gpu(),
            Some(SettingsAnswer::Adapter(choice)) => {
                // Reports about the current adapter would be misread as those of the next one.
                self.worker.send(WorkerOrder::ForgetReports);
                self.close_window(ExitReason::Adapter(choice));
            }
        }
    }

    pub(super) fn retry_gpu(&mut self) {
        let Some(WindowDevice { state, faults, .. }) = &self.shell.device else { return };
        faults.take_new(); // earlier errors are already reported
        match GpuViewPainter::new(state, faults.clone()) {
            Ok(painter) => {
                self.view.set_painter(ViewPainter::Gpu(Box::new(painter)));
                self.shell.adapter = viewport::capabilities(state).to_string();
                self.worker.send(WorkerOrder::ForgetReports);
            }
            Err(error) => {
                let text = format!("the GPU still cannot draw the scene: {error}");
                self.report(NoticeKind::Error, text);
            }
        }
    }

    /// Reports GPU errors that occurred while the window was drawn. If the GPU also draws the scene, the
    /// scene's painter reports them instead.
    pub(super) fn report_faults(&self) {
        let is_on_cpu = self.view.painter.drawn.drawer == ViewRenderer::Cpu;
        let Some(device) = self.shell.device.as_ref().filter(|_| is_on_cpu) else { return };
        for fault in device.faults.take_new() {
            let text = format!(
                "drawing the window failed: {fault}; if parts of it are missing, choose another adapter in Settings"
            );
            self.report(NoticeKind::Error, text);
        }
    }

    /// Draws the card of the current state, if there is one. Notices cover the top `noticed` points of
    /// the viewport.
    pub(super) fn cards(&mut self, ui: &Ui, snapshot: &Snapshot, noticed: f32) {
        let Some(opened) = &snapshot.opened else { return };
        let place = CardPlace::below(noticed, ui);
        if snapshot.state == RunState::Ready && snapshot.frames_done == 0 {
            self.ready_card(opened, place, ui, snapshot);
        }
        let is_read = self.panels.closed_summary_serial == opened.serial;
        let is_plain = self.view.comparison.mode() == ViewMode::Single
            && self.view.settings.color_mode == ColorMode::Color;
        let is_done = snapshot.state == RunState::Finished && snapshot.source == Source::Dataset;
        if is_done && is_plain && !is_read {
            self.summary_card(opened, place, ui, snapshot);
        }
    }

    fn ready_card(&mut self, opened: &Opened, place: CardPlace, ui: &Ui, snapshot: &Snapshot) {
        let first = FrameRef::trained(opened, 0);
        let photo = match (self.view.thumbnails(opened), &first) {
            (Some(thumbnails), Some(first)) => thumbnails.get(ui.ctx(), first, true),
            _ => None,
        };
        if let Some(command) = ready::ui(snapshot, opened, photo, place, ui) {
            self.apply_command(command, snapshot);
        }
    }

    fn summary_card(&mut self, opened: &Opened, place: CardPlace, ui: &Ui, snapshot: &Snapshot) {
        let finer = finer(snapshot);
        let forecast = finer.map(|scale| {
            let scale = match scale {
                StructuralScale::Pixels(n) => format!("{n:.2} pixels"),
                StructuralScale::World(length) => format!("{length:.2e} world units"),
            };
            format!(
                "Train on the same frames again with a structural scale of {scale}: about {} components. The view stays",
                // `finer` divides the scale by √2, and components cover areas.
                2 * snapshot.model.used
            )
        });
        match ready::summary(snapshot, &self.quality, forecast.as_deref(), place, ui) {
            None => {}
            Some(SummaryAnswer::Close) => self.panels.closed_summary_serial = opened.serial,
            Some(SummaryAnswer::Quality) => self.layout.activate(SideTab::Quality),
            Some(SummaryAnswer::Command(command)) => self.apply_command(command, snapshot),
            Some(SummaryAnswer::Finer) => {
                self.training.scene.scale = finer;
                self.retrain(snapshot);
            }
        }
    }

    /// Trains again on the same frames with the current settings, without changing the view.
    pub(super) fn retrain(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        // Sent even if the user then cancels discarding: the settings apply to the next run.
        self.worker.send(WorkerOrder::TrainBy(Box::new(self.training.clone())));
        self.view.camera.retain_for(opened);
        self.confirm_then_send(WorkerOrder::Retrain, snapshot);
    }

    /// Applies a level of detail that was chosen after opening, if no frame is trained yet.
    pub(super) fn apply_detail(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let (Some(run), Some(chosen)) = (retrainable_run(opened), self.training.scene.scale) else {
            return;
        };
        if snapshot.state == RunState::Ready && run.scale != chosen {
            self.view.camera.retain_for(opened);
            self.worker.send(WorkerOrder::Reset);
        }
    }

    pub(super) fn edit_tab(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else {
            ui.label("Nothing is open.");
            return;
        };
        if let Some(command) = edit::ui(&mut self.view, snapshot, opened, ui) {
            self.apply_command(command, snapshot);
        }
    }

    /// Returns the histogram of the components' evidence while training is paused or finished; `None`
    /// otherwise, because collecting the evidence would slow training down.
    pub(super) fn evidence(&mut self, snapshot: &Snapshot) -> Option<EvidenceHistogram> {
        let is_at_rest = matches!(snapshot.state, RunState::Paused | RunState::Finished);
        let (editor, palette) = (&mut self.view.editor, &self.view.palette);
        is_at_rest.then(|| editor.evidence(palette)).flatten()
    }

    /// Requests the component attributes that colours, edits and panels need. Must be called after the
    /// view and the panels are drawn, because both determine the attributes.
    pub(super) fn request_attributes(&mut self) {
        let watched = self.view.take_watched_attribute();
        if watched != self.requested_attribute {
            self.requested_attribute = watched;
            self.worker.send(WorkerOrder::Watch(watched));
        }
    }
}
