//! Summary panel: what is open, how good the scene is, and what can be done next. Also the start page.

use super::controls::section;
use super::latency::slowest_stage;
use super::quality::detail;
use super::signal_color::SignalColor;
use crate::app::command::UiCommand;
use crate::app::quality::QualityMonitor;
use crate::app::state::{Opened, RunState, Snapshot, Source};
use crate::app::view_thread::RestingJob;
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::thumbnails::MAX_SIDE;
use crate::app::wording;
use crate::app::worker::Waker;
use crate::eval::report::{Detail, QualityPoint};
use crate::export::format::{READ_ENDINGS, listed};
use crate::math::camera::Camera;
use crate::model::splat::appearance::SplatSet;
use crate::render::RenderOptions;
use crate::render::cpu::CpuRenderer;
use eframe::egui::{
    Button, Color32, ColorImage, Context, Frame, Grid, Image, Label, RichText, ScrollArea, Sense,
    Stroke, TextureHandle, TextureOptions, Ui, Vec2,
};
use std::sync::Arc;

/// Largest height of a picture, points.
const PICTURE_HEIGHT: f32 = 190.0;

/// Largest width of the labels of figures, points.
const LABEL_WIDTH: f32 = 100.0;

/// Action that the user requests in the panel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SummaryAnswer {
    Command(UiCommand),
    Finer,
    Compare,
}

/// A photograph and the scene from the same camera; each once it is ready.
#[derive(Default)]
pub struct SummaryPictures<'a> {
    pub photo: Option<&'a TextureHandle>,
    pub render: Option<&'a TextureHandle>,
}

/// Draws the panel. `finer` describes a run with finer detail, if one is possible.
pub fn ui(
    snapshot: &Snapshot,
    quality: &QualityMonitor,
    pictures: &SummaryPictures<'_>,
    finer: Option<&str>,
    ui: &mut Ui,
) -> Option<SummaryAnswer> {
    let Some(opened) = &snapshot.opened else {
        ui.label("Nothing is open.");
        return None;
    };
    let mut asked = None;
    ScrollArea::vertical().auto_shrink(false).show(ui, |ui| {
        ui.add(Label::new(RichText::new(&opened.name).strong().size(16.0)).truncate())
            .on_hover_text(&opened.name);
        if snapshot.state == RunState::Ready && snapshot.frames_done == 0 {
            asked = before_training(snapshot, opened, pictures, ui);
        } else {
            asked = results(snapshot, quality, pictures, finer, ui);
            ui.add_space(4.0);
            poses(snapshot, ui);
        }
        recording(snapshot, opened, ui);
    });
    asked
}

fn before_training(
    snapshot: &Snapshot,
    opened: &Opened,
    pictures: &SummaryPictures<'_>,
    ui: &mut Ui,
) -> Option<SummaryAnswer> {
    if let Some(photo) = pictures.photo {
        picture(photo, ui.available_width(), ui);
    }
    for line in describe_layout(opened) {
        ui.add(Label::new(line).wrap());
    }
    poses(snapshot, ui);
    ui.add_space(4.0);
    let text = format!("Train {}", wording::count(snapshot.n_frames, "frame"));
    let button = Button::new(RichText::new(text).size(18.0)).fill(ui.visuals().selection.bg_fill);
    let train = ui.add_sized(Vec2::new(ui.available_width(), 36.0), button);
    let train = train.on_hover_text(UiCommand::Train.hint(ui.ctx()));
    train.clicked().then_some(SummaryAnswer::Command(UiCommand::Train))
}

/// Draws whether the camera poses agree with the depth images, and the warnings about them.
fn poses(snapshot: &Snapshot, ui: &mut Ui) {
    let Some(check) = &snapshot.sampling.poses else { return };
    let agreement = RichText::new(wording::pose_agreement(check)).weak();
    let axes = check.opened.poses.name();
    ui.add(Label::new(agreement).wrap()).on_hover_text(format!("Axes of the poses: {axes}"));
    for warning in check.warnings() {
        ui.add(Label::new(SignalColor::Yellow.text(warning, ui)).wrap());
    }
}

