//! Strip of the dataset's frames with their state and error; selects the camera of the viewport.
//!
//! Only visible frames are laid out and decoded, so the cost does not depend on the length of the dataset.

use super::frame_cell::{FrameCell, draw, tooltip_text};
use super::signal_color::SignalColor;
use crate::app::command::UiCommand;
use crate::app::frame_outcomes::{FrameOutcomes, FrameState};
use crate::app::quality::QualityMonitor;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::thumbnails::Thumbnails;
use crate::app::wording;
use eframe::egui::scroll_area::{DragScroll, ScrollSource};
use eframe::egui::{
    Button, Label, Rangef, Rect, Response, RichText, Role, ScrollArea, Sense, Ui, Vec2, WidgetInfo,
    pos2,
};

/// Least and largest height of the strip with its header, points.
pub const HEIGHTS: Rangef = Rangef { min: 76.0, max: 320.0 };
/// Font size of the header, points.
const SIZE: f32 = 11.0;
/// Least width of a frame, points; leaves room for its number and error.
const MIN_WIDTH: f32 = 56.0;

pub struct StripContext<'a> {
    pub snapshot: &'a Snapshot,
    pub opened: &'a Opened,
    pub outcomes: &'a FrameOutcomes,
    pub quality: &'a QualityMonitor,
    /// Frame whose camera the viewport shows.
    pub shown: Option<&'a FrameRef>,
}

#[derive(Clone, Debug, PartialEq)]
pub enum StripAnswer {
    /// Fold or unfold the strip.
    Fold,
    /// Move to the camera of a frame.
    Show(FrameRef),
    /// Show the camera of a frame while the pointer is held down.
    Preview(FrameRef),
}

/// Scroll position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StripPosition {
    /// Serial of the open dataset and index of the frame last scrolled to.
    scrolled_to: Option<(u64, usize)>,
}

/// Draws the header: fold button, recording status, skipped frames and training order.
pub fn header(context: &StripContext<'_>, is_open: bool, ui: &mut Ui) -> Option<StripAnswer> {
    let StripContext { snapshot, opened, .. } = context;
    let mut asked = None;
    ui.horizontal(|ui| {
        let command = UiCommand::FrameStrip;
        let button = Button::selectable(is_open, command.label()).small();
        if ui.add(button).on_hover_text(command.hint(ui.ctx())).clicked() {
            asked = Some(StripAnswer::Fold);
        }
        let live = recording_status(snapshot);
        if let Some((text, hint)) = &live {
            let color = SignalColor::Green.for_theme(ui.visuals().dark_mode);
            ui.label(RichText::new(text).size(SIZE).color(color)).on_hover_text(hint);
        }
        if !snapshot.skipped.is_empty() {
            let color = SignalColor::Red.for_theme(ui.visuals().dark_mode);
            let text = format!("{} skipped", snapshot.skipped.len());
            let hint = "Unusable frames are crossed out; hover over one for the reason";
            ui.label(RichText::new(text).size(SIZE).color(color)).on_hover_text(hint);
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

/// Status of the followed recording, and its path or problem.
fn recording_status(snapshot: &Snapshot) -> Option<(String, String)> {
    let followed = snapshot.followed.as_ref()?;
    let path = followed.path.display().to_string();
    let ahead = snapshot.n_frames.saturating_sub(snapshot.frames_done + snapshot.skipped.len());
    let text = match (&followed.problem, followed.is_waiting) {
        (Some(_), _) => "Live: the recording cannot be read".to_owned(),
        (None, true) => "Live: waiting for the next frame".to_owned(),
        (None, false) => format!("Live: {ahead} frames behind"),
    };
    Some((text, followed.problem.clone().unwrap_or(path)))
}

/// Draws the frames in the remaining room.
pub fn ui(
    context: &StripContext<'_>,
    position: &mut StripPosition,
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
    if let Some(number) = frame_to_scroll_to(context, position, ui.rect_contains_pointer(view)) {
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
            let response = draw_frame(context, &frame, thumbnails.as_deref_mut(), rect, ui);
            if response.clicked() {
                asked = Some(StripAnswer::Show(frame));
            } else if let Some(pointer) = response.interact_pointer_pos()
                && response.dragged()
            {
                let at = ((pointer.x - start.x) / width).clamp(0.0, (n - 1) as f32) as usize;
                asked = FrameRef::numbered(dataset, at).map(StripAnswer::Preview);
            }
        }
    });
    asked
}

fn width_of(opened: &Opened, height: f32) -> f32 {
    let first = opened.dataset.as_ref().and_then(FrameRef::first);
    let aspect = first.map_or(1.0, |frame| {
        let k = frame.entry().camera.intrinsics;
        k.width as f32 / k.height as f32
    });
    FrameCell::width(height, aspect).max(MIN_WIDTH)
}

/// Frame to scroll to if the viewport or training moved to another one; `None` while the pointer is over the
/// strip.
fn frame_to_scroll_to(
    context: &StripContext<'_>,
    position: &mut StripPosition,
    is_used: bool,
) -> Option<usize> {
    let StripContext { snapshot, opened, outcomes, shown, .. } = context;
    let trained = || {
        let latest = outcomes.latest_position().filter(|_| snapshot.state == RunState::Training)?;
        FrameRef::trained(opened, latest)
    };
    let number = shown.map(FrameRef::number).or_else(|| trained().map(|frame| frame.number()))?;
    let to = Some((opened.serial, number));
    if is_used || position.scrolled_to == to {
        return None;
    }
    position.scrolled_to = to;
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
    let evaluated = quality.evaluation().filter(|evaluation| evaluation.new_views.split == split);
    let measured = evaluated.and_then(|_| quality.views().iter().find(|view| view.index == index));
    let pictures = thumbnails.map(|thumbnails| thumbnails.pictures(ui.ctx(), frame));
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
        pictures: pictures.unwrap_or_default(),
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
