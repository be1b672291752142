//! Plot of the PSNR of early frames during training, which reveals forgetting.

use super::plot_axes::with_axes;
use crate::app::retention::RetainedFrame;
use crate::math::image::unit_to_byte;
use crate::render::paint::ramp;
use eframe::egui::{Color32, RichText, Ui};
use egui_plot::{Legend, Line, Plot, PlotPoints, Points};

/// Draws one curve per tracked frame.
pub fn ui(frames: &[RetainedFrame], ui: &mut Ui) {
    if frames.is_empty() {
        return;
    }
    ui.add_space(6.0);
    ui.label(RichText::new("Retention").strong())
        .on_hover_text("PSNR of earlier frames, measured again during training: a falling curve means that the frame is forgotten");
    with_axes(Plot::new("retention"), ["frames trained", "PSNR, dB"])
        .height(180.0)
        .legend(Legend::default())
        .allow_drag(false)
        .allow_zoom(false)
        .allow_scroll(false)
        .allow_boxed_zoom(false)
        .show(ui, |plot| {
            for (i, frame) in frames.iter().enumerate() {
                let name = format!("frame {}", frame.position);
                let [r, g, b] = ramp(0.15 + 0.8 * i as f32 / frames.len() as f32).map(unit_to_byte);
                let color = Color32::from_rgb(r, g, b);
                let points = || PlotPoints::from(frame.psnr.clone());
                plot.line(Line::new(name.clone(), points()).color(color));
                plot.points(Points::new(name, points()).radius(2.5).color(color));
            }
        });
}
