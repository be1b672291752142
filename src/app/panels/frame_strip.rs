//! Strip of the dataset's frames with their state and PSNR. Selects the camera of the viewport. A timeline
//! above the frames marks the stored scenes of the run and walks back to them.
//!
//! Only visible frames are laid out and decoded, so the cost does not depend on the length of the dataset.

use super::controls::named;
use super::signal_color::SignalColor;
use crate::app::command::UiCommand;
use crate::app::fonts::icon;
use crate::app::frame_outcomes::{FrameOutcomes, FrameState};
use crate::app::quality::QualityMonitor;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::app::viewer::frame_refs::{Direction, FrameRef};
use crate::app::viewer::thumbnails::{Pictures, Thumbnails};
use crate::app::wording;
use crate::eval::report::ViewReport;
use eframe::egui::scroll_area::{DragScroll, ScrollSource};
use eframe::egui::{
    Align2, Button, Color32, FontId, Label, Rangef, Rect, Response, RichText, Role, ScrollArea,
    Sense, Shape, Stroke, StrokeKind, TextureHandle, Ui, Vec2, WidgetInfo, pos2,
};

/// Minimum and maximum height of the strip with its header, points.
pub const HEIGHTS: Rangef = Rangef { min: 76.0, max: 320.0 };
const SIZE: f32 = 11.0;
/// Minimum width of a frame, points.
// Leaves room for its number and error.
const MIN_WIDTH: f32 = 56.0;

pub struct StripContext<'a> {
    pub snapshot: &'a Snapshot,
    pub opened: &'a Opened,
    pub outcomes: &'a FrameOutcomes,
    pub quality: &'a QualityMonitor,
    /// Frame whose camera the viewport shows.
    pub shown: Option<&'a FrameRef>,
    /// Numbers of processed frames of which a scene is stored, ascending.
    pub moments: &'a [usize],
    /// The one of the earlier scene that the viewport shows, if it shows one.
    pub earlier: Option<usize>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum StripAnswer {
    Step(Direction),
    Show(FrameRef),
    /// Shows the camera of a frame while the pointer is held down.
    Preview(FrameRef),
    /// Shows the scene as it was after this number of frames; `None` shows the newest one.
    WalkBack(Option<usize>),
}

/// Serial number of the open dataset, number of the frame last scrolled to, and the strip's size then, points.
pub type ScrolledTo = Option<(u64, usize, Vec2)>;

/// Draws the header with the number of the camera in view, recording status and training order.
pub fn header(context: &StripContext<'_>, ui: &mut Ui) -> Option<StripAnswer> {
    let StripContext { snapshot, opened, .. } = context;
    let mut asked = None;
    ui.horizontal(|ui| {
        let text = |text: String| Label::new(RichText::new(text).size(SIZE)).extend();
        match context.shown {
            None => drop(ui.add(text("Free camera".to_owned()))),
            // A free camera has no neighbours: a click on a frame leads to one that has.
            Some(frame) => {
                let mut step = |icon, command: UiCommand, direction, ui: &mut Ui| {
                    let button = named(ui.add(Button::new(icon).small()), command.label());
                    if button.on_hover_text(command.hint(ui.ctx())).clicked() {
                        asked = Some(StripAnswer::Step(direction));
                    }
                };
                step(icon::PREVIOUS, UiCommand::PreviousCamera, Direction::Back, ui);
                let (number, all) = (frame.number() + 1, frame.n_frames());
                ui.add(text(format!("Camera {number} of {all}")));
                step(icon::NEXT, UiCommand::NextCamera, Direction::Forth, ui);
            }
        }
        if let Some(earlier) = context.earlier {
            let text = SignalColor::Yellow.text(format!("Scene after frame {earlier}"), ui);
            ui.add(Label::new(text.size(SIZE)).extend());
            let button = ui.add(Button::new("Newest scene").small());
            if button.on_hover_text("Show the scene as it is now").clicked() {
                asked = Some(StripAnswer::WalkBack(None));
            }
        }
        let live = recording_status(snapshot);
        if let Some((text, hint)) = &live {
            ui.label(SignalColor::Green.text(text, ui).size(SIZE)).on_hover_text(hint);
        }
        if let (Some(plan), Some(selection)) = (&opened.plan, &opened.selection) {
            let order = RichText::new(wording::run_order(selection, plan)).size(SIZE).weak();
            let hint = match &plan.held_out {
                Some(why) => format!("Held out: {why}"),
                None => "Training order of the frames".to_owned(),
            };
            ui.add(Label::new(order).truncate()).on_hover_text(hint);
        }
    });
    asked
}

