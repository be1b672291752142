//! One frame of the strip: photograph above depth, number, state and error.

use super::signal_color::SignalColor;
use crate::app::frame_outcomes::FrameState;
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::thumbnails::FramePictures;
use crate::eval::report::ViewReport;
use eframe::egui::{
    Align2, Color32, FontId, Rect, Response, Stroke, StrokeKind, TextureHandle, Ui, Vec2, pos2,
};

/// Height of the caption below the pictures, points.
const CAPTION: f32 = 13.0;
/// Height of the bar above the pictures, coloured by the frame's state, points.
const BAR: f32 = 3.0;
/// Margin around the pictures, points.
const MARGIN: f32 = 2.0;
const FONT: FontId = FontId::proportional(10.0);
/// Colour of the last trained frame, as in the viewport.
const LATEST: Color32 = Color32::from_rgb(255, 170, 60);

pub struct FrameCell<'a> {
    pub frame: &'a FrameRef,
    pub state: FrameState,
    /// Error of the frame as a held-out view, if measured.
    pub measured: Option<&'a ViewReport>,
    pub pictures: FramePictures<'a>,
    /// True for the last trained frame.
    pub is_latest: bool,
    /// True if the viewport shows the frame's camera.
    pub is_shown: bool,
    /// True if the caption includes the split's name.
    pub is_first_of_split: bool,
}

impl FrameCell<'_> {
    /// Width of a cell of this height for pictures of this width/height ratio, points.
    pub fn width(height: f32, aspect: f32) -> f32 {
        (0.5 * pictures_height(height)).max(1.0) * aspect + 2.0 * MARGIN
    }

    /// PSNR of the frame, dB: as a held-out view if measured, otherwise before training on it.
    fn psnr(&self) -> Option<f64> {
        let before = match &self.state {
            FrameState::Trained(_, Some(outcome)) => outcome.psnr_before,
            _ => None,
        };
        self.measured.map(|view| view.psnr).or(before)
    }
}

/// Height available for both pictures.
fn pictures_height(height: f32) -> f32 {
    height - BAR - CAPTION - 3.0 * MARGIN
}

/// Paints the frame into the rectangle of `response`.
pub fn draw(cell: &FrameCell<'_>, response: &Response, ui: &Ui) {
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
    for (i, texture) in [cell.pictures.photo, cell.pictures.depth].into_iter().enumerate() {
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
    if matches!(cell.state, FrameState::Skipped(_)) || cell.pictures.problem.is_some() {
        let stroke = Stroke::new(2.0, SignalColor::Red.for_theme(visuals.dark_mode));
        painter.line_segment([pictures.left_top(), pictures.right_bottom()], stroke);
        painter.line_segment([pictures.right_top(), pictures.left_bottom()], stroke);
    }
    if cell.is_latest {
        painter.rect_stroke(pictures, 1.0, Stroke::new(2.0, LATEST), StrokeKind::Inside);
    }
    caption(cell, rect, ui);
}

/// Paints a picture as large as fits, centred.
fn picture(texture: &TextureHandle, room: Rect, ui: &Ui) {
    let size = texture.size_vec2();
    let scale = (room.width() / size.x).min(room.height() / size.y);
    let rect = Rect::from_center_size(room.center(), size * scale);
    let all = Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0));
    ui.painter().image(texture.id(), rect, all, Color32::WHITE);
}

/// Number on the left, with the split's name on its first frame; error on the right.
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

/// Tooltip text.
pub fn tooltip_text(cell: &FrameCell<'_>) -> String {
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
    if let (Some(problem), false) =
        (cell.pictures.problem, matches!(cell.state, FrameState::Skipped(_)))
    {
        lines.push(format!("Cannot be read: {problem}"));
    }
    lines.push("Click: move to its camera; drag: preview cameras".to_owned());
    lines.join("\n")
}
