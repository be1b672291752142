//! Status bar: state, speed, components, memory, adapter.

use super::signal_color::SignalColor;
use crate::app::rescue::AbandonedRun;
use crate::app::state::{Followed, ModelSize, RunState, Snapshot};
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::wording;
use crate::eval::report;
use crate::pipeline::any_preset::ComponentLimit;
use eframe::egui::{Color32, Label, ProgressBar, RichText, Ui};
use std::time::Duration;

pub struct StatusContext<'a> {
    pub adapter: &'a str,
    pub n_drawn: usize,
    /// Written fraction of the export in progress; `None` if no export is in progress.
    pub file_progress: Option<f32>,
    /// Time spent waiting for the current frame, if the wait is long.
    pub slow_frame: Option<Duration>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CancelRequest {
    File,
    Opening,
}

/// Draws the status bar. Returns the operation that the user cancels, if any.
pub fn ui(snapshot: &Snapshot, surroundings: &StatusContext, ui: &mut Ui) -> Option<CancelRequest> {
    let line = ui.horizontal(|ui| {
        let color = color(snapshot.state, ui.visuals().dark_mode);
        ui.label(RichText::new(snapshot.state.label()).strong().color(color));
        let mut unwanted = None;
        if let Some(share) = surroundings.file_progress {
            ui.separator();
            let text = format!("Exporting: {:.0} %", 100.0 * share);
            ui.add(ProgressBar::new(share).desired_width(120.0).text(text));
            let hint = "An existing file of this name is kept";
            let cancel = ui.button("Cancel export").on_hover_text(hint);
            unwanted = cancel.clicked().then_some(CancelRequest::File);
        }
        if snapshot.state == RunState::Loading {
            let hint = "The previous dataset or model stays open";
            let cancel = ui.button("Cancel opening").on_hover_text(hint);
            unwanted = unwanted.or(cancel.clicked().then_some(CancelRequest::Opening));
        }
        if let Some(time) = surroundings.slow_frame {
            ui.separator();
            slow_frame_warning(snapshot, time, ui);
        }
        if let Some(followed) = &snapshot.following.recording {
            ui.separator();
            let said = ui.label(following(snapshot.frames_done, followed));
            let path = followed.path.display();
            said.on_hover_text(followed.problem.clone().unwrap_or_else(|| path.to_string()));
        }
        if snapshot.pace.frames_per_s > 0.0 {
            ui.separator();
            ui.label(format!("{:.1} frames/s", snapshot.pace.frames_per_s));
        }
        if let Some(ms) = snapshot.median_frame_ms() {
            ui.label(format!("{ms:.1} ms a frame"))
                .on_hover_text("Median training time of the latest frames");
        }
        if snapshot.model.components > 0 {
            ui.separator();
            let n_drawn = wording::grouped(surroundings.n_drawn);
            ui.label(components(snapshot)).on_hover_text(format!("{n_drawn} of them are drawn"));
        }
        skipped(snapshot, ui);
        ui.separator();
        if let Some(bytes) = report::rss_bytes() {
            let model = snapshot.model.bytes as f64 * 1e-6;
            let text = format!("{:.0} MB of memory", bytes as f64 * 1e-6);
            ui.label(text)
                .on_hover_text(format!("The whole program; the scene alone: {model:.0} MB"));
            ui.separator();
        }
        // Truncated: its length is unbounded, and a wrapped bar would resize the viewport.
        let adapter = Label::new(RichText::new(surroundings.adapter).weak()).truncate();
        ui.add(adapter).on_hover_text(surroundings.adapter);
        unwanted
    });
    line.inner
}

fn skipped(snapshot: &Snapshot, ui: &mut Ui) {
    let Some(first) = snapshot.frames.skipped.first() else { return };
    ui.separator();
    let text = format!("{} skipped", snapshot.frames.skipped.len());
    let label = ui.label(SignalColor::Yellow.text(text, ui));
    label.on_hover_text(format!(
        "First reason: {}\nThe frame strip crosses these frames out; hover over one for its reason",
        first.message
    ));
}

fn slow_frame_warning(snapshot: &Snapshot, time: Duration, ui: &mut Ui) {
    let next = snapshot.opened.as_ref().and_then(|o| FrameRef::trained(o, snapshot.n_seen()));
    let name = next.map_or_else(|| "a frame".to_owned(), |frame| frame.entry().name.clone());
    let text = format!("{name}: still reading after {} s", time.as_secs());
    ui.label(SignalColor::Yellow.text(text, ui)).on_hover_text(
        "The drive may be slow or disconnected: check it. Training continues when it responds. Pausing, saving, exporting and closing do not wait for it",
    );
}

fn following(n_frames: usize, followed: &Followed) -> String {
    let waiting = if followed.is_waiting { ", waiting" } else { "" };
    format!("following, {n_frames} frames{waiting}")
}

fn components(snapshot: &Snapshot) -> String {
    let Snapshot { model: ModelSize { components, used, .. }, opened, .. } = snapshot;
    let method = opened.as_ref().and_then(|opened| opened.method.as_ref());
    match method.map(|method| method.as_any().component_limit()) {
        None => wording::count(*components, "splat"),
        // Only the paper's preset has unused components.
        Some(ComponentLimit::Fixed(_)) => {
            format!("{} of {} splats used", wording::grouped(*used), wording::grouped(*components))
        }
        Some(ComponentLimit::Default(_)) => wording::count(*used, "splat"),
        Some(ComponentLimit::Asked(most) | ComponentLimit::Lowered(most)) => {
            format!("{} of at most {} splats", wording::grouped(*used), wording::grouped(most))
        }
    }
}

fn color(state: RunState, is_dark: bool) -> Color32 {
    match state {
        RunState::Empty | RunState::Loading if is_dark => Color32::GRAY,
        RunState::Empty | RunState::Loading => Color32::DARK_GRAY,
        RunState::Ready | RunState::Paused | RunState::Waiting => {
            SignalColor::Yellow.for_theme(is_dark)
        }
        RunState::Training => SignalColor::Green.for_theme(is_dark),
        RunState::Finished => SignalColor::Blue.for_theme(is_dark),
        RunState::Failed => SignalColor::Red.for_theme(is_dark),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    Resume,
    Forget,
    NotNow,
}

pub fn abandoned(run: &AbandonedRun, ui: &mut Ui) -> Option<Answer> {
    let mut answer = None;
    ui.horizontal_wrapped(|ui| {
        let AbandonedRun { dataset, frames, planned_frames, .. } = run;
        let name = dataset.file_name().map_or(dataset.as_os_str(), |name| name);
        let text = format!(
            "{} was not saved: {frames} of {planned_frames} frames are kept.",
            name.to_string_lossy()
        );
        ui.label(SignalColor::Yellow.text(text, ui).strong()).on_hover_text(format!(
            "{}\n{}",
            dataset.display(),
            run.file.display()
        ));
        for (label, choice, tooltip) in [
            ("Open it", Answer::Resume, "Opens the run; training can go on"),
            ("Delete it", Answer::Forget, "Deletes the autosave of this run"),
            ("Later", Answer::NotNow, "Offers this again at the next start"),
        ] {
            if ui.button(label).on_hover_text(tooltip).clicked() {
                answer = Some(choice);
            }
        }
    });
    answer
}