/// Returns the status text of the followed recording, and the text of its tooltip: the problem or the path.
fn recording_status(snapshot: &Snapshot) -> Option<(String, String)> {
    let followed = snapshot.following.recording.as_ref()?;
    let path = followed.path.display().to_string();
    let ahead =
        snapshot.n_frames.saturating_sub(snapshot.frames_done + snapshot.frames.skipped.len());
    let text = match (&followed.problem, followed.is_waiting) {
        (Some(_), _) => "Live: the recording cannot be read".to_owned(),
        (None, true) => "Live: waiting for the next frame".to_owned(),
        (None, false) => format!("Live: {ahead} frames behind"),
    };
    Some((text, followed.problem.clone().unwrap_or(path)))
}

pub fn ui(
    context: &StripContext<'_>,
    scrolled_to: &mut ScrolledTo,
    mut thumbnails: Option<&mut Thumbnails>,
    ui: &mut Ui,
) -> Option<StripAnswer> {
    let dataset = context.opened.dataset.as_ref()?;
    let n = dataset.splits.iter().map(|split| split.frames.len()).sum::<usize>();
    let (view, height) = (ui.available_rect_before_wrap(), ui.available_height());
    let width = width_of(context.opened, height);
    ui.style_mut().always_scroll_the_only_direction = true;
    // Dragging previews cameras, so it must not scroll.
    let source = ScrollSource { drag: DragScroll::Never, ..ScrollSource::default() };
    let mut area = ScrollArea::horizontal().auto_shrink(false).scroll_source(source);
    let is_used = ui.rect_contains_pointer(view);
    if let Some(number) = frame_to_scroll_to(context, scrolled_to, view.size(), is_used) {
        let middle = (number as f32 + 0.5) * width;
        let last = (n as f32 * width - view.width()).max(0.0);
        area = area.horizontal_scroll_offset((middle - 0.5 * view.width()).clamp(0.0, last));
    }
    let mut asked = None;
    area.show_viewport(ui, |ui, shown| {
        ui.set_min_size(Vec2::new(n as f32 * width, height));
        let start = ui.min_rect().left_top();
        let first = (shown.left() / width).floor().max(0.0) as usize;
        let end = ((shown.right() / width).ceil().max(0.0) as usize).min(n);
        for number in first..end {
            let Some(frame) = FrameRef::numbered(dataset, number) else { continue };
            let corner = pos2(start.x + number as f32 * width, start.y);
            let rect = Rect::from_min_size(corner, Vec2::new(width, height));
            let rect = rect.with_min_y(rect.top() + TIMELINE);
            let response = draw_frame(context, &frame, thumbnails.as_deref_mut(), rect, ui);
            if response.clicked() {
                asked = Some(StripAnswer::Show(frame));
            } else if let Some(pointer) = response.interact_pointer_pos()
                && response.dragged()
            {
                // The pointer may leave the strip during a drag.
                let at = ((pointer.x - start.x) / width).clamp(0.0, (n - 1) as f32) as usize;
                asked = FrameRef::numbered(dataset, at).map(StripAnswer::Preview);
            }
        }
        let timeline = Rect::from_min_size(start, Vec2::new(n as f32 * width, TIMELINE));
        asked = timeline_ui(context, timeline.intersect(ui.clip_rect()), (start.x, width), ui)
            .or(asked.take());
    });
    asked
}

/// Height of the row above the frames that marks stored scenes and holds the playhead, points.
const TIMELINE: f32 = 10.0;