fn results(
    snapshot: &Snapshot,
    quality: &QualityMonitor,
    pictures: &SummaryPictures<'_>,
    finer: Option<&str>,
    ui: &mut Ui,
) -> Option<SummaryAnswer> {
    ui.label(RichText::new(headline(snapshot)).size(15.0));
    let compares = pair(pictures, ui);
    ui.add_space(2.0);
    let result = quality.result();
    if let Some(point) = &result {
        ui.add(Label::new(RichText::new(verdict(point)).strong()).wrap()).on_hover_text(
            "By the correlation of fine structure with the photographs of views that were not trained",
        );
    }
    // Above the figures, so that a low window shows all of them.
    let next = if snapshot.state.is_at_rest() { next_steps(snapshot, finer, ui) } else { None };
    Grid::new("summary").num_columns(2).spacing([14.0, 3.0]).show(ui, |ui| {
        let figures = figures(snapshot, quality, result).into_iter().chain(facts(snapshot));
        for Figure { label, meaning, value } in figures {
            // Of bounded width, so that the values have room.
            ui.scope(|ui| {
                ui.set_max_width(LABEL_WIDTH);
                ui.add(Label::new(RichText::new(label).weak()).wrap()).on_hover_text(meaning);
            });
            ui.add(Label::new(value).wrap()).on_hover_text(meaning);
            ui.end_row();
        }
    });
    compares.then_some(SummaryAnswer::Compare).or(next)
}

/// Draws photograph and render side by side. Returns true if one is clicked.
fn pair(pictures: &SummaryPictures<'_>, ui: &mut Ui) -> bool {
    let SummaryPictures { photo: Some(photo), render } = pictures else { return false };
    let width = 0.5 * (ui.available_width() - ui.spacing().item_spacing.x);
    let column = |name: &str, texture: Option<&TextureHandle>, ui: &mut Ui| {
        ui.vertical(|ui| {
            ui.label(RichText::new(name).weak());
            match texture {
                Some(texture) => picture(texture, width, ui),
                None => drop(ui.allocate_space(scaled(photo.size_vec2(), width))),
            }
        });
    };
    let both = ui.horizontal_top(|ui| {
        column("Photograph", Some(photo), ui);
        column("Scene", *render, ui);
    });
    both.response.interact(Sense::click()).clicked()
}

fn scaled(size: Vec2, width: f32) -> Vec2 {
    size * (width / size.x).min(PICTURE_HEIGHT / size.y)
}

fn picture(texture: &TextureHandle, width: f32, ui: &mut Ui) {
    ui.add(Image::new(texture).fit_to_exact_size(scaled(texture.size_vec2(), width)));
}

fn headline(snapshot: &Snapshot) -> String {
    let (done, all) = (snapshot.frames_done, snapshot.n_frames);
    match (snapshot.source, snapshot.state) {
        (Source::Model, _) => wording::count(snapshot.model.components, "splat"),
        (_, RunState::Finished) => {
            format!("Done: {} in {:.1} s", wording::count(done, "frame"), snapshot.pace.trained_s)
        }
        (_, state) => format!("{}: {done} of {}", state.label(), wording::count(all, "frame")),
    }
}

/// Returns what detail and coverage mean, in words. Detail compares the scene with the recording's own
/// photographs, so the words need no scale that fits all recordings.
fn verdict(point: &QualityPoint) -> String {
    /// Correlation above which structure counts as visible.
    const SEEN: f64 = 0.5;
    /// Covered fraction of the pixels above which the rest is not mentioned.
    const COVERED: f64 = 0.98;
    let sharpness = match point.detail {
        Some(Detail { finest, .. }) if finest >= SEEN => "As sharp as the photographs",
        Some(Detail { second, .. }) if second >= SEEN => {
            "Nearly as sharp as the photographs; the finest structure is missing"
        }
        Some(_) => "Softer than the photographs; fine structure is missing",
        None => "The photographs have no fine structure to compare",
    };
    match point.covered {
        Some((_, share)) if share < COVERED => {
            format!("{sharpness}. {:.0} % of the pixels show no splats", 100.0 * (1.0 - share))
        }
        _ => sharpness.to_owned(),
    }
}

