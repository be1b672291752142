//! Captions over the picture: names of the compared pictures, PSNR, hints.

use super::mode::ViewMode;
use super::photo::PhotoResult;
use super::picture_request::{ComparedPicture, Partner, PictureRequest};
use super::stand::ViewPosition;
use super::{SceneView, overlay, pixel_status};
use crate::render::Renderer;
use crate::render::compare::Combination;
use eframe::egui::{Align2, Rect, Ui, Vec2};
use std::time::{Duration, Instant};

/// Time for which a hint is shown.
const HINT: Duration = Duration::from_secs(5);

impl SceneView {
    /// Draws divider, captions, metrics and hints over the picture.
    pub(super) fn draw_captions(
        &mut self,
        ui: &mut Ui,
        rect: Rect,
        request: &PictureRequest,
        result: Option<Result<PhotoResult, String>>,
    ) {
        let inner = rect.shrink(overlay::MARGIN);
        if let Some(second) = &request.second {
            let at = |share: [f32; 2]| rect.lerp_inside(Vec2::from(share));
            let compared = Rect::from_min_max(at(second.area.min), at(second.area.max));
            if let Combination::Wipe(_) = second.how
                && overlay::divider(ui, rect, compared, &mut self.divider)
            {
                // Counts as camera motion: the CPU renders at low resolution until the divider rests.
                self.moved_at = Instant::now();
            }
            self.captions(ui, inner.intersect(compared.shrink(overlay::MARGIN)), second);
        }
        let known = result.as_ref().and_then(|s| s.as_ref().ok());
        if let Some(pixel_counts) = known.and_then(|s| s.pixel_counts) {
            pixel_status::legend(&pixel_counts, inner.right_bottom(), ui);
        }
        let psnr = known.and_then(|s| s.psnr);
        if let Some(psnr) = psnr {
            let [r, g, b] = self.settings.background.rgb8();
            let tooltip = format!(
                "Whole photograph at its native size, as measured by `vbgs-studio eval --background #{r:02x}{g:02x}{b:02x} --exposure recorded`"
            );
            let compared = known.and_then(|s| s.compared_psnr).zip(self.compared());
            let compared = compared.map(|(psnr, model)| format!(" · {} {psnr:.2} dB", model.name));
            let text = format!("PSNR {psnr:.2} dB{}", compared.unwrap_or_default());
            overlay::plate(ui, inner.right_bottom(), Align2::RIGHT_BOTTOM, &text, &tooltip);
        }
        if let Some(text) = self.hint_now(ui, result) {
            overlay::plate(ui, inner.center_bottom(), Align2::CENTER_BOTTOM, &text, "");
        }
    }

    fn captions(&self, ui: &mut Ui, inner: Rect, second: &ComparedPicture) {
        let own = renderer_label(self.settings.renderer);
        let gain = self.settings.difference_gain.round();
        let (left, right) = match (&second.partner, second.how) {
            (Partner::Splats(_), Combination::Wipe(_)) => ("Projected".into(), Some("Exact")),
            (Partner::Model(model, _), Combination::Wipe(_)) => {
                ("Scene".to_owned(), Some(model.name.as_str()))
            }
            (Partner::Model(model, _), Combination::Difference(_)) => {
                (format!("|Scene − {}| × {gain}", model.name), None)
            }
            (Partner::Photo(_), Combination::Wipe(_)) if self.mode == ViewMode::Preparation => {
                (own.to_owned(), Some("Preparation"))
            }
            (Partner::Photo(_), Combination::Wipe(_)) => (own.to_owned(), Some("Photograph")),
            (Partner::Splats(_), Combination::Difference(_)) => {
                (format!("|Projected − exact| × {gain}"), None)
            }
            (Partner::Photo(_), Combination::Difference(_)) => {
                (format!("|{own} − photograph| × {gain}"), None)
            }
        };
        overlay::plate(ui, inner.left_top(), Align2::LEFT_TOP, &left, "");
        if let Some(right) = right {
            overlay::plate(ui, inner.right_top(), Align2::RIGHT_TOP, right, "");
        }
    }

    fn hint_now(&self, ui: &Ui, result: Option<Result<PhotoResult, String>>) -> Option<String> {
        if let Some(Err(problem)) = result {
            return Some(problem);
        }
        if let Some((text, since)) = &self.hint
            && since.elapsed() < HINT
        {
            // egui does not repaint without input, so the hint would stay.
            ui.ctx().request_repaint_after(HINT.saturating_sub(since.elapsed()));
            return Some(text.clone());
        }
        if let Some(past) = self.editor.displayed_past() {
            let (frame, of) = (past.n_frames, self.n_frames);
            return Some(format!("Scene after frame {frame} of {of} (Edit)"));
        }
        if let Some(last) = self.editor.born_until() {
            let (frame, of) = (last + 1, self.n_frames);
            return Some(format!(
                "Splats born up to frame {frame} of {of}, in their current state (Edit)"
            ));
        }
        if self.editor.is_box_selecting {
            return Some("Box select: drag over splats (B to exit)".to_owned());
        }
        if let Some(hint) = self.measure.hint() {
            return Some(hint.to_owned());
        }
        let is_away = self.mode.needs_frame() && self.place == ViewPosition::Free;
        is_away.then(|| "No photograph from this viewpoint: press [ or ] to go to one".to_owned())
    }
}

fn renderer_label(renderer: Renderer) -> &'static str {
    match renderer {
        Renderer::Projected => "Projected",
        Renderer::Exact => "Exact",
    }
}