/// Draws a mark for each stored scene above the frame trained last before it, and the playhead. Dragging over
/// the row, or a click on it, walks back to the latest scene stored at that frame. `start` is where the frames
/// begin, `width` that of one.
fn timeline_ui(
    context: &StripContext<'_>,
    row: Rect,
    (start, width): (f32, f32),
    ui: &mut Ui,
) -> Option<StripAnswer> {
    let StripContext { opened, outcomes, moments, earlier, .. } = context;
    let n_seen = outcomes.latest_position()? + 1;
    let dataset = opened.dataset.as_ref().filter(|_| !moments.is_empty())?;
    let middle_of = |n_seen: usize| {
        let frame = FrameRef::trained(opened, n_seen.checked_sub(1)?)?;
        Some(pos2(start + (frame.number() as f32 + 0.5) * width, row.center().y))
    };
    let id = ui.scope_id().with("timeline");
    let response = ui.interact(row, id, Sense::CLICK | Sense::DRAG);
    let shown = earlier.unwrap_or(n_seen);
    response.widget_info(|| WidgetInfo::slider(true, shown as f64, "Walk back"));
    let (painter, visuals) = (ui.painter(), ui.visuals());
    let line = Stroke::new(1.0, visuals.weak_text_color().gamma_multiply(0.4));
    painter.hline(row.x_range(), row.center().y, line);
    for at in moments.iter().filter_map(|&moment| middle_of(moment)) {
        painter.circle_filled(at, 2.5, visuals.weak_text_color());
    }
    if let Some(at) = middle_of(shown) {
        let half = Vec2::new(5.0, 0.5 * TIMELINE);
        let corners = [at - half, at + Vec2::new(half.x, -half.y), at + Vec2::new(0.0, half.y)];
        let edge = Stroke::new(1.0, visuals.panel_fill);
        painter.add(Shape::convex_polygon(corners.to_vec(), LATEST, edge));
    }
    let response = response.on_hover_text("Drag: the scene as it was after a frame");
    let pointer =
        response.interact_pointer_pos().filter(|_| response.dragged() || response.clicked())?;
    let last = FrameRef::first(dataset)?.n_frames() - 1;
    let number = ((pointer.x - start) / width).clamp(0.0, last as f32) as usize;
    // Held-out frames and those that wait belong to the trained one before them.
    let mut seen = (0..=number)
        .rev()
        .filter_map(|number| outcomes.n_seen_at(FrameRef::numbered(dataset, number)?.position()));
    let asked = seen.next().unwrap_or(1).max(moments[0]);
    Some(StripAnswer::WalkBack((asked < n_seen).then_some(asked)))
}

fn width_of(opened: &Opened, height: f32) -> f32 {
    let first = opened.dataset.as_ref().and_then(FrameRef::first);
    let aspect = first.map_or(1.0, |frame| {
        let k = frame.entry().camera.intrinsics;
        k.width as f32 / k.height as f32
    });
    // Photograph and depth are one above the other.
    ((0.5 * pictures_height(height - TIMELINE)).max(1.0) * aspect + 2.0 * MARGIN).max(MIN_WIDTH)
}

/// Returns the number of the frame to scroll to, if the viewport or training moved to another frame, or if the
/// strip has another size.
/// `is_used` is true while the pointer is over the strip.
fn frame_to_scroll_to(
    context: &StripContext<'_>,
    scrolled_to: &mut ScrolledTo,
    size: Vec2,
    is_used: bool,
) -> Option<usize> {
    let StripContext { snapshot, opened, outcomes, shown, .. } = context;
    let trained = || {
        let latest = outcomes.latest_position().filter(|_| snapshot.state == RunState::Training)?;
        FrameRef::trained(opened, latest)
    };
    let number = shown.map(FrameRef::number).or_else(|| trained().map(|frame| frame.number()))?;
    let to = Some((opened.serial, number, size));
    // Frames must not move while the pointer is over them.
    if is_used || *scrolled_to == to {
        return None;
    }
    *scrolled_to = to;
    Some(number)
}