/// Row of the table of figures.
struct Figure {
    label: &'static str,
    /// Explanation for readers who do not know the figure.
    meaning: &'static str,
    value: String,
}

fn figure(label: &'static str, meaning: &'static str, value: String) -> Figure {
    Figure { label, meaning, value }
}

/// Returns the figures of quality. `result` is the mean over all views, once it is known.
fn figures(
    snapshot: &Snapshot,
    quality: &QualityMonitor,
    result: Option<QualityPoint>,
) -> Vec<Figure> {
    if snapshot.source != Source::Dataset {
        return Vec::new();
    }
    let views = "Photographs that were not trained, compared with the scene. PSNR in dB and SSIM: the higher, the closer. Detail: correlation of structure one and two pixels wide with the photographs, at most 1";
    let mut rows = vec![figure("New views", views, quality_text(snapshot, quality, result))];
    if let Some((psnr, share)) = result.and_then(|point| point.covered) {
        let text = format!("{psnr:.2} dB over {:.0} % of the pixels", 100.0 * share);
        let covered = "The same over the pixels that splats cover";
        rows.push(figure("… where the scene has splats", covered, text));
    }
    if let Some(point) = quality.side_result() {
        let text = format!("{:.2} dB, SSIM {:.3}", point.psnr, point.ssim);
        rows.push(figure("From the side", "Views away from the path of the camera", text));
    }
    rows
}

fn facts(snapshot: &Snapshot) -> Vec<Figure> {
    let mut rows = Vec::new();
    if let Some(ms) = snapshot.median_frame_ms() {
        let part = slowest_stage(&snapshot.frames.recent)
            .map_or(String::new(), |(stage, part)| format!(" ({stage}: {:.0} %)", 100.0 * part));
        let meaning = "Median training time of the latest frames, and the slowest stage. Latency shows all stages; coarser detail is faster";
        rows.push(figure("Speed", meaning, format!("{ms:.1} ms a frame{part}")));
    }
    if snapshot.source == Source::Dataset {
        let splats = "Coloured ellipsoids that make up the scene";
        rows.push(figure("Splats", splats, wording::grouped(snapshot.model.used)));
        let text = format!("{:.1} MB", snapshot.model.bytes as f64 * 1e-6);
        rows.push(figure("Model size", "Memory of splats and textures", text));
    }
    rows
}

fn quality_text(
    snapshot: &Snapshot,
    quality: &QualityMonitor,
    result: Option<QualityPoint>,
) -> String {
    let (done, all) = quality.progress();
    let text = |point: QualityPoint| {
        let detail = detail(", ", point.detail);
        format!("{:.2} dB, SSIM {:.3}{detail}", point.psnr, point.ssim)
    };
    match (result, &quality.problem, quality.history.last()) {
        (Some(point), ..) => format!("{} ({})", text(point), wording::count(all, "view")),
        (None, Some(_), _) => "could not be measured".to_owned(),
        (None, None, _) if all == 0 => "none".to_owned(),
        // An early figure beside “Done” would be taken for the result.
        (None, None, Some(&point)) if point.frames == snapshot.frames_done => {
            format!("{} ({done} of {all} views)", text(point))
        }
        (None, None, Some(&point)) if snapshot.state == RunState::Training => {
            format!("{} after {}", text(point), wording::count(point.frames, "frame"))
        }
        (None, None, _) => format!("measuring {}", wording::count(all, "view")),
    }
}

