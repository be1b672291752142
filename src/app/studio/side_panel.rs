//! Panels and their requests to the window.

use super::Studio;
use crate::app::detail::{finer, retrain_label};
use crate::app::drawing::ViewRenderer;
use crate::app::layout::SideTab;
use crate::app::panels::quality::EvidenceHistogram;
use crate::app::panels::settings::SettingsAnswer;
use crate::app::panels::summary::{SummaryAnswer, SummaryPictures};
use crate::app::panels::{edit, inspector, latency, quality, settings, summary};
use crate::app::state::{NoticeKind, RunState, Snapshot};
use crate::app::viewer::comparison::ComparedModel;
use crate::app::viewer::painter::ViewPainter;
use crate::app::viewport;
use crate::app::viewport::{GpuViewPainter, WindowDevice};
use crate::app::window::ExitReason;
use crate::app::wording;
use crate::app::worker::WorkerOrder;
use crate::model::splat::framing::framing;
use crate::train::scene::units::StructuralScale;
use eframe::egui::Ui;

impl Studio {
    pub(super) fn panel(&mut self, tab: SideTab, ui: &mut Ui, snapshot: &Snapshot) {
        match tab {
            SideTab::Summary => self.summary(ui, snapshot),
            SideTab::Quality => self.quality_tab(ui, snapshot),
            SideTab::Latency => self.latency_tab(ui, snapshot),
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
            self.send_training(snapshot);
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

    fn summary(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        // The bar offers the scale that the user has chosen.
        let is_chosen = retrain_label(self.training.scene.scale, snapshot).is_some();
        let finer = finer(snapshot).filter(|_| !is_chosen);
        let forecast = finer.map(|scale| {
            let scale = match scale {
                StructuralScale::Pixels(n) => format!("{n:.2} depth pixels"),
                StructuralScale::World(length) => wording::length(length),
            };
            // `finer` divides the scale by √2, and splats cover areas.
            let n = wording::grouped(2 * snapshot.model.used);
            format!(
                "Splats of {scale}, about {n}. The view stays, and this scene is kept beside the new one"
            )
        });
        let opened = snapshot.opened.as_deref();
        let shown = opened.and_then(|opened| summary::shown_frame(snapshot, opened, &self.quality));
        let render = opened.zip(shown.as_ref()).and_then(|(opened, frame)| {
            let key = (opened.serial, snapshot.frames_done, frame.position());
            let scene = self.view.learned();
            let camera = frame.photo_camera(opened.color_camera().as_ref(), scene.finishing());
            let renders =
                (snapshot.state.is_at_rest() && snapshot.frames_done > 0, self.shell.waker());
            let drawn = (camera, self.view.settings.measured());
            self.panels.summary.get(ui.ctx(), key, drawn, scene, renders)
        });
        let photo = match (opened.and_then(|opened| self.view.thumbnails(opened)), &shown) {
            (Some(thumbnails), Some(frame)) => thumbnails.get(ui.ctx(), frame, true),
            _ => None,
        };
        let pictures = SummaryPictures { photo, render };
        let asked = summary::ui(snapshot, &self.quality, &pictures, forecast.as_deref(), ui);
        match (asked, opened) {
            (None, _) => {}
            (Some(SummaryAnswer::Command(command)), _) => self.apply_command(command, snapshot),
            (Some(SummaryAnswer::Compare), Some(opened)) => {
                if let Some(frame) = shown {
                    self.view.compare_at(frame, opened);
                }
            }
            (Some(SummaryAnswer::Finer), _) => self.retrain_finer(snapshot),
            (Some(SummaryAnswer::Compare), None) => {}
        }
    }

    /// Trains again with finer splats, if the run can be repeated and noise does not hide them.
    pub(super) fn retrain_finer(&mut self, snapshot: &Snapshot) {
        if let Some(scale) = finer(snapshot) {
            self.training.scene.scale = Some(scale);
            self.retrain(snapshot);
        }
    }

    /// Trains again on the same frames with the current settings, without changing the view. Does not ask
    /// before, because the scene stays as the second model.
    pub(super) fn retrain(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        self.send_training(snapshot);
        self.view.camera.retain_for(opened);
        let scene = self.view.learned();
        self.panels.before_retrain = framing(scene.iter()).map(|framing| {
            let before = ComparedModel {
                name: "Before".to_owned(),
                splats: (**scene).clone(),
                local_origin: opened.local_origin,
                defined_up: None,
                radius: framing.radius,
                is_in_file: !snapshot.has_training_to_lose(),
            };
            (opened.files.clone(), before)
        });
        self.worker.send(WorkerOrder::Retrain);
    }

    /// Sends changed settings to the worker. The level of detail is stored for the open dataset.
    pub(super) fn send_training(&mut self, snapshot: &Snapshot) {
        if let Some(path) = snapshot.opened.as_ref().and_then(|opened| opened.path.as_deref()) {
            let scale = self.training.scene.scale;
            self.training.note(path, |of| of.scale = scale);
        }
        self.apply_training();
    }

    /// Sends the settings to the worker.
    pub(super) fn apply_training(&self) {
        self.worker.send(WorkerOrder::TrainBy(Box::new(self.training.clone())));
    }

    /// Applies the settings that were changed after opening, if no frame is trained yet.
    pub(super) fn apply_settings(&mut self, snapshot: &Snapshot) {
        let (Some(opened), Some((_, _, applied))) = (&snapshot.opened, &self.panels.applied) else {
            return;
        };
        // A checkpoint keeps its own settings.
        let is_dataset = opened.dataset.as_ref().is_some_and(|d| d.path == opened.path);
        let now = &self.training;
        let is_changed = (now.preset, &now.scene, &now.paper)
            != (applied.preset, &applied.scene, &applied.paper);
        if snapshot.state == RunState::Ready && is_dataset && is_changed {
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
        let (editor, palette) = (&mut self.view.editor, &self.view.palette);
        snapshot.state.is_at_rest().then(|| editor.evidence(palette)).flatten()
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