fn draw_frame(
    context: &StripContext<'_>,
    frame: &FrameRef,
    thumbnails: Option<&mut Thumbnails>,
    rect: Rect,
    ui: &mut Ui,
) -> Response {
    let StripContext { opened, outcomes, quality, shown, .. } = context;
    let entry = frame.entry();
    let state = outcomes.state_of(frame.position(), &entry.name);
    let (split, index) = frame.position();
    let evaluated =
        quality.evaluation.as_ref().filter(|evaluation| evaluation.new_views.split == split);
    let measured = evaluated.and_then(|_| quality.views.iter().find(|view| view.index == index));
    // Requested only when drawn, so that decoding follows the visible frames.
    let pictures = thumbnails.and_then(|thumbnails| thumbnails.pictures(ui.ctx(), frame));
    let latest = outcomes.latest_position();
    let is_latest = match state {
        FrameState::Trained(position, _) => latest == Some(position),
        _ => false,
    };
    let is_shown = shown.is_some_and(|shown| shown.position() == frame.position());
    let cell = FrameCell {
        frame,
        state,
        measured,
        pictures,
        is_latest,
        is_shown,
        is_first_of_split: index == 0
            && opened.dataset.as_ref().is_some_and(|d| d.splits.len() > 1),
    };
    // Not focusable by Tab: shortcuts step through the frames.
    let id = ui.scope_id().with(("frame", frame.number()));
    let response = ui.interact(rect, id, Sense::CLICK | Sense::DRAG);
    let label = format!("Frame {}", frame.number() + 1);
    response.widget_info(|| WidgetInfo::selected(Role::Button, true, is_shown, &label));
    draw(&cell, &response, ui);
    response.on_hover_ui(|ui| {
        ui.label(tooltip_text(&cell));
    })
}

const CAPTION: f32 = 13.0;
const BAR: f32 = 3.0;
const MARGIN: f32 = 2.0;
const FONT: FontId = FontId::proportional(10.0);
/// Colour of the last trained frame, the same as in the viewport.
const LATEST: Color32 = Color32::from_rgb(255, 170, 60);

struct FrameCell<'a> {
    frame: &'a FrameRef,
    state: FrameState,
    /// Metrics of the frame as a held-out view, if measured.
    measured: Option<&'a ViewReport>,
    pictures: Option<&'a Pictures<TextureHandle>>,
    is_latest: bool,
    is_shown: bool,
    /// True if the caption includes the split's name, because the frame is the first of the split.
    is_first_of_split: bool,
}

impl FrameCell<'_> {
    fn problem(&self) -> Option<&str> {
        self.pictures?.problem.as_deref()
    }

    /// Returns the frame's PSNR, dB: that of the held-out view if measured, otherwise the one before
    /// training on the frame.
    fn psnr(&self) -> Option<f64> {
        let before = match &self.state {
            FrameState::Trained(_, Some(outcome)) => outcome.psnr_before,
            _ => None,
        };
        self.measured.map(|view| view.psnr).or(before)
    }
}

/// Returns the height of both pictures of a frame of this height.
fn pictures_height(height: f32) -> f32 {
    height - BAR - CAPTION - 3.0 * MARGIN
}

/// Paints a frame of the strip into the rectangle of `response`.
fn draw(cell: &FrameCell<'_>, response: &Response, ui: &Ui) {
    let (rect, visuals) = (response.rect.shrink2(Vec2::new(1.0, 0.0)), ui.visuals());
    let painter = ui.painter();
    if cell.is_shown || response.hovered() {
        let fill = if cell.is_shown { visuals.selection.bg_fill } else { visuals.faint_bg_color };
        painter.rect_filled(rect, 2.0, fill);
    }
    let bar = Rect::from_min_max(rect.min, pos2(rect.right(), rect.top() + BAR));
    painter.rect_filled(bar, 1.0, color(cell, visuals.dark_mode));
    let top = bar.bottom() + MARGIN;
    let half = 0.5 * pictures_height(rect.height());
    let known = cell.pictures.map_or([None; 2], |p| [p.photo.as_ref(), p.depth.as_ref()]);
    for (i, texture) in known.into_iter().enumerate() {
        let corner = pos2(rect.left() + MARGIN, top + i as f32 * (half + MARGIN));
        let room = Rect::from_min_size(corner, Vec2::new(rect.width() - 2.0 * MARGIN, half));
        match texture {
            Some(texture) => picture(texture, room, ui),
            None => drop(painter.rect_filled(room, 1.0, visuals.extreme_bg_color)),
        }
    }
    let pictures = Rect::from_min_max(
        pos2(rect.left() + MARGIN, top),
        pos2(rect.right() - MARGIN, top + 2.0 * half + MARGIN),
    );
    if matches!(cell.state, FrameState::Skipped(_)) || cell.problem().is_some() {
        let stroke = Stroke::new(2.0, SignalColor::Red.for_theme(visuals.dark_mode));
        painter.line_segment([pictures.left_top(), pictures.right_bottom()], stroke);
        painter.line_segment([pictures.right_top(), pictures.left_bottom()], stroke);
    }
    if cell.is_latest {
        painter.rect_stroke(pictures, 1.0, Stroke::new(2.0, LATEST), StrokeKind::Inside);
    }
    caption(cell, rect, ui);
}

