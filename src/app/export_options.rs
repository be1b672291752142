//! What the export dialog asks of scenes, how their splats become plain ones, and what it tells of the file.

use crate::app::viewer::export_preview::PreviewReport;
use crate::export::mapping::{GradientSplit, Mapping, OpacityMapping};
use eframe::egui::{Grid, Ui};

/// Draws the choices.
pub fn ui(mapping: &mut Mapping, ui: &mut Ui) {
    ui.add_space(4.0);
    ui.label("Other programs draw plain splats: opacity up to 1, one colour.");
    ui.weak("Trained with Splats: Plain (Settings), a scene is written exactly as it was learnt.");
    Grid::new("mapping").num_columns(2).show(ui, |ui| {
        ui.label("Splats for each");
        ui.horizontal(|ui| {
            for (split, label, tooltip) in [
                (GradientSplit::One, "1", "Colour no longer varies over a splat"),
                (GradientSplit::Two, "2", "Two along the longest axis, coloured by the gradient"),
                (
                    GradientSplit::Four,
                    "4",
                    "Four along both axes of the surface, coloured by the gradient",
                ),
            ] {
                let is_chosen = mapping.split == split;
                if ui.selectable_label(is_chosen, label).on_hover_text(tooltip).clicked() {
                    // Brings the opacity that measured best with it, which can
                    // still be changed below.
                    *mapping = Mapping::of(split);
                }
            }
        });
        ui.end_row();
        ui.label("Opacity above 1");
        ui.horizontal(|ui| {
            for (opacity, label, tooltip) in [
                (OpacityMapping::EqualArea, "Equal area", "Splats grow until they cover as much"),
                (OpacityMapping::Clip, "Clip", "Splats keep their size"),
            ] {
                ui.selectable_value(&mut mapping.opacity, opacity, label).on_hover_text(tooltip);
            }
        });
        ui.end_row();
    });
    ui.add_space(4.0);
}

/// Whether the file is previewed.
pub fn preview(is_on: &mut bool, ui: &mut Ui) {
    let hint = "Shows beside the scene what the file will give back: drag the line in the picture";
    ui.checkbox(is_on, "Preview the file").on_hover_text(hint);
}

/// What is known of the file that is previewed.
pub fn report(report: Option<&PreviewReport>, ui: &mut Ui) {
    match report {
        None => {}
        Some(PreviewReport::Converting) => {
            ui.weak("Converting…");
        }
        Some(PreviewReport::Refused(problem)) => {
            ui.colored_label(ui.visuals().error_fg_color, problem);
        }
        Some(PreviewReport::Shown { n_splats, bytes, psnr, losses }) => {
            ui.label(format!("{n_splats} splats, about {:.1} MB", *bytes as f64 * 1e-6));
            let figure = match psnr {
                // Images that are equal have 120 dB.
                Some(psnr) if *psnr > 100.0 => "Looks just like the scene from here".to_owned(),
                Some(psnr) if psnr.is_finite() => {
                    format!("Looks like the scene to {psnr:.1} dB from here")
                }
                Some(_) => "Cannot be measured from here".to_owned(),
                None => "Measuring…".to_owned(),
            };
            let hint = "PSNR of the file's picture against the scene's, in the view of now";
            ui.strong(figure).on_hover_text(hint);
            for loss in losses {
                ui.label(format!("• {loss}"));
            }
        }
    }
}