fn next_steps(snapshot: &Snapshot, finer: Option<&str>, ui: &mut Ui) -> Option<SummaryAnswer> {
    ui.add_space(4.0);
    let mut answer = None;
    let mut offer = |ui: &mut Ui, text: &str, hint: &str, then: SummaryAnswer| {
        if ui.add(Button::new(text)).on_hover_text(hint).clicked() {
            answer = Some(then);
        }
    };
    ui.horizontal_wrapped(|ui| {
        if snapshot.source == Source::Dataset {
            let hint = UiCommand::ComparePhoto.tooltip();
            offer(ui, "Compare with photographs", hint, SummaryAnswer::Compare);
        }
        let hint = UiCommand::Export.hint(ui.ctx());
        offer(ui, "Export scene…", &hint, SummaryAnswer::Command(UiCommand::Export));
        if let Some(finer) = finer {
            offer(ui, "Retrain finer", finer, SummaryAnswer::Finer);
        }
    });
    ui.add_space(4.0);
    answer
}

/// Draws the properties of what is open, the skipped frames, and the photographs that do not fit.
fn recording(snapshot: &Snapshot, opened: &Opened, ui: &mut Ui) {
    section(if snapshot.source == Source::Model { "Model" } else { "Recording" }, ui);
    Grid::new("info").num_columns(2).striped(true).show(ui, |ui| {
        for (label, value) in &opened.info {
            ui.label(RichText::new(label).weak());
            ui.add(Label::new(value).wrap());
            ui.end_row();
        }
    });
    let skipped = snapshot.frames.skipped.iter().map(|s| s.message.as_str());
    let outliers = snapshot.frames.outliers.iter().map(String::as_str);
    list("Skipped frames", skipped, ui);
    list("Photographs that contradict the scene", outliers, ui);
}

fn list<'a>(title: &str, messages: impl ExactSizeIterator<Item = &'a str>, ui: &mut Ui) {
    if messages.len() == 0 {
        return;
    }
    section(&format!("{title}: {}", messages.len()), ui);
    for message in messages {
        ui.add(Label::new(message).wrap());
    }
}

fn describe_layout(opened: &Opened) -> Vec<String> {
    let Some(dataset) = &opened.dataset else { return Vec::new() };
    let mut lines = vec![wording::layout(dataset.layout).to_owned()];
    for (i, split) in dataset.splits.iter().enumerate() {
        let Some(first) = split.frames.first() else { continue };
        let k = &first.camera.intrinsics;
        let n = split.frames.len();
        let trained = opened.plan.as_ref().filter(|plan| plan.split == i);
        let name = match trained {
            Some(_) => "Training".to_owned(),
            None => format!("Split “{}”", split.name),
        };
        let what = match (split.has_depth, trained.map(|plan| plan.first_pass().len())) {
            (_, Some(trained)) if trained == n => String::new(),
            (_, Some(trained)) => format!(", {trained} of them trained"),
            (true, None) => String::new(),
            (false, None) => ", colour only".to_owned(),
        };
        let frames = wording::count(n, "frame");
        lines.push(format!("{name}: {frames}, {}×{}{what}", k.width, k.height));
    }
    lines
}

/// Frame and state of the scene that a render of the panel shows: serial number of what is open, trained
/// frames, and split and index of the frame.
type RenderKey = (u64, usize, (usize, usize));

/// Render of the scene for the panel, computed on another thread while training is at rest.
#[derive(Default)]
pub struct SummaryRender {
    job: RestingJob<RenderKey, ColorImage>,
    shown: Option<(RenderKey, TextureHandle)>,
}

impl SummaryRender {
    /// Returns the render of the scene at a frame's camera once it is ready. If `is_at_rest`, starts it.
    pub fn get(
        &mut self,
        context: &Context,
        key: RenderKey,
        (camera, options): (Camera, RenderOptions),
        scene: &Arc<SplatSet>,
        (is_at_rest, waker): (bool, &Waker),
    ) -> Option<&TextureHandle> {
        // A panic of rendering leaves the place empty.
        if let Some((done, Ok(image))) = self.job.take() {
            let texture = context.load_texture("summary render", image, TextureOptions::LINEAR);
            self.shown = Some((done, texture));
        }
        let is_new = self.shown.as_ref().is_none_or(|(shown, _)| *shown != key);
        if is_at_rest && is_new && self.job.is_ready(false) {
            let scene = scene.clone();
            let draw = move || {
                let k = &camera.intrinsics;
                // As large as the photograph beside it, so that neither looks sharper.
                let scale = (MAX_SIDE as f64 / f64::from(k.width.max(k.height))).min(1.0);
                let camera = Camera { intrinsics: k.scaled(scale), ..camera };
                let picture = CpuRenderer::new().render(scene.view(), &camera, &options).color;
                ColorImage::from_rgb([picture.width, picture.height], &picture.to_rgb8())
            };
            // Without a thread the place stays empty.
            let _ = self.job.start("summary", key, waker.clone(), draw);
        }
        let is_same = |(serial, _, frame): &RenderKey| (*serial, *frame) == (key.0, key.2);
        self.shown.as_ref().filter(|(shown, _)| is_same(shown)).map(|(_, texture)| texture)
    }
}