fn picture(texture: &TextureHandle, room: Rect, ui: &Ui) {
    let size = texture.size_vec2();
    let scale = (room.width() / size.x).min(room.height() / size.y);
    let rect = Rect::from_center_size(room.center(), size * scale);
    let all = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(texture.id(), rect, all, Color32::WHITE);
}

/// Draws the frame number on the left. The first frame of a split also shows the split's name; other
/// frames show the PSNR on the right.
fn caption(cell: &FrameCell<'_>, rect: Rect, ui: &Ui) {
    let (painter, visuals) = (ui.painter(), ui.visuals());
    let middle = rect.bottom() - 0.5 * CAPTION;
    let strong = if cell.is_shown { visuals.selection.stroke.color } else { visuals.text_color() };
    let mut number = (cell.frame.number() + 1).to_string();
    if cell.is_first_of_split {
        number = format!("{number} {}", cell.frame.split().name);
    }
    let at = pos2(rect.left() + MARGIN, middle);
    painter.with_clip_rect(rect.intersect(ui.clip_rect())).text(
        at,
        Align2::LEFT_CENTER,
        number,
        FONT,
        if cell.is_shown { strong } else { visuals.weak_text_color() },
    );
    // The split's name needs the room of the error.
    if let Some(psnr) = cell.psnr().filter(|_| !cell.is_first_of_split) {
        let at = pos2(rect.right() - MARGIN, middle);
        painter.text(at, Align2::RIGHT_CENTER, format!("{psnr:.1}"), FONT, strong);
    }
}

fn color(cell: &FrameCell<'_>, is_dark: bool) -> Color32 {
    match &cell.state {
        _ if cell.is_latest => LATEST,
        FrameState::Trained(..) => SignalColor::Green.for_theme(is_dark),
        FrameState::Pending(_) => SignalColor::Blue.for_theme(is_dark).gamma_multiply(0.5),
        FrameState::Skipped(_) => SignalColor::Red.for_theme(is_dark),
        FrameState::NotInRun => Color32::TRANSPARENT,
    }
}

fn tooltip_text(cell: &FrameCell<'_>) -> String {
    let (frame, split) = (cell.frame, &cell.frame.split().name);
    let name = &frame.entry().name;
    let mut lines =
        vec![format!("Frame {} of {}: {name}, {split}", frame.number() + 1, frame.n_frames())];
    match &cell.state {
        FrameState::NotInRun => lines.push("Not trained: not part of the run".to_owned()),
        FrameState::Pending(position) => {
            lines.push(format!("Pending: number {} of the run", position + 1));
        }
        FrameState::Trained(position, outcome) => {
            lines.push(format!("Trained, number {} of the run", position + 1));
            if let Some(outcome) = outcome {
                let (n, elbo) = (outcome.points, outcome.elbo_mean);
                lines.push(format!("{n} points, mean ELBO {elbo:.2} nats"));
                lines.extend(outcome.psnr_before.map(|psnr| {
                    format!("{psnr:.1} dB: photograph against the scene before training on it")
                }));
            }
        }
        FrameState::Skipped(why) => lines.push(format!("Skipped: {why}")),
    }
    if let Some(view) = cell.measured {
        lines.push(format!("{:.1} dB, SSIM {:.3} as a held-out view", view.psnr, view.ssim));
    }
    // The reason of a skipped frame already says so.
    if let (Some(problem), false) = (cell.problem(), matches!(cell.state, FrameState::Skipped(_))) {
        lines.push(format!("Cannot be read: {problem}"));
    }
    lines.push("Click: move to its camera; drag: preview cameras".to_owned());
    lines.join("\n")
}