/// Returns the frame whose photograph the panel shows: the held-out view of median PSNR once all are
/// measured, otherwise the latest trained frame, otherwise the first one.
pub fn shown_frame(
    snapshot: &Snapshot,
    opened: &Opened,
    quality: &QualityMonitor,
) -> Option<FrameRef> {
    let median = || {
        quality.result()?;
        let view = quality.views.get(quality.views.len() / 2)?;
        let split = quality.evaluation.as_ref()?.new_views.split;
        FrameRef::at(opened.dataset.as_ref()?, split, view.index)
    };
    let latest = || FrameRef::trained(opened, snapshot.frames.recent.last().map_or(0, |f| f.index));
    median().or_else(latest)
}

pub const WHAT_HAPPENS: &str = "Turns photographs with depth into a Gaussian-splat scene while you watch, \
                                using each frame once";

/// Draws the start page below the notices, which cover the top `noticed` points of the viewport. Returns
/// the requested command.
pub fn start(snapshot: &Snapshot, noticed: f32, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    ui.vertical_centered(|ui| {
        ui.add_space((ui.available_height() * 0.22).max(noticed + 10.0));
        if let Some(followed) = &snapshot.following.recording {
            let path = followed.path.display();
            ui.label(RichText::new(format!("Waiting for the first frame of {path}")).size(22.0));
            ui.label(followed.problem.as_deref().unwrap_or_default());
            return;
        }
        if snapshot.state == RunState::Loading {
            ui.label(RichText::new("Opening…").size(22.0));
            return;
        }
        ui.label(RichText::new("VBGS Studio").size(28.0).strong());
        ui.label(RichText::new(WHAT_HAPPENS).size(15.0));
        ui.add_space(18.0);
        target(ui);
        ui.add_space(12.0);
        let big = |text: &str| Button::new(RichText::new(text).size(15.0)).min_size(BUTTON);
        let open = ui.add(big(UiCommand::Open.label()));
        if open.on_hover_text(UiCommand::Open.hint(ui.ctx())).clicked() {
            asked = Some(UiCommand::Open);
        }
        let demo = ui.add(big("Try the synthetic scene"));
        if demo.on_hover_text(UiCommand::OpenDemo.hint(ui.ctx())).clicked() {
            asked = Some(UiCommand::OpenDemo);
        }
    });
    asked
}

const BUTTON: Vec2 = Vec2::new(220.0, 32.0);

/// Draws an outlined target area for dropped folders. The whole window accepts drops.
fn target(ui: &mut Ui) {
    let width = (ui.available_width() - 40.0).clamp(100.0, 560.0);
    let line = Stroke::new(1.5, Color32::from_gray(110));
    // A frame, not a painted rectangle: it grows when lines wrap in a narrow window.
    let frame = Frame::new().stroke(line).corner_radius(8.0).inner_margin(14.0);
    ui.allocate_ui(Vec2::new(width, 0.0), |ui| {
        frame.show(ui, |ui| {
            ui.vertical_centered(|ui| {
                ui.label(RichText::new("Your own capture: drop a folder").size(20.0));
                ui.label("from a depth camera, a phone or a renderer; the format is detected");
                let endings = listed(&READ_ENDINGS);
                ui.label(
                    RichText::new(format!(
                        "or a checkpoint to resume, or splats to view ({endings})"
                    ))
                    .weak(),
                );
            });
        });
    });
}
